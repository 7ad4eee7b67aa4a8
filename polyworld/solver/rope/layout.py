"""The records of the rope kernels.

A rope is a sequence of elements, nodes and wheels, with a link between consecutive ones (`Threading`). Ropes r of
a world lie one after the other in all arrays: element e of rope r is first_link[r] + r + e, its link e (to element
e + 1) is first_link[r] + e, its wheel p is first_wheel[r] + p.
"""

import warp as wp

from polyworld.solver.coupled.mechanism import Mechanisms
from polyworld.solver.spatial.layout import Body

NO_BODY = -1  # an end that is free, or held by another stage; a wheel on the world


@wp.struct
class Ropes:
    """Constants of a run. Arrays over ropes (n,), ends (n, 2), wheels (P,); parameters (R, n).

    end_body: rigid object that holds an end (start, end), or NO_BODY. end_anchor: where, in its axes. clamped: 1
    where the end's direction is held, by the world too. end_direction: that direction, and end_director a direction
    across it, in the body's or the world's axes. end_release [s], end_strength [N]: when it lets go. end_share,
    wheel_share: how often the body that holds it, or what joints hold to that, is met along this rope.
    """

    first_node: wp.array[wp.int32]
    nodes: wp.array[wp.int32]
    first_link: wp.array[wp.int32]
    first_wheel: wp.array[wp.int32]
    wheels: wp.array[wp.int32]
    segment_length: wp.array[wp.float64]
    linear_density: wp.array2d[wp.float64]
    stretch_stiffness: wp.array2d[wp.float64]
    bending_stiffness: wp.array2d[wp.float64]
    twist_stiffness: wp.array2d[wp.float64]
    stretch_damping: wp.array2d[wp.float64]
    bending_damping: wp.array2d[wp.float64]
    end_body: wp.array2d[wp.int32]
    end_anchor: wp.array2d[wp.vec3d]
    end_direction: wp.array2d[wp.vec3d]
    end_director: wp.array2d[wp.vec3d]
    clamped: wp.array2d[wp.int32]
    end_release: wp.array2d[wp.float64]
    end_strength: wp.array2d[wp.float64]
    end_share: wp.array2d[wp.float64]
    twist_at_start: wp.array[wp.float64]  # angle from one clamped end to the other that makes no moment [rad]
    curved: wp.array[wp.int32]  # 1 where the initial curve is the shape without moments
    curvature: wp.array[wp.vec2d]  # of that shape before each link, in its material frames
    wheel_body: wp.array[wp.int32]
    wheel_centre: wp.array[wp.vec3d]  # in the carrier's or the world's axes
    wheel_axis: wp.array[wp.vec3d]  # unit, the rope goes round it counter-clockwise
    wheel_radius: wp.array[wp.float64]
    wheel_fixed: wp.array[wp.int32]
    wheel_share: wp.array[wp.float64]
    wheel_friction: wp.array2d[wp.float64]
    bearing_friction: wp.array2d[wp.float64]
    bearing_damping: wp.array2d[wp.float64]
    wheel_inertia: wp.array2d[wp.float64]


@wp.struct
class Wheel:
    """State of a pulley in one world; the first rows persist, the others are worked out in every inner step.

    speed: of the rope past the wheel, towards the rope's end [m/s]. begin: the same at the start of the inner step.
    wrap: angle of contact [rad]. mode: 0 stuck, 1 or -1 the sign in which it turns or slips. index: that of the
    wheel among the rope's elements, -1 once the rope has run off it. radial_in, radial_out: unit vectors from the
    axis to the tangent points; zero before the first step.
    """

    speed: wp.float64
    wrap: wp.float64
    mode: int
    index: int
    blocked: int  # sign of the flow that a knot or a load at the wheel keeps from going on, 0 for none
    radial_in: wp.vec3d
    radial_out: wp.vec3d
    begin: wp.float64
    centre: wp.vec3d
    axis: wp.vec3d
    arrives: wp.vec3d
    leaves: wp.vec3d
    velocity: wp.vec3d
    kept: wp.vec3d  # velocity of the carrier at the start of the inner step
    lag: wp.vec3d  # by which its motion in the step is slower than its velocity at the end
    mobility: wp.mat33d  # of the centre: velocity per impulse, of the carrier
    inverse_mass: wp.float64  # of the wheel's turning, seen at the rope
    drive: wp.float64  # speed without tensions at the end of the inner step
    weight_in: wp.float64  # share with which the tension before it acts on its turning
    weight_out: wp.float64


@wp.struct
class RopeState:
    """All that changes while a world runs, (W, ...), and room to work in.

    bodies (W, n + s): the rigid solver's, which hold ends and carry wheels; mechanisms: what joints make of them.
    order: elements as in `Threading.order`. elements (W, n): how many there are. rest, tension: of links; held: 1
    where a link's tension is at its lower bound. elongation: in the step before, NaN where there was none. attached
    (W, n, 2): 1 while an end is held by its body. before (W, n): length of the inner step before [s].
    """

    bodies: wp.array2d[Body]
    mechanisms: Mechanisms
    order: wp.array2d[wp.int32]
    elements: wp.array2d[wp.int32]
    rest: wp.array2d[wp.float64]
    tension: wp.array2d[wp.float64]
    held: wp.array2d[wp.int32]
    elongation: wp.array2d[wp.float64]
    before: wp.array2d[wp.float64]
    least_steps: wp.array[wp.int32]  # (W,) inner steps of the first coupling step, 0 before it
    need: wp.array[wp.float64]  # (W,) inner steps that the tension asks for, past ones fading
    attached: wp.array3d[wp.int32]
    wheels: wp.array2d[Wheel]
    twist: wp.array2d[wp.float64]  # (W, n) angle from one clamped end to the other [rad]
    reference: wp.array2d[wp.vec3d]  # direction across a link of a curved rope, carried along in time
    heading: wp.array2d[wp.vec3d]  # direction of the link when it was
    theta: wp.array2d[wp.float64]  # angle from it to the material's direction [rad]
    reference_twist: wp.array2d[wp.float64]  # angle from the link's before to the link's own [rad]
    mean_tension: wp.array2d[wp.float64]  # over the coupling step so far
    direction: wp.array2d[wp.vec3d]
    compliance: wp.array2d[wp.float64]  # velocity per impulse that a link gives by its own stretch [1/kg]
    target: wp.array2d[wp.float64]
    diagonal: wp.array2d[wp.float64]  # velocity per impulse of a link on itself, and on the next one
    coupled: wp.array2d[wp.float64]
    right: wp.array2d[wp.float64]
    forward: wp.array2d[wp.float64]
    change: wp.array2d[wp.float64]
    end_mobility: wp.array3d[wp.mat33d]  # (W, n, 2) of an end node together with its body
    end_kept: wp.array3d[wp.vec3d]  # (W, n, 2) velocity of the body at the start of the inner step
    end_lag: wp.array3d[wp.vec3d]  # (W, n, 2) by which an end's motion in the step is slower than its velocity after it
    end_split: wp.array3d[wp.mat33d]  # (W, n, 2) part of an impulse that the body takes
