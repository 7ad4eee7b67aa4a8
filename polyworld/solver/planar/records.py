"""Arrays of the planar solver, grouped by what they are. Leading axis W: one row a world."""

import warp as wp

from polyworld.solver.core.effect_table import Effects
from polyworld.solver.core.simulator import Outcome
from polyworld.solver.core.time_table import Schedule

wp.set_module_options({"enable_backward": False})


@wp.struct
class Scene:
    """Constants of all worlds: n bodies, then s statics. A static without vertices is a half plane."""

    bodies: wp.int32
    statics: wp.int32
    forces: wp.int32  # how many effects push bodies
    contact_laws: wp.int32  # how many change what happens at contacts
    level: wp.float64  # where the motion plane lies along its normal [m]
    supports: wp.int32  # whether gravity across the plane presses bodies on it
    vertices: wp.array[wp.vec2d]  # outlines, counter-clockwise, about each centre [m]
    normals: wp.array[wp.vec2d]  # outward normal of the edge that starts at the vertex
    first: wp.array[wp.int32]  # (n + s + 1,) first vertex of each outline
    sweep: wp.array[wp.float64]  # (n + s,) radius of the disc swept along the outline [m]
    bound: wp.array[wp.float64]  # (n + s,) radius of the bounding circle [m]
    depth: wp.array[wp.float64]  # (n + s,) a relative motion shorter than this cannot pass through [m]
    collides: wp.array2d[wp.int32]  # (n, n + s)
    touch: wp.float64  # a gap below this is contact [m]
    skin: wp.float64  # pairs nearer than this are kept in the near list [m]
    axes: wp.mat33d  # rows: the plane's x, y and normal in world axes
    schedule: Schedule
    effects: Effects
    effect_radius: wp.array[wp.float64]  # (n,) radius of the ball of equal volume [m]


@wp.struct
class Bodies:
    """State and parameters of the bodies of every world; friction and restitution also of the statics."""

    pose: wp.array2d[wp.vec3d]  # x, y, angle [m, m, rad]
    rate: wp.array2d[wp.vec3d]  # velocity and angular velocity
    next_rate: wp.array2d[wp.vec3d]  # rate at the end of the step being solved
    shift: wp.array2d[wp.vec3d]  # change of pose over the step being solved
    push: wp.array2d[wp.vec3d]  # acceleration by gravity, effects and control
    control: wp.array2d[wp.vec3d]  # acceleration by forces that are given from outside while the world runs
    drag: wp.array2d[wp.vec3d]  # change of rate by friction on the supporting plane; in an impact, the rate before
    reaction: wp.array2d[wp.vec3d]  # acceleration by contacts, hinges and the supporting plane in the last step
    touching: wp.array2d[wp.int32]  # whether the body touches another that it does not part from
    coupled: wp.array2d[wp.int32]  # whether a contact row or a hinge acts on the body in this step
    linear_decay: wp.array2d[wp.vec3d]  # exp(-ch), phi1(ch), phi2(ch)/phi1(ch) for the current h
    angular_decay: wp.array2d[wp.vec3d]
    decay_step: wp.array[wp.float64]  # (W,) the h they were computed for
    mass: wp.array2d[wp.float64]
    inverse_mass: wp.array2d[wp.float64]
    inverse_inertia: wp.array2d[wp.float64]
    hold: wp.array2d[wp.float64]  # mu |g_n|: largest deceleration by the supporting plane [m/s^2]
    static_pose: wp.array2d[wp.vec3d]  # (W, s) x, y, angle; of a half plane its outward normal and offset
    support: wp.array2d[wp.float64]  # Coulomb coefficient on the supporting plane, without effects
    mixed: wp.array2d[wp.vec3d]  # rates after an impact by one of two laws that are mixed
    patch: wp.array2d[wp.float64]  # radius of the spinning-friction patch [m]
    linear_damping: wp.array2d[wp.float64]
    angular_damping: wp.array2d[wp.float64]
    friction: wp.array2d[wp.float64]  # (W, n + s), of statics as `contact_coefficients` codes them
    restitution: wp.array2d[wp.float64]  # (W, n + s), of statics as `contact_coefficients` codes them
    rolling: wp.array2d[wp.float64]
    height: wp.array2d[wp.float64]  # coordinate along the plane's normal [m]
    gravity: wp.array[wp.vec3d]  # (W,) in the plane, and along its normal
    time_scale: wp.array[wp.float64]  # (W,)
    time_origin: wp.array[wp.float64]  # (W,) [s]
    corners: wp.array2d[wp.vec2d]  # (W, 2 k) scratch: outlines of the pair under test


@wp.struct
class Joints:
    """Hinges, each with two ends: a body, and a body or the world."""

    count: wp.int32
    ends: wp.int32  # 2; not a constant, for Warp would unroll loops over it and compile twice as much
    body: wp.array2d[wp.int32]  # (j, 2), -1 for the world, which is always second
    hinged: wp.array[wp.int32]  # (n,) whether a body has any
    anchor: wp.array2d[wp.vec2d]  # (W, j) the pivot at the start [m]
    arm: wp.array3d[wp.vec2d]  # (W, j, 2) the pivot in the body's own axes, from its centre [m]
    active: wp.array2d[wp.int32]  # (W, j) whether its bodies move yet
    moment_arm: wp.array3d[wp.vec2d]  # (W, j, 2) of the impulse being solved for [m]
    impulse: wp.array2d[wp.vec2d]  # (W, j) on the second end over the step, its opposite on the first [N s]


@wp.struct
class Row:
    """One contact point between body a and body or static b; the normal points from a to b."""

    a: wp.int32
    b: wp.int32
    slot: wp.int32  # index in the near list
    touching: wp.int32
    normal: wp.vec2d
    arm_a: wp.vec2d
    arm_b: wp.vec2d
    gap: wp.float64
    bounce: wp.float64  # separation speed demanded of the normal solve
    approach: wp.float64  # approach speed when the interval began
    mass_normal: wp.float64
    mass_tangent: wp.float64
    mass_roll: wp.float64
    friction: wp.float64
    restitution: wp.float64
    rolling: wp.float64
    impulse: wp.float64
    impulse_tangent: wp.float64
    impulse_roll: wp.float64
    plastic: wp.int32  # whether the row has stopped bouncing in this impact
    stick_fraction: wp.float64  # above 0 where the tangential speed reaches `target_velocity`, beyond Coulomb's limit
    target_velocity: wp.float64
    tangential_loss: wp.float64  # share of the centres' tangential velocity that this round removes
    impact_impulse: wp.float64  # normal impulse of the impact that began the interval
    round_impulse: wp.float64  # impulses of the current round of impacts
    round_tangent: wp.float64
    round_roll: wp.float64
    newton_impulse: wp.float64  # normal impulse of the round by Newton's law alone


@wp.struct
class Step:
    """The step that a world takes, cut into parts by impacts, and what the last part left for this one.

    part: how much of h is taken, all of it or up to the next impact. fastest: bound of the bodies' speeds in it.
    """

    w: wp.int32  # the world
    segment: wp.int32
    diverged: wp.int32  # whether the world has diverged
    parts: wp.int32  # parts of the step taken before
    time: wp.float64  # at which this part begins [s]
    whole: wp.float64  # length of the whole step [s]
    h: wp.float64  # what is left of it [s]
    part: wp.float64  # [s]
    last_h: wp.float64  # h of the last part [s]
    ratio: wp.float64  # h over the last one
    fastest: wp.float64  # [m/s]
    room: wp.float64  # motion for which the near list still holds [m]
    near: wp.int32  # pairs in that list
    half: wp.int32  # which half of the contact rows is this part's
    rows: wp.int32  # how many it has


@wp.struct
class Contacts:
    """Pairs that may meet soon, the contact rows of this step and the last, and the step with which a run ended."""

    near: wp.array2d[wp.vec2i]
    near_gap: wp.array2d[wp.float64]  # a lower bound of the pair's gap [m]
    rows: wp.array3d[Row]  # (W, 2, C): one half is this step's, the other the last step's
    last: wp.array[Step]  # (W,)


@wp.struct
class Samples:
    """States at the sample times, in plane coordinates, and how a run ended."""

    pose: wp.array3d[wp.vec3d]  # (W, T, n)
    rate: wp.array3d[wp.vec3d]
    outcome: Outcome


@wp.struct
class References:
    """The same records as arrays of one, for functions that are not inlined: a call would copy the records."""

    scene: wp.array[Scene]
    bodies: wp.array[Bodies]
    contacts: wp.array[Contacts]
