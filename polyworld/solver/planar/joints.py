"""Hinges: two bodies, or a body and the world, keep a common point.

Over a step the common point moves equally far with both bodies, and the impulse acts at the mean of where
it was and where it comes to. The hinge then does no work at all: an energy-momentum method (Simo & Wong
1991, IJNME 31, 19; Gonzalez 1999, Physica D 132, 165), second order in the step. What remains of the rates
that would pull the point apart is projected out at the step's end, which can only take energy.
"""

import warp as wp

from polyworld.solver.planar.motion import shift_of
from polyworld.solver.planar.records import Bodies, Joints, Scene, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
RATE_SWEEPS = 300
POSE_SWEEPS = 50


@wp.func
def rotated(arm: wp.vec2d, angle: wp.float64) -> wp.vec2d:
    c = wp.cos(angle)
    s = wp.sin(angle)
    return wp.vec2d(c * arm[0] - s * arm[1], s * arm[0] + c * arm[1])


@wp.func
def mean_moment_arm(arm: wp.vec2d, angle: wp.float64, rotation: wp.float64) -> wp.vec2d:
    """Return the moment arm l for which rotating by `rotation` moves the tip by exactly rotation * (-l_y, l_x)."""
    x = HALF * rotation
    chord = ONE
    if x != ZERO:
        chord = wp.sin(x) / x
    return rotated(arm, angle + x) * chord


@wp.func
def tip(motion: wp.vec3d, moment_arm: wp.vec2d) -> wp.vec2d:
    """Return a body's rate, or small shift, at the end of a moment arm."""
    return wp.vec2d(motion[0] - motion[2] * moment_arm[1], motion[1] + motion[2] * moment_arm[0])


@wp.func
def impulse_response(
    change: wp.vec2d, moment_arm: wp.vec2d, inverse_mass: wp.float64, inverse_inertia: wp.float64
) -> wp.vec3d:
    """Return the change of a body's motion by an impulse at the end of a moment arm."""
    moment = moment_arm[0] * change[1] - moment_arm[1] * change[0]
    return wp.vec3d(inverse_mass * change[0], inverse_mass * change[1], inverse_inertia * moment)


@wp.func
def compliance(moment_arm: wp.vec2d, inverse_mass: wp.float64, inverse_inertia: wp.float64) -> wp.vec3d:
    """Return the motion of an arm's end per unit impulse there: xx, xy, yy of a symmetric matrix."""
    return wp.vec3d(
        inverse_mass + inverse_inertia * moment_arm[1] * moment_arm[1],
        -inverse_inertia * moment_arm[0] * moment_arm[1],
        inverse_mass + inverse_inertia * moment_arm[0] * moment_arm[0],
    )


@wp.func
def solve(k: wp.vec3d, gap: wp.vec2d) -> wp.vec2d:
    """Solve for the impulse that closes a gap of motions."""
    scale = -ONE / (k[0] * k[2] - k[1] * k[1])
    return wp.vec2d((k[2] * gap[0] - k[1] * gap[1]) * scale, (k[0] * gap[1] - k[1] * gap[0]) * scale)


@wp.func
def sign_of(e: wp.int32) -> wp.float64:
    """Return the sign of a hinge's impulse on end e: it acts on the second, its opposite on the first."""
    return wp.where(e == 0, -ONE, ONE)


@wp.func
def begin_hinges(scene: Scene, joints: wp.array[Joints], w: wp.int32, segment: wp.int32) -> None:
    """Activate the hinges whose bodies move in this segment."""
    for j in range(joints[0].count):
        joints[0].active[w, j] = wp.where(scene.schedule.joins[joints[0].body[j, 0]] <= segment, 1, 0)


@wp.func
def reach_pivot(bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, j: wp.int32) -> wp.vec3d:
    """Set the moment arms to the pivot at the current poses; return the compliance there."""
    k = wp.vec3d()
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            moment_arm = rotated(joints[0].arm[w, j, e], bodies[0].pose[w, i][2])
            joints[0].moment_arm[w, j, e] = moment_arm
            k += compliance(moment_arm, bodies[0].inverse_mass[w, i], bodies[0].inverse_inertia[w, i])
    return k


@wp.func
def project_hinge_rate(bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, j: wp.int32) -> wp.float64:
    """Remove the relative velocity at one pivot (Gauss-Seidel). Returns the one it found [m/s]."""
    if joints[0].active[w, j] == 0:
        return ZERO
    k = reach_pivot(bodies, joints, w, j)
    gap = wp.vec2d()
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            gap += tip(bodies[0].next_rate[w, i], joints[0].moment_arm[w, j, e]) * sign_of(e)
    p = solve(k, gap)
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            bodies[0].next_rate[w, i] = bodies[0].next_rate[w, i] + impulse_response(
                p * sign_of(e),
                joints[0].moment_arm[w, j, e],
                bodies[0].inverse_mass[w, i],
                bodies[0].inverse_inertia[w, i],
            )
    return wp.length(gap)


@wp.func
def project_hinge_rates(scene: Scene, bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32) -> None:
    """Project the rates onto those the hinges allow: the nearest in kinetic energy, so none is gained."""
    fastest = ZERO
    for i in range(scene.bodies):
        bodies[0].next_rate[w, i] = bodies[0].rate[w, i]
        fastest = wp.max(fastest, wp.length(bodies[0].rate[w, i]))
    for _ in range(RATE_SWEEPS):
        residual = ZERO
        for j in range(joints[0].count):
            residual = wp.max(residual, project_hinge_rate(bodies, joints, w, j))
        if residual <= wp.float64(1.0e-13) * fastest:
            break
    for i in range(scene.bodies):
        bodies[0].rate[w, i] = bodies[0].next_rate[w, i]


@wp.func
def mobility(bodies: wp.array[Bodies], w: wp.int32, i: wp.int32) -> wp.vec2d:
    """Return the change of `next_rate` (linear, angular) per unit impulse of a force, damped as all forces are."""
    return wp.vec2d(
        bodies[0].inverse_mass[w, i] * bodies[0].linear_decay[w, i][1],
        bodies[0].inverse_inertia[w, i] * bodies[0].angular_decay[w, i][1],
    )


@wp.func
def moved_by(bodies: wp.array[Bodies], w: wp.int32, i: wp.int32, h: wp.float64) -> wp.vec3d:
    """Return the change of a body's pose over h."""
    return shift_of(
        bodies[0].rate[w, i],
        bodies[0].next_rate[w, i],
        bodies[0].linear_decay[w, i],
        bodies[0].angular_decay[w, i],
        h,
    )


@wp.func
def warm_start_hinges(
    bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, ratio: wp.float64, h: wp.float64
) -> wp.float64:
    """Warm-start with the last step's impulses times `ratio`; return the speed scale of the hinged bodies[0]."""
    pushed = ZERO
    for j in range(joints[0].count):
        p = joints[0].impulse[w, j] * ratio
        joints[0].impulse[w, j] = p
        for e in range(joints[0].ends):
            i = joints[0].body[j, e]
            if i >= 0 and joints[0].active[w, j] == 1:
                joints[0].moment_arm[w, j, e] = wp.vec2d()  # the first visit moves the impulse out to the pivot
                change = p * (sign_of(e) * mobility(bodies, w, i)[0])
                bodies[0].next_rate[w, i] = bodies[0].next_rate[w, i] + wp.vec3d(change[0], change[1], ZERO)
                pushed = wp.max(pushed, wp.max(wp.length(bodies[0].push[w, i]) * h, wp.length(bodies[0].rate[w, i])))
    return pushed


@wp.func
def solve_hinge(
    bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, j: wp.int32, h: wp.float64
) -> wp.float64:
    """Solve one hinge (Gauss-Seidel): both ends move the pivot equally far. Returns the error [m/s]."""
    if joints[0].active[w, j] == 0:
        return ZERO
    p = joints[0].impulse[w, j]
    gap = wp.vec2d()
    k = wp.vec3d()
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            mobile = mobility(bodies, w, i)
            moment_arm = mean_moment_arm(joints[0].arm[w, j, e], bodies[0].pose[w, i][2], moved_by(bodies, w, i, h)[2])
            # The impulse so far moves to where the pivot now passes: the whole of it acts at one point.
            moved = moment_arm - joints[0].moment_arm[w, j, e]
            joints[0].moment_arm[w, j, e] = moment_arm
            twist = impulse_response(p * sign_of(e), moved, ZERO, mobile[1])
            bodies[0].next_rate[w, i] = bodies[0].next_rate[w, i] + twist
            gap += tip(moved_by(bodies, w, i, h), moment_arm) * sign_of(e)
            # From a change of rate to the change of the shift: see `shift_of`.
            k += compliance(
                moment_arm,
                mobile[0] * h * bodies[0].linear_decay[w, i][2],
                mobile[1] * h * bodies[0].angular_decay[w, i][2],
            )
    change = solve(k, gap)
    joints[0].impulse[w, j] = p + change
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            mobile = mobility(bodies, w, i)
            bodies[0].next_rate[w, i] = bodies[0].next_rate[w, i] + impulse_response(
                change * sign_of(e), joints[0].moment_arm[w, j, e], mobile[0], mobile[1]
            )
    return wp.length(gap) / h


@wp.func
def project_hinge(
    scene: Scene, bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, j: wp.int32
) -> wp.float64:
    """Project one hinge onto a common pivot (Gauss-Seidel). Returns a bound of how far a point moved [m]."""
    if joints[0].active[w, j] == 0:
        return ZERO
    k = reach_pivot(bodies, joints, w, j)
    gap = joints[0].anchor[w, j]
    if joints[0].body[j, 1] >= 0:
        gap = wp.vec2d()
    size = ZERO
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            pose = bodies[0].pose[w, i]
            moment_arm = joints[0].moment_arm[w, j, e]
            gap += (wp.vec2d(pose[0], pose[1]) + moment_arm) * sign_of(e)
            size += wp.abs(pose[0]) + wp.abs(pose[1]) + wp.length(moment_arm)
    if not wp.length(gap) > wp.float64(1.0e-14) * size:  # rounding
        return ZERO
    p = solve(k, gap)
    moved = ZERO
    for e in range(joints[0].ends):
        i = joints[0].body[j, e]
        if i >= 0:
            change = impulse_response(
                p * sign_of(e),
                joints[0].moment_arm[w, j, e],
                bodies[0].inverse_mass[w, i],
                bodies[0].inverse_inertia[w, i],
            )
            bodies[0].pose[w, i] = bodies[0].pose[w, i] + change
            moved += wp.abs(change[0]) + wp.abs(change[1]) + wp.abs(change[2]) * scene.bound[i]
    return moved


@wp.func
def project_hinges(scene: Scene, bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32) -> wp.float64:
    """Project the hinges that rounding, a step cut short or a parted overlap has opened; velocities stay.

    Returns a bound of how far any point moved [m].
    """
    total = ZERO
    for _ in range(POSE_SWEEPS):
        moved = ZERO
        for j in range(joints[0].count):
            moved += project_hinge(scene, bodies, joints, w, j)
        total += moved
        if moved == ZERO:
            break
    return total


@wp.func
def hold_hinges(scene: Scene, bodies: wp.array[Bodies], joints: wp.array[Joints], step: Step) -> None:
    """Project poses and rates onto the hinges at the end of a part of a step."""
    moved = project_hinges(scene, bodies, joints, step.w)
    for i in range(scene.bodies):
        bodies[0].margin[step.w, i] = bodies[0].margin[step.w, i] - moved
        bodies[0].path[step.w, i] = bodies[0].path[step.w, i] + moved
    project_hinge_rates(scene, bodies, joints, step.w)
