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
    reaction: wp.array2d[wp.vec3d]  # acceleration by contacts and the supporting plane in the last step
    touching: wp.array2d[wp.int32]  # whether the body touches another that it does not part from
    coupled: wp.array2d[wp.int32]  # whether a contact row acts on the body in this step
    linear_decay: wp.array2d[wp.vec3d]  # exp(-ch), phi1(ch), phi2(ch)/phi1(ch) for the current h
    angular_decay: wp.array2d[wp.vec3d]
    decay_step: wp.array2d[wp.float64]  # the h they were computed for
    since: wp.array2d[wp.float64]  # when, in the step, the path now taken begins [s]
    room: wp.array2d[
        wp.vec2d
    ]  # since the near list was renewed no point has moved further; centre: what it still may [m]
    ahead: wp.array2d[wp.vec2d]  # no point, nor the centre, moves further than this to the end of the step [m]
    cuts: wp.array2d[wp.int32]  # impacts that have cut the body's path in this step
    members: wp.array2d[wp.int32]  # the bodies whose paths the part being solved sets
    member: wp.array2d[wp.int32]  # whether a body is one of them
    label: wp.array2d[wp.int32]  # parent in the forest of bodies that contact rows connect
    island: wp.array2d[wp.int32]  # members that rows act on, island by island
    island_of: wp.array2d[wp.int32]  # index of the island of a root of the forest
    first_row: wp.array2d[wp.int32]  # (W, n + 2) where each island begins in `Contacts.order`
    first_body: wp.array2d[wp.int32]  # (W, n + 2) and in `island`
    last_rate: wp.array2d[wp.vec3d]  # iterate and direction of the accelerated sweeps, and the same of `drag`
    rate_direction: wp.array2d[wp.vec3d]
    last_drag: wp.array2d[wp.vec3d]
    drag_direction: wp.array2d[wp.vec3d]
    mass: wp.array2d[wp.float64]
    inverse_mass: wp.array2d[wp.float64]
    inverse_inertia: wp.array2d[wp.float64]
    hold: wp.array2d[wp.float64]  # mu |g_n|: largest deceleration by the supporting plane [m/s^2]
    static_pose: wp.array2d[wp.vec3d]  # (W, s) x, y, angle; of a half plane its outward normal and offset
    support: wp.array2d[wp.float64]  # Coulomb coefficient on the supporting plane, without effects
    mixed: wp.array2d[wp.vec3d]  # rates after an impact by one of two laws that are mixed
    patch: wp.array2d[wp.vec2d]  # radius r of the spinning-friction patch [m], and m r^2 / I
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
class Row:
    """One contact point between body a and body or static b; the normal points from a to b."""

    a: wp.int32
    b: wp.int32
    solved: wp.int32  # whether the sweeps now visit the row
    sticks: wp.int32  # whether they bring the tangential speed to `slip_target`, beyond Coulomb's limit
    normal: wp.vec2d
    levers: wp.vec4d  # moment arms about a and b of the normal, then of the tangent
    mass: wp.vec3d  # effective: normal, tangent, roll
    compliance: wp.vec3d  # its inverse: change of speed per impulse
    coupling: wp.float64  # of the slip per normal impulse
    target: wp.float64  # separation speed that the sweeps demand at least
    slip_target: wp.float64
    friction: wp.float64
    rolling: wp.float64
    impulse: wp.vec3d  # of the sweeps: normal, tangent, roll
    last_impulse: wp.vec3d  # iterate and direction of the accelerated sweeps
    direction: wp.vec3d
    slot: wp.int32  # index in the near list
    touching: wp.int32  # 1 if the point touches; -1 where a later part of the step has replaced the row
    gap: wp.float64
    restitution: wp.float64
    arm_a: wp.vec2d
    arm_b: wp.vec2d
    force: wp.vec3d  # impulses over `span` that keep the bodies apart
    span: wp.float64  # [s]
    approach: wp.float64  # approach speed when the interval began
    bounce: wp.float64  # separation speed that restitution demands in this round
    plastic: wp.int32  # whether the row has stopped bouncing in this impact
    stick_fraction: wp.float64  # above 0 where the tangential speed reaches `target_velocity`, beyond Coulomb's limit
    target_velocity: wp.float64
    tangential_loss: wp.float64  # share of the centres' tangential velocity that this round removes
    impact_impulse: wp.float64  # normal impulse of the impact that began the interval
    newton_impulse: wp.float64  # normal impulse of the round by Newton's law alone


@wp.struct
class Step:
    """The step that a world takes, and the part of it now being solved.

    The first part sets the paths of all bodies to the end of the step. Where two then collide, a further part sets
    those of their island, the bodies that touch each other, from that time on; the others' paths stay.
    """

    w: wp.int32  # the world
    slot: wp.int32  # its row in the scratch arrays
    segment: wp.int32
    diverged: wp.int32  # whether the world has diverged
    effort: wp.int32  # bodies solved for again in this step
    everyone: wp.int32  # whether the part is of all bodies
    start: wp.float64  # when the step begins [s]
    time: wp.float64  # when this part begins [s]
    whole: wp.float64  # length of the whole step [s]
    begin: wp.float64  # when, in the step, this part begins [s]
    h: wp.float64  # from there to the end of the step [s]
    renew: wp.int32  # whether a body may move further than the near list allows in the next step
    lost: wp.int32  # whether one does in this step
    near: wp.int32  # pairs in that list
    slack: wp.float64  # no pair of it is nearer when the step begins, if above 0 [m]
    heaviest: wp.float64  # greatest acceleration by gravity and effects [m/s^2]
    reach: wp.float64  # a gap wider than this is closed only by an impact [m]
    alike: wp.int32  # whether the last part was of all bodies, with h as long as it is again in the next step
    members: wp.int32  # bodies of this part
    bound_members: wp.int32  # of these, how many rows act on
    half: wp.int32  # which half of the contact rows is this step's
    rows: wp.int32  # how many it has
    active: wp.int32  # rows of this part
    islands: wp.int32  # sets of this part's bodies that rows connect
    meets: wp.int32  # whether any pair collides in this step
    longest: wp.float64  # no point of this part's bodies moves further to the end of the step [m]


@wp.struct
class Contacts:
    """Pairs that may meet soon, and the contact rows of this step and the last.

    Scratch of the S worlds that run at the same time: first axis S, K pairs, C rows.
    """

    near: wp.array2d[wp.vec2i]  # (S, K)
    near_gap: wp.array2d[wp.float64]  # no more than the pair's gap and the paths in `room` of both [m]
    meet: wp.array2d[wp.float64]  # when in the step the pair collides, FAR if it does not [s]
    row_at: wp.array2d[wp.int32]  # the pair's first row, in the half that was written last; -1 for none
    row_count: wp.array2d[wp.int32]  # how many it has
    kept: wp.array2d[wp.vec2i]  # (S, K) scratch: the pairs with rows while the near list is renewed,
    kept_rows: wp.array2d[wp.vec2i]  # and their first row and number of rows
    rows: wp.array3d[Row]  # (S, 2, C): one half is this step's, the other the last step's
    active: wp.array2d[wp.int32]  # (S, C) the rows of the part being solved
    order: wp.array2d[wp.int32]  # (S, C) the same, island by island
    last: wp.array[Step]  # (W,) with which a run ended


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
