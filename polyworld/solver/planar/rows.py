"""Contact rows: their relative velocity, and what impulses at them do."""

import warp as wp

from polyworld.solver.planar.records import Bodies, Contacts, Scene, Step

wp.set_module_options({"enable_backward": False})

HALF = wp.float64(0.5)
QUIET = wp.float64(1.0e-3)  # approach left to the forces, of the fastest that does not bounce
GOOD = wp.float64(1.0e-4)  # error of speeds that large islands are left with, of the same
SLOW = wp.float64(1.0e-5)  # approach speeds below this do not bounce [m/s]


@wp.func
def point_velocity(rate: wp.vec3d, arm: wp.vec2d) -> wp.vec2d:
    return wp.vec2d(rate[0] - rate[2] * arm[1], rate[1] + rate[2] * arm[0])


@wp.func
def row_velocity(
    scene: wp.array[Scene],
    contacts: wp.array[Contacts],
    rates: wp.array2d[wp.vec3d],
    w: wp.int32,
    slot: wp.int32,
    half: wp.int32,
    r: wp.int32,
) -> wp.vec2d:
    """Relative velocity of b against a at a row, by these rates: along the normal (positive: parting), the tangent."""
    b = contacts[0].rows[slot, half, r].b
    normal = contacts[0].rows[slot, half, r].normal
    v = -point_velocity(rates[w, contacts[0].rows[slot, half, r].a], contacts[0].rows[slot, half, r].arm_a)
    if b < scene[0].bodies:
        v = v + point_velocity(rates[w, b], contacts[0].rows[slot, half, r].arm_b)
    return wp.vec2d(wp.dot(normal, v), normal[0] * v[1] - normal[1] * v[0])


@wp.func
def pushed_along(
    scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], step: Step, r: wp.int32
) -> wp.float64:
    """Largest acceleration of a row's bodies along its normal, by gravity and effects or by its load [m/s^2]."""
    normal = contacts[0].rows[step.slot, step.half, r].normal
    push = bodies[0].push[step.w, contacts[0].rows[step.slot, step.half, r].a]
    pushed = wp.abs(normal[0] * push[0] + normal[1] * push[1])
    mass = contacts[0].rows[step.slot, step.half, r].mass[0]
    load = contacts[0].rows[step.slot, step.half, r].force[0] / (mass * contacts[0].rows[step.slot, step.half, r].span)
    pushed = wp.max(pushed, load)
    b = contacts[0].rows[step.slot, step.half, r].b
    if b < scene[0].bodies:
        push = bodies[0].push[step.w, b]
        pushed = wp.max(pushed, wp.abs(normal[0] * push[0] + normal[1] * push[1]))
    return pushed


@wp.func
def slow_approach(step: Step, pushed: wp.float64) -> wp.float64:
    """Speed of approach up to which bodies do not bounce: what pushes them changes it by as much in half a step."""
    return HALF * step.whole * pushed + SLOW


@wp.func
def apply_impulse(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    w: wp.int32,
    slot: wp.int32,
    half: wp.int32,
    r: wp.int32,
    impulse: wp.vec3d,
) -> None:
    """Add impulses (normal, tangent, moment) to the rates of b, and the opposite to those of a."""
    normal = contacts[0].rows[slot, half, r].normal
    p = wp.vec2d(impulse[0] * normal[0] - impulse[1] * normal[1], impulse[0] * normal[1] + impulse[1] * normal[0])
    a = contacts[0].rows[slot, half, r].a
    arm = contacts[0].rows[slot, half, r].arm_a
    m = bodies[0].inverse_mass[w, a]
    moment = bodies[0].inverse_inertia[w, a] * (arm[0] * p[1] - arm[1] * p[0] + impulse[2])
    bodies[0].next_rate[w, a] = bodies[0].next_rate[w, a] - wp.vec3d(m * p[0], m * p[1], moment)
    b = contacts[0].rows[slot, half, r].b
    if b < scene[0].bodies:
        arm = contacts[0].rows[slot, half, r].arm_b
        m = bodies[0].inverse_mass[w, b]
        moment = bodies[0].inverse_inertia[w, b] * (arm[0] * p[1] - arm[1] * p[0] + impulse[2])
        bodies[0].next_rate[w, b] = bodies[0].next_rate[w, b] + wp.vec3d(m * p[0], m * p[1], moment)
