"""The contact search: near pairs, and the rows of those that touch."""

import warp as wp

from polyworld.solver.core.contact_coefficients import of_contact
from polyworld.solver.planar.motion import pose_at
from polyworld.solver.planar.records import Bodies, Contacts, Row, Samples, Scene, Step
from polyworld.solver.planar.separation import find_manifold

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
FAR = wp.float64(1.0e30)


@wp.func
def find_near(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step, reach: wp.float64) -> wp.int32:
    """List the pairs whose bounding circles are nearer than `reach`; returns how many."""
    w = step.w
    segment = step.segment
    n = scene.bodies
    count = wp.int32(0)
    for a in range(n):
        if scene.schedule.joins[a] <= segment:
            pa = bodies.pose[w, a]
            for b in range(a + 1, n + scene.statics):
                if scene.collides[a, b] != 0:
                    gap = -FAR
                    if b < n:
                        if scene.schedule.joins[b] <= segment:
                            pb = bodies.pose[w, b]
                            gap = wp.length(wp.vec2d(pb[0] - pa[0], pb[1] - pa[1])) - scene.bound[a] - scene.bound[b]
                        else:
                            gap = FAR
                    else:
                        pb = bodies.static_pose[w, b - n]
                        if scene.first[b + 1] == scene.first[b]:
                            gap = pb[0] * pa[0] + pb[1] * pa[1] - pb[2] - scene.bound[a]
                        else:
                            gap = wp.length(wp.vec2d(pb[0] - pa[0], pb[1] - pa[1])) - scene.bound[a] - scene.bound[b]
                    if gap < reach:
                        contacts.near[w, count] = wp.vec2i(a, b)
                        contacts.near_gap[w, count] = gap
                        count += 1
    return count


@wp.func
def make_row(
    scene: Scene, bodies: Bodies, w: wp.int32, pair: wp.vec2i, normal: wp.vec2d, point: wp.vec2d, gap: wp.float64
) -> Row:
    """Return the row of a point at which a pair touches, or will soon."""
    a = pair[0]
    b = pair[1]
    row = Row()
    row.a = a
    row.b = b
    row.normal = normal
    row.gap = gap
    row.touching = wp.where(gap <= scene.touch, 1, 0)
    pa = bodies.pose[w, a]
    row.arm_a = wp.vec2d(point[0] - pa[0], point[1] - pa[1])
    ta = row.arm_a[0] * normal[0] + row.arm_a[1] * normal[1]
    na = row.arm_a[0] * normal[1] - row.arm_a[1] * normal[0]
    ia = bodies.inverse_inertia[w, a]
    k_normal = bodies.inverse_mass[w, a] + ia * na * na
    k_tangent = bodies.inverse_mass[w, a] + ia * ta * ta
    k_roll = ia
    rolling = bodies.rolling[w, a]
    if b < scene.bodies:
        pb = bodies.pose[w, b]
        row.arm_b = wp.vec2d(point[0] - pb[0], point[1] - pb[1])
        tb = row.arm_b[0] * normal[0] + row.arm_b[1] * normal[1]
        nb = row.arm_b[0] * normal[1] - row.arm_b[1] * normal[0]
        ib = bodies.inverse_inertia[w, b]
        k_normal += bodies.inverse_mass[w, b] + ib * nb * nb
        k_tangent += bodies.inverse_mass[w, b] + ib * tb * tb
        k_roll += ib
        rolling = wp.max(rolling, bodies.rolling[w, b])
    row.mass_normal = ONE / k_normal
    row.mass_tangent = ONE / k_tangent
    row.mass_roll = ONE / k_roll
    row.friction = of_contact(bodies.friction[w, a], bodies.friction[w, b])
    row.restitution = of_contact(bodies.restitution[w, a], bodies.restitution[w, b])
    row.rolling = rolling
    return row


@wp.func
def find_rows(scene: Scene, bodies: Bodies, contacts: Contacts, samples: Samples, step: Step) -> wp.int32:
    """Contact rows of all touching pairs, started from the last step's impulses times `ratio`; returns how many.

    Of `step`, `rows` is still the number of the last step's.
    """
    w = step.w
    half = step.half
    old_count = step.rows
    ratio = step.ratio
    capacity = contacts.rows.shape[2]
    count = wp.int32(0)
    old = wp.int32(0)
    for k in range(step.near):
        if contacts.near_gap[w, k] <= scene.touch:
            pair = contacts.near[w, k]
            a = pair[0]
            b = pair[1]
            pose_a = bodies.pose[w, a]
            pose_b = pose_at(scene, bodies, w, b, ZERO, ONE)
            m = find_manifold(scene, bodies, w, a, pose_a, b, pose_b)
            gap = wp.min(m.gap0, m.gap1)
            contacts.near_gap[w, k] = gap
            if gap <= scene.touch:
                start = count
                for j in range(m.count):
                    if count < capacity:
                        point = m.point0
                        point_gap = m.gap0
                        if j == 1:
                            point = m.point1
                            point_gap = m.gap1
                        row = make_row(scene, bodies, w, pair, m.normal, point, point_gap)
                        row.slot = k
                        contacts.rows[w, half, count] = row
                        count += 1
                    else:
                        if samples.outcome.overflowed[w] == 0:
                            samples.outcome.diverged_time[w] = step.time
                        samples.outcome.overflowed[w] = 1
                # Both lists are in the order of the pairs, and a pair's points in the order of the tangent.
                searching = wp.int32(1)
                while searching == 1 and old < old_count:
                    was = contacts.rows[w, 1 - half, old]
                    if was.a > a or (was.a == a and was.b > b):
                        searching = wp.int32(0)
                    else:
                        if was.a == a and was.b == b:
                            target = start
                            if count - start == 2:
                                first = contacts.rows[w, half, start].arm_a
                                second = contacts.rows[w, half, start + 1].arm_a
                                if wp.length(was.arm_a - second) < wp.length(was.arm_a - first):
                                    target = start + 1
                            if target < count:
                                fresh = contacts.rows[w, half, target]
                                if fresh.touching == 1:
                                    fresh.impulse = fresh.impulse + was.impulse * ratio
                                    fresh.impulse_tangent = fresh.impulse_tangent + was.impulse_tangent * ratio
                                    fresh.impulse_roll = fresh.impulse_roll + was.impulse_roll * ratio
                                    contacts.rows[w, half, target] = fresh
                        old += 1
    return count


@wp.func
def find_contacts(scene: Scene, bodies: Bodies, contacts: Contacts, samples: Samples, step: Step) -> Step:
    """Find the contact rows of a step, and first the near pairs where the bodies may have left their room."""
    if step.room < TWO * step.fastest * step.h:
        step.room = scene.skin + wp.float64(8.0) * step.fastest * step.h
        step.near = find_near(scene, bodies, contacts, step, step.room)
    step.half = 1 - step.half
    step.ratio = step.h / step.last_h
    step.last_h = step.h
    step.rows = find_rows(scene, bodies, contacts, samples, step)
    return step
