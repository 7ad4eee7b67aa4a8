"""Hinges: two bodies, or a body and the world, keep a common point.

Over a step the common point moves equally far with both bodies, and the impulse acts at the mean of where
it was and where it comes to. The hinge then does no work at all: an energy-momentum method (Simo & Wong
1991, IJNME 31, 19; Gonzalez 1999, Physica D 132, 165), second order in the step. What remains of the rates
that would pull the point apart is projected out at the step's end, which can only take energy.
"""

import warp as wp

from polyworld.solver.planar.motion import shift_of
from polyworld.solver.planar.records import Bodies, Joints, Scene

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
RATE_SWEEPS = 300
POSE_SWEEPS = 50


@wp.func
def turned(arm: wp.vec2d, angle: wp.float64) -> wp.vec2d:
    c = wp.cos(angle)
    s = wp.sin(angle)
    return wp.vec2d(c * arm[0] - s * arm[1], s * arm[0] + c * arm[1])


@wp.func
def mean_lever(arm: wp.vec2d, angle: wp.float64, turn: wp.float64) -> wp.vec2d:
    """The lever l with which a turn from `angle` by `turn` moves the arm's tip by exactly turn * (-l_y, l_x)."""
    x = HALF * turn
    chord = ONE
    if x != ZERO:
        chord = wp.sin(x) / x
    return turned(arm, angle + x) * chord


@wp.func
def tip(motion: wp.vec3d, lever: wp.vec2d) -> wp.vec2d:
    """What a rate or a small shift of a body does at the end of a lever."""
    return wp.vec2d(motion[0] - motion[2] * lever[1], motion[1] + motion[2] * lever[0])


@wp.func
def kick(change: wp.vec2d, lever: wp.vec2d, inverse_mass: wp.float64, inverse_inertia: wp.float64) -> wp.vec3d:
    """Change of a body's motion by an impulse at the end of a lever."""
    moment = lever[0] * change[1] - lever[1] * change[0]
    return wp.vec3d(inverse_mass * change[0], inverse_mass * change[1], inverse_inertia * moment)


@wp.func
def compliance(lever: wp.vec2d, inverse_mass: wp.float64, inverse_inertia: wp.float64) -> wp.vec3d:
    """Motion of a lever's end for a unit impulse there: entries xx, xy, yy of a symmetric matrix."""
    return wp.vec3d(
        inverse_mass + inverse_inertia * lever[1] * lever[1],
        -inverse_inertia * lever[0] * lever[1],
        inverse_mass + inverse_inertia * lever[0] * lever[0],
    )


@wp.func
def solve(k: wp.vec3d, gap: wp.vec2d) -> wp.vec2d:
    """The impulse that closes a gap of motions."""
    scale = -ONE / (k[0] * k[2] - k[1] * k[1])
    return wp.vec2d((k[2] * gap[0] - k[1] * gap[1]) * scale, (k[0] * gap[1] - k[1] * gap[0]) * scale)


@wp.func
def sign_of(e: wp.int32) -> wp.float64:
    """The impulse of a hinge acts on its second end, its opposite on the first."""
    return wp.where(e == 0, -ONE, ONE)


@wp.func
def begin_hinges(scene: Scene, joints: Joints, w: wp.int32, segment: wp.int32) -> None:
    """Take up the hinges whose bodies move in this segment."""
    for j in range(joints.count):
        joints.active[w, j] = wp.where(scene.joins[joints.body[j, 0]] <= segment, 1, 0)


@wp.func
def reach_pivot(bodies: Bodies, joints: Joints, w: wp.int32, j: wp.int32) -> wp.vec3d:
    """Set the levers to the pivot as the bodies lie now; returns the compliance there."""
    k = wp.vec3d()
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            lever = turned(joints.arm[w, j, e], bodies.pose[w, i][2])
            joints.lever[w, j, e] = lever
            k += compliance(lever, bodies.inverse_mass[w, i], bodies.inverse_inertia[w, i])
    return k


@wp.func
def join_rate(bodies: Bodies, joints: Joints, w: wp.int32, j: wp.int32) -> wp.float64:
    """One Gauss-Seidel visit: no relative velocity at the pivot now. Returns the one it found [m/s]."""
    if joints.active[w, j] == 0:
        return ZERO
    k = reach_pivot(bodies, joints, w, j)
    gap = wp.vec2d()
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            gap += tip(bodies.next_rate[w, i], joints.lever[w, j, e]) * sign_of(e)
    p = solve(k, gap)
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            bodies.next_rate[w, i] = bodies.next_rate[w, i] + kick(
                p * sign_of(e), joints.lever[w, j, e], bodies.inverse_mass[w, i], bodies.inverse_inertia[w, i]
            )
    return wp.length(gap)


@wp.func
def join_rates(scene: Scene, bodies: Bodies, joints: Joints, w: wp.int32) -> None:
    """Project the rates on what the hinges allow: the nearest in kinetic energy, so none is gained."""
    fastest = ZERO
    for i in range(scene.bodies):
        bodies.next_rate[w, i] = bodies.rate[w, i]
        fastest = wp.max(fastest, wp.length(bodies.rate[w, i]))
    for _ in range(RATE_SWEEPS):
        residual = ZERO
        for j in range(joints.count):
            residual = wp.max(residual, join_rate(bodies, joints, w, j))
        if residual <= wp.float64(1.0e-13) * fastest:
            break
    for i in range(scene.bodies):
        bodies.rate[w, i] = bodies.next_rate[w, i]


@wp.func
def mobility(bodies: Bodies, w: wp.int32, i: wp.int32) -> wp.vec2d:
    """Change of `next_rate` (linear, angular) for a unit of a force's impulse, damped on the way as all forces are."""
    return wp.vec2d(
        bodies.inverse_mass[w, i] * bodies.linear_decay[w, i][1],
        bodies.inverse_inertia[w, i] * bodies.angular_decay[w, i][1],
    )


@wp.func
def begin_hold(bodies: Bodies, joints: Joints, w: wp.int32, ratio: wp.float64, h: wp.float64) -> wp.float64:
    """Start from the last step's impulses times `ratio`; returns how fast the hinged bodies are pushed or move."""
    pushed = ZERO
    for j in range(joints.count):
        p = joints.impulse[w, j] * ratio
        joints.impulse[w, j] = p
        for e in range(joints.ends):
            i = joints.body[j, e]
            if i >= 0 and joints.active[w, j] == 1:
                joints.lever[w, j, e] = wp.vec2d()  # the first visit moves the impulse out to the pivot
                change = p * (sign_of(e) * mobility(bodies, w, i)[0])
                bodies.next_rate[w, i] = bodies.next_rate[w, i] + wp.vec3d(change[0], change[1], ZERO)
                pushed = wp.max(pushed, wp.max(wp.length(bodies.push[w, i]) * h, wp.length(bodies.rate[w, i])))
    return pushed


@wp.func
def hold_hinge(bodies: Bodies, joints: Joints, w: wp.int32, j: wp.int32, h: wp.float64) -> wp.float64:
    """One Gauss-Seidel visit: both ends carry the pivot equally far in the step. Returns the error [m/s]."""
    if joints.active[w, j] == 0:
        return ZERO
    p = joints.impulse[w, j]
    gap = wp.vec2d()
    k = wp.vec3d()
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            mobile = mobility(bodies, w, i)
            lever = mean_lever(joints.arm[w, j, e], bodies.pose[w, i][2], shift_of(bodies, w, i, h)[2])
            # The impulse so far moves to where the pivot now passes: the whole of it acts at one point.
            moved = lever - joints.lever[w, j, e]
            joints.lever[w, j, e] = lever
            twist = kick(p * sign_of(e), moved, ZERO, mobile[1])
            bodies.next_rate[w, i] = bodies.next_rate[w, i] + twist
            gap += tip(shift_of(bodies, w, i, h), lever) * sign_of(e)
            # From a change of rate to the change of the shift: see `shift_of`.
            k += compliance(
                lever, mobile[0] * h * bodies.linear_decay[w, i][2], mobile[1] * h * bodies.angular_decay[w, i][2]
            )
    change = solve(k, gap)
    joints.impulse[w, j] = p + change
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            mobile = mobility(bodies, w, i)
            bodies.next_rate[w, i] = bodies.next_rate[w, i] + kick(
                change * sign_of(e), joints.lever[w, j, e], mobile[0], mobile[1]
            )
    return wp.length(gap) / h


@wp.func
def mend_hinge(scene: Scene, bodies: Bodies, joints: Joints, w: wp.int32, j: wp.int32) -> wp.float64:
    """One Gauss-Seidel visit: the pivot at one place for both ends. Returns a bound of how far a point moved [m]."""
    if joints.active[w, j] == 0:
        return ZERO
    k = reach_pivot(bodies, joints, w, j)
    gap = joints.anchor[w, j]
    if joints.body[j, 1] >= 0:
        gap = wp.vec2d()
    size = ZERO
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            pose = bodies.pose[w, i]
            lever = joints.lever[w, j, e]
            gap += (wp.vec2d(pose[0], pose[1]) + lever) * sign_of(e)
            size += wp.abs(pose[0]) + wp.abs(pose[1]) + wp.length(lever)
    if not wp.length(gap) > wp.float64(1.0e-14) * size:  # rounding
        return ZERO
    p = solve(k, gap)
    moved = ZERO
    for e in range(joints.ends):
        i = joints.body[j, e]
        if i >= 0:
            change = kick(
                p * sign_of(e), joints.lever[w, j, e], bodies.inverse_mass[w, i], bodies.inverse_inertia[w, i]
            )
            bodies.pose[w, i] = bodies.pose[w, i] + change
            moved += wp.abs(change[0]) + wp.abs(change[1]) + wp.abs(change[2]) * scene.bound[i]
    return moved


@wp.func
def mend(scene: Scene, bodies: Bodies, joints: Joints, w: wp.int32) -> wp.float64:
    """Close what rounding, a step cut short or a parted overlap has opened, without giving anything speed.

    Returns a bound of how far any point moved [m].
    """
    total = ZERO
    for _ in range(POSE_SWEEPS):
        moved = ZERO
        for j in range(joints.count):
            moved += mend_hinge(scene, bodies, joints, w, j)
        total += moved
        if moved == ZERO:
            break
    return total
