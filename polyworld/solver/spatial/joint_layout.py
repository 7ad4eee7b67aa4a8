"""Records of joints: their constants in all worlds, and their state in one."""

import warp as wp

from polyworld.solver.spatial.tree_layout import Tree

HINGE = 0
SLIDER = 1
BALL = 2
FIXED = 3
SPRING = 4


@wp.struct
class JointKind:
    """Constants of a joint, the same in all worlds.

    a, b: the bodies it joins; the world is the body after the last static. column: its index among the world's
    joints.
    frame: columns axis and two tangents, world axes. point, points: its rows hold the coordinates
    [point, point + points) of the anchor in the frame, and then of the rotation [rotation, rotation + rotations).
    first: its first row. axis, axes: its rows along which it moves with friction, motors and stops, or
    along which a spring pulls. direction: 1 or -1, of a motor's effort without a target.
    """

    kind: int
    a: int
    b: int
    column: int
    point: int
    points: int
    rotation: int
    rotations: int
    first: int
    axis: int
    axes: int
    frame: wp.mat33d
    bounded: int  # 1 where it has a stop
    rest_length: wp.float64
    driven: int  # 0: no motor; 1: with a constant effort; 2: towards a speed
    direction: wp.float64
    switched_on: wp.float64
    switched_off: wp.float64


@wp.struct
class Joint:
    """A joint in one world: where it holds its bodies, in their axes, and how it moves.

    position: angle or displacement from the start, counted beyond full turns; for a spring its length. speed: rate of
    `position` at the start of the step. The impulses are those of the step so far: of dry friction (along three axes
    for a ball), damping, motor, lower and upper stop, and spring.
    """

    arm_a: wp.vec3d
    arm_b: wp.vec3d
    frame_a: wp.mat33d
    frame_b: wp.mat33d
    active: int
    friction: wp.float64
    damping: wp.float64
    stiffness: wp.float64
    rest_length: wp.float64
    lower: wp.float64
    upper: wp.float64
    target_speed: wp.float64  # of its motor
    effort: wp.float64  # of its motor, with its sign
    delay: wp.float64
    position: wp.float64
    position_at_end: wp.float64  # at the end of the step, as it looks now
    seen_speed: wp.float64  # rate of the spring's length at which end_place was found
    speed: wp.vec3d
    drive: wp.float64  # seconds of the step for which the motor is on
    rubbing: wp.vec3d
    damped: wp.vec3d
    driving: wp.float64
    stopped: wp.vec2d
    pulled: wp.float64
    last_rubbing: wp.vec3d  # forces of the last step, a guess to begin with
    last_damped: wp.vec3d
    last_pulled: wp.float64
    stop_target: wp.vec2d  # least velocity away from the lower and upper stop
    tension: wp.float64  # force that held its point in the last step [N]
    is_final: int  # 1 where a spring's impulse is final


@wp.struct
class Joints:
    """All joints of K worlds, their rows in State.rows from `base` on, and room to solve for their impulses.

    Rows are ordered so that the matrix (J M^-1 J^T) of a chain or tree is narrow. Its row r is kept from column
    column[r] to the diagonal, at start[r] of `matrix`, which holds its Cholesky factor L. inverse: 1 / L[r, r],
    0 for rows that depend on those before. target: the velocity that each row is brought to.
    """

    count: int
    equalities: int
    axes: int
    base: int
    kinds: wp.array[JointKind]
    column: wp.array[wp.int32]
    start: wp.array[wp.int32]
    row_a: wp.array[wp.int32]  # (equalities + axes,) the bodies that each row acts on
    row_b: wp.array[wp.int32]
    jointed: wp.array[wp.int32]  # (n,) 1 where a body is held by a joint
    joint: wp.array2d[Joint]
    matrix: wp.array2d[wp.float64]
    inverse: wp.array2d[wp.float64]
    target: wp.array2d[wp.float64]
    work: wp.array2d[wp.float64]
    resists: wp.array2d[wp.int32]  # (K, count) 1 where anything acts along a joint's axes
    held: wp.array2d[wp.float64]  # (K, axes * equalities) what the joints take of a push along each axis
    yields: wp.array2d[wp.float64]  # (K, axes * axes) velocity per impulse of axes while the joints hold
    rate: wp.array2d[wp.float64]  # (K, axes) velocities of the axes while their impulses are sought
    pushed: wp.array2d[wp.float64]  # (K, axes) impulses found
    chosen: wp.array2d[wp.int32]  # (K, axes) joints whose axes are solved together, their states,
    state: wp.array2d[wp.int32]
    factor: wp.array2d[wp.float64]  # (K, axes * axes) the factor, with the inverse of its diagonal,
    change: wp.array2d[wp.float64]  # (K, axes) and the changes of their impulses
    ready: wp.array[wp.int32]  # (K,) 1 where the rows are those of the bodies' pose
    inverse_inertia: wp.array2d[wp.mat33d]  # (K, n + s + 1) of the bodies held, world axes; zero for the others
    force: wp.array2d[wp.float64]  # (K, equalities) that held each row in the last step
    start_w: wp.array2d[wp.vec3d]
    end_x: wp.array2d[wp.vec3d]
    end_q: wp.array2d[wp.quatd]
    end_rotation: wp.array2d[wp.mat33d]
    half_impulse: wp.array2d[wp.float64]
    tree: Tree
    # (1 or W, joints): where it holds a and b, springs in the bodies' axes, others in the world's at the start [m]
    anchor: wp.array2d[wp.vec3d]
    other_anchor: wp.array2d[wp.vec3d]
    friction: wp.array2d[wp.float64]  # (1 or W, joints), as in `polyworld.model.arrays.RigidArrays`
    damping: wp.array2d[wp.float64]
    stiffness: wp.array2d[wp.float64]
    target_speed: wp.array2d[wp.float64]
    limit: wp.array2d[wp.float64]
    delay: wp.array2d[wp.float64]
    lower: wp.array2d[wp.float64]
    upper: wp.array2d[wp.float64]
