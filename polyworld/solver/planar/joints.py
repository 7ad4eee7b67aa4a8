"""Hinges: two bodies, or a body and the world, keep a common point.

Over a step the common point moves equally far with both bodies, and the impulse acts at the mean of where
it was and where it comes to. The hinge then does no work at all: an energy-momentum method (Simo & Wong
1991, IJNME 31, 19; Gonzalez 1999, Physica D 132, 165), second order in the step. What remains of the rates
that would pull the point apart is projected out at the step's end, which can only take energy.
All hinges are solved for together, by Newton's method: the mean depends on where the bodies come to.
"""

import warp as wp

from polyworld.solver.planar.hinge_system import factorise_hinges, find_gaps, sign_of, solve_hinge_system
from polyworld.solver.planar.motion import shift_of
from polyworld.solver.planar.records import Bodies, Joints, Scene, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
PASSES = 10  # in which poses, and rates, are projected; two do unless hinges have opened far


@wp.func
def rotated(arm: wp.vec2d, heading: wp.vec2d) -> wp.vec2d:
    """Return an arm turned by the angle whose cosine and sine are given."""
    return wp.vec2d(heading[0] * arm[0] - heading[1] * arm[1], heading[1] * arm[0] + heading[0] * arm[1])


@wp.func
def mean_heading(heading: wp.vec2d, rotation: wp.float64) -> wp.vec2d:
    """Return the vector t by which arms are turned so that the tip moves by exactly rotation * (-l_y, l_x)."""
    x = HALF * rotation
    s = wp.sin(x)
    chord = ONE
    if x != ZERO:
        chord = s / x
    return rotated(heading, wp.vec2d(wp.cos(x), s)) * chord


@wp.func
def begin_hinges(scene: Scene, joints: wp.array[Joints], w: wp.int32, segment: wp.int32) -> None:
    """Activate the hinges whose bodies move in this segment."""
    for j in range(joints[0].count):
        joints[0].active[w, j] = wp.where(scene.schedule.joins[joints[0].body[j, 0]] <= segment, 1, 0)


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
def reach_pivots(bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, slot: wp.int32) -> None:
    """Set the moment arms to the pivots at the current poses."""
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        angle = bodies[0].pose[w, i][2]
        joints[0].heading[slot, i] = wp.vec2d(wp.cos(angle), wp.sin(angle))
    for j in range(joints[0].count):
        for e in range(joints[0].ends):
            i = joints[0].body[j, e]
            if i >= 0:
                joints[0].moment_arm[w, j, e] = rotated(joints[0].arm[w, j, e], joints[0].heading[slot, i])


@wp.func(inline=False)
def factorise_at_pose(bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, slot: wp.int32) -> None:
    """Factorise the matrix for blows at the current poses."""
    reach_pivots(bodies, joints, w, slot)
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        joints[0].mobility[slot, i] = wp.vec2d(bodies[0].inverse_mass[w, i], bodies[0].inverse_inertia[w, i])
    factorise_hinges(joints, w, slot)


@wp.func
def apply_changes(joints: wp.array[Joints], motion: wp.array[wp.vec3d], w: wp.int32, slot: wp.int32) -> None:
    """Change motions by the impulses just solved for."""
    for j in range(joints[0].count):
        if joints[0].active[w, j] == 1:
            for e in range(joints[0].ends):
                i = joints[0].body[j, e]
                if i >= 0:
                    p = joints[0].change[slot, j] * sign_of(e)
                    arm = joints[0].moment_arm[w, j, e]
                    m = joints[0].mobility[slot, i]
                    motion[i] = motion[i] + wp.vec3d(m[0] * p[0], m[0] * p[1], m[1] * (arm[0] * p[1] - arm[1] * p[0]))


@wp.func(inline=False)
def project_hinge_rates(joints: wp.array[Joints], rates: wp.array[wp.vec3d], w: wp.int32, slot: wp.int32) -> wp.float64:
    """Project rates onto those the hinges allow: the nearest in kinetic energy, so none is gained.

    The matrix is factorised at the pose. Returns the largest relative velocity found at a pivot [m/s].
    """
    residual = find_gaps(joints, rates, w, slot)
    if residual > ZERO:
        solve_hinge_system(joints, slot)
        apply_changes(joints, rates, w, slot)
    return residual


@wp.func
def warm_start_hinges(
    bodies: wp.array[Bodies],
    joints: wp.array[Joints],
    w: wp.int32,
    slot: wp.int32,
    ratio: wp.float64,
    h: wp.float64,
) -> wp.float64:
    """Warm-start with the last step's impulses times `ratio`; return the speed scale of the hinged bodies."""
    pushed = ZERO
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        angle = bodies[0].pose[w, i][2]
        joints[0].heading[slot, i] = wp.vec2d(wp.cos(angle), wp.sin(angle))
        joints[0].rotation[slot, i] = bodies[0].rate[w, i][2] * h
    for j in range(joints[0].count):
        was = joints[0].impulse[w, j]
        # The change of the last step goes on, where the steps are equally long.
        p = was * ratio
        if wp.abs(ratio - ONE) < wp.float64(1.0e-6):
            p = p + (was - joints[0].last_impulse[w, j]) * ratio
        joints[0].last_impulse[w, j] = was * ratio
        joints[0].impulse[w, j] = p
        for e in range(joints[0].ends):
            i = joints[0].body[j, e]
            if i >= 0 and joints[0].active[w, j] == 1:
                joints[0].moment_arm[w, j, e] = wp.vec2d()  # the first iteration moves the impulse out to the pivot
                change = p * (sign_of(e) * bodies[0].inverse_mass[w, i] * bodies[0].linear_decay[w, i][1])
                bodies[0].next_rate[w, i] = bodies[0].next_rate[w, i] + wp.vec3d(change[0], change[1], ZERO)
                pushed = wp.max(pushed, wp.max(wp.length(bodies[0].push[w, i]) * h, wp.length(bodies[0].rate[w, i])))
    return pushed


@wp.func(inline=False)
def solve_hinges(
    bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, slot: wp.int32, h: wp.float64
) -> wp.float64:
    """Iterate once by Newton's method for impulses by which both ends of each hinge move equally far.

    The moment arms are the means over the rotations expected. Where these change, the impulses so far move with them
    and turn the bodies: a pull at a hinge resists rotation as inertia does. Returns the largest error [m/s].
    """
    rotation = joints[0].rotation[slot]
    motion = joints[0].motion[slot]
    mobility = joints[0].mobility[slot]
    rates = bodies[0].next_rate[w]
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        joints[0].mean_heading[slot, i] = mean_heading(joints[0].heading[slot, i], rotation[i])
        joints[0].load[slot, i] = wp.vec2d()
    for j in range(joints[0].count):
        if joints[0].active[w, j] == 1:
            for e in range(joints[0].ends):
                i = joints[0].body[j, e]
                if i >= 0:
                    p = joints[0].impulse[w, j] * sign_of(e)
                    arm = rotated(joints[0].arm[w, j, e], joints[0].mean_heading[slot, i])
                    moved = arm - joints[0].moment_arm[w, j, e]
                    joints[0].moment_arm[w, j, e] = arm
                    joints[0].load[slot, i] = joints[0].load[slot, i] + wp.vec2d(
                        wp.dot(p, arm), moved[0] * p[1] - moved[1] * p[0]
                    )
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        linear = bodies[0].linear_decay[w, i]
        angular = bodies[0].angular_decay[w, i]
        turned = bodies[0].inverse_inertia[w, i] * angular[1]
        load = joints[0].load[slot, i]
        rates[i] = rates[i] + wp.vec3d(ZERO, ZERO, turned * load[1])
        m = moved_by(bodies, w, i, h)
        # From a change of rate to the change of the shift: see `shift_of`.
        turning = turned * h * angular[2]
        share = ONE / (ONE + wp.max(HALF * turning * load[0], -HALF))
        mobility[i] = wp.vec2d(bodies[0].inverse_mass[w, i] * linear[1] * h * linear[2], turning * share)
        motion[i] = wp.vec3d(m[0], m[1], rotation[i] + (m[2] - rotation[i]) * share)
    factorise_hinges(joints, w, slot)
    residual = find_gaps(joints, motion, w, slot)
    for j in range(joints[0].count):
        joints[0].kept[slot, j] = joints[0].impulse[w, j]
    solve_hinge_system(joints, slot)
    apply_changes(joints, motion, w, slot)
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        rotation[i] = motion[i][2]
    for j in range(joints[0].count):
        if joints[0].active[w, j] == 1:
            change = joints[0].change[slot, j]
            joints[0].impulse[w, j] = joints[0].impulse[w, j] + change
            for e in range(joints[0].ends):
                i = joints[0].body[j, e]
                if i >= 0:
                    p = change * sign_of(e)
                    arm = joints[0].moment_arm[w, j, e]
                    drawn = bodies[0].inverse_mass[w, i] * bodies[0].linear_decay[w, i][1]
                    twisted = bodies[0].inverse_inertia[w, i] * bodies[0].angular_decay[w, i][1]
                    rates[i] = rates[i] + wp.vec3d(
                        drawn * p[0], drawn * p[1], twisted * (arm[0] * p[1] - arm[1] * p[0])
                    )
    return residual / h


@wp.func
def find_openings(bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, slot: wp.int32) -> wp.int32:
    """Set the right-hand side to minus how far the hinges have opened; return whether one has, beyond rounding."""
    opened = wp.int32(0)
    for j in range(joints[0].count):
        gap = wp.vec2d()
        if joints[0].active[w, j] == 1:
            if joints[0].body[j, 1] < 0:
                gap = joints[0].anchor[w, j]
            size = ZERO
            for e in range(joints[0].ends):
                i = joints[0].body[j, e]
                if i >= 0:
                    pose = bodies[0].pose[w, i]
                    moment_arm = joints[0].moment_arm[w, j, e]
                    gap += (wp.vec2d(pose[0], pose[1]) + moment_arm) * sign_of(e)
                    size += wp.abs(pose[0]) + wp.abs(pose[1]) + wp.length(moment_arm)
            if wp.length(gap) > wp.float64(1.0e-14) * size:  # rounding
                opened = wp.int32(1)
        joints[0].change[slot, j] = -gap
        joints[0].kept[slot, j] = wp.vec2d()
    return opened


@wp.func(inline=False)
def project_hinges(
    scene: wp.array[Scene], bodies: wp.array[Bodies], joints: wp.array[Joints], w: wp.int32, slot: wp.int32
) -> wp.float64:
    """Project the hinges that rounding, a step cut short or a parted overlap has opened; velocities stay.

    Returns a bound of how far any point moved [m]. Leaves the matrix factorised at the poses.
    """
    total = ZERO
    for _ in range(PASSES):
        factorise_at_pose(bodies, joints, w, slot)
        if find_openings(bodies, joints, w, slot) == 0:
            break
        solve_hinge_system(joints, slot)
        for b in range(joints[0].bodies.shape[0]):
            joints[0].motion[slot, joints[0].bodies[b]] = wp.vec3d()
        apply_changes(joints, joints[0].motion[slot], w, slot)
        for b in range(joints[0].bodies.shape[0]):
            i = joints[0].bodies[b]
            change = joints[0].motion[slot, i]
            bodies[0].pose[w, i] = bodies[0].pose[w, i] + change
            total += wp.abs(change[0]) + wp.abs(change[1]) + wp.abs(change[2]) * scene[0].bound[i]
    return total


@wp.func
def hold_hinges(scene: wp.array[Scene], bodies: wp.array[Bodies], joints: wp.array[Joints], step: Step) -> wp.float64:
    """Project poses and rates onto the hinges at the end of a part of a step; return how far points moved, at most."""
    moved = project_hinges(scene, bodies, joints, step.w, step.slot)
    fastest = ZERO
    for b in range(joints[0].bodies.shape[0]):
        i = joints[0].bodies[b]
        if moved > ZERO:
            bodies[0].room[step.w, i] = bodies[0].room[step.w, i] + wp.vec2d(moved, -moved)
        fastest = wp.max(fastest, wp.length(bodies[0].rate[step.w, i]))
    for _ in range(PASSES):
        if project_hinge_rates(joints, bodies[0].rate[step.w], step.w, step.slot) <= wp.float64(1.0e-13) * fastest:
            break
    return moved
