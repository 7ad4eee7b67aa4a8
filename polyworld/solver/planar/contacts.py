"""The contact search: near pairs, and the rows of those that touch."""

import warp as wp

from polyworld.solver.core.contact_coefficients import of_contact
from polyworld.solver.planar.records import Bodies, Contacts, Row, Samples, Scene, Step
from polyworld.solver.planar.rows import SLOW
from polyworld.solver.planar.separation import find_manifold

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
FAR = wp.float64(1.0e30)
STEPS = wp.float64(4.0)  # for which the near list holds at the present speeds


@wp.func
def set_margins(scene: wp.array[Scene], bodies: wp.array[Bodies], step: Step) -> None:
    """Set how far each body may move until the near list is renewed again [m]."""
    for m in range(step.members):
        i = bodies[0].members[step.w, m]
        v = bodies[0].rate[step.w, i]
        push = bodies[0].push[step.w, i]
        speed = wp.sqrt(v[0] * v[0] + v[1] * v[1]) + wp.length(push) * step.whole
        bodies[0].room[step.w, i] = wp.vec2d(ZERO, HALF * scene[0].skin + STEPS * speed * step.whole)


@wp.func(inline=False)
def find_near(scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], step: Step) -> wp.int32:
    """List the pairs whose bounding circles are nearer than their margins, a < b in ascending order; return how many.

    Rows that pairs have stay with them.
    """
    w = step.w
    slot = step.slot
    n = scene[0].bodies
    kept = wp.int32(0)
    for k in range(step.near):
        if contacts[0].row_at[slot, k] >= 0 and contacts[0].row_count[slot, k] > 0:
            contacts[0].kept[slot, kept] = contacts[0].near[slot, k]
            contacts[0].kept_rows[slot, kept] = wp.vec2i(contacts[0].row_at[slot, k], contacts[0].row_count[slot, k])
            kept += 1
    count = wp.int32(0)
    following = wp.int32(0)
    for a in range(n):
        if scene[0].schedule.joins[a] <= step.segment:
            pa = bodies[0].pose[w, a]
            for b in range(a + 1, n + scene[0].statics):
                if scene[0].collides[a, b] != 0:
                    gap = FAR
                    reach = bodies[0].room[w, a][1]
                    if b >= n and scene[0].first[b + 1] == scene[0].first[b]:
                        pb = bodies[0].static_pose[w, b - n]
                        gap = pb[0] * pa[0] + pb[1] * pa[1] - pb[2] - scene[0].bound[a]
                    else:
                        joined = True
                        pb = wp.vec3d()
                        if b < n:
                            pb = bodies[0].pose[w, b]
                            reach += bodies[0].room[w, b][1]
                            joined = scene[0].schedule.joins[b] <= step.segment
                        else:
                            pb = bodies[0].static_pose[w, b - n]
                        x = pb[0] - pa[0]
                        y = pb[1] - pa[1]
                        far = reach + scene[0].bound[a] + scene[0].bound[b]
                        if joined and x * x + y * y < far * far:
                            gap = wp.sqrt(x * x + y * y) - scene[0].bound[a] - scene[0].bound[b]
                    if gap < reach:
                        contacts[0].near[slot, count] = wp.vec2i(a, b)
                        contacts[0].near_gap[slot, count] = gap
                        contacts[0].row_at[slot, count] = -1
                        searching = wp.int32(1)
                        while searching == 1 and following < kept:
                            pair = contacts[0].kept[slot, following]
                            if pair[0] > a or (pair[0] == a and pair[1] > b):
                                searching = wp.int32(0)
                            else:
                                if pair[0] == a and pair[1] == b:
                                    contacts[0].row_at[slot, count] = contacts[0].kept_rows[slot, following][0]
                                    contacts[0].row_count[slot, count] = contacts[0].kept_rows[slot, following][1]
                                following += 1
                        count += 1
    return count


@wp.func
def make_row(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    w: wp.int32,
    pair: wp.vec2i,
    normal: wp.vec2d,
    point: wp.vec2d,
    gap: wp.float64,
) -> Row:
    """Return the row of a point at which a pair touches, or will soon."""
    a = pair[0]
    b = pair[1]
    row = Row()
    row.a = a
    row.b = b
    row.normal = normal
    row.gap = gap
    row.touching = wp.where(gap <= scene[0].touch, 1, 0)
    pa = bodies[0].pose[w, a]
    row.arm_a = wp.vec2d(point[0] - pa[0], point[1] - pa[1])
    ta = row.arm_a[0] * normal[0] + row.arm_a[1] * normal[1]
    na = row.arm_a[0] * normal[1] - row.arm_a[1] * normal[0]
    ia = bodies[0].inverse_inertia[w, a]
    k_normal = bodies[0].inverse_mass[w, a] + ia * na * na
    k_tangent = bodies[0].inverse_mass[w, a] + ia * ta * ta
    coupling = ia * na * ta
    nb = ZERO
    tb = ZERO
    k_roll = ia
    rolling = bodies[0].rolling[w, a]
    if b < scene[0].bodies:
        pb = bodies[0].pose[w, b]
        row.arm_b = wp.vec2d(point[0] - pb[0], point[1] - pb[1])
        tb = row.arm_b[0] * normal[0] + row.arm_b[1] * normal[1]
        nb = row.arm_b[0] * normal[1] - row.arm_b[1] * normal[0]
        ib = bodies[0].inverse_inertia[w, b]
        k_normal += bodies[0].inverse_mass[w, b] + ib * nb * nb
        k_tangent += bodies[0].inverse_mass[w, b] + ib * tb * tb
        coupling += ib * nb * tb
        k_roll += ib
        rolling = wp.max(rolling, bodies[0].rolling[w, b])
    row.levers = wp.vec4d(na, nb, ta, tb)
    row.compliance = wp.vec3d(k_normal, k_tangent, k_roll)
    row.mass = wp.vec3d(ONE / k_normal, ONE / k_tangent, ONE / k_roll)
    row.coupling = coupling
    row.friction = of_contact(bodies[0].friction[w, a], bodies[0].friction[w, b])
    row.restitution = of_contact(bodies[0].restitution[w, a], bodies[0].restitution[w, b])
    row.rolling = rolling
    return row


@wp.func
def pose_of(scene: wp.array[Scene], bodies: wp.array[Bodies], w: wp.int32, i: wp.int32) -> wp.vec3d:
    """Return the pose of a body or static."""
    if i >= scene[0].bodies:
        return bodies[0].static_pose[w, i - scene[0].bodies]
    return bodies[0].pose[w, i]


@wp.func
def discs(scene: wp.array[Scene], a: wp.int32, b: wp.int32) -> bool:
    """Check whether one of a pair is a disc: the two then touch at one point."""
    return scene[0].first[a + 1] - scene[0].first[a] == 1 or scene[0].first[b + 1] - scene[0].first[b] == 1


@wp.func(inline=False)
def find_rows(
    scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], samples: Samples, step: Step
) -> wp.vec3i:
    """Make the contact rows of the members' pairs that touch, or nearly; begin with the impulses of their last rows.

    The part of all bodies writes to the other half of the rows; a later part replaces the rows of its island.
    Returns which half of the rows is this step's, how many it has, and how many are of this part.
    """
    w = step.w
    slot = step.slot
    half = wp.int32(step.half)
    rows = wp.int32(step.rows)
    active = wp.int32(0)
    from_half = wp.int32(half)
    if step.everyone == 1:
        half = 1 - half
        rows = wp.int32(0)
    n = scene[0].bodies
    capacity = contacts[0].rows.shape[2]
    reach = step.reach
    for k in range(step.near):
        pair = contacts[0].near[slot, k]
        a = pair[0]
        b = pair[1]
        own = step.everyone
        if own == 0 and bodies[0].member[w, a] == 1:
            own = wp.int32(1)
            if b < n:
                own = bodies[0].member[w, b]
        path = bodies[0].room[w, a][0]
        if b < n:
            path += bodies[0].room[w, b][0]
        nearer = contacts[0].near_gap[slot, k] - path <= reach
        if own == 1 and (nearer or contacts[0].row_at[slot, k] >= 0):
            # What the pair's last rows hold, before they are replaced.
            last = contacts[0].row_at[slot, k]
            last_count = wp.int32(0)
            if last >= 0:
                last_count = contacts[0].row_count[slot, k]
            first_force = wp.vec3d()
            first_arm = wp.vec2d()
            second_force = wp.vec3d()
            second_arm = wp.vec2d()
            for j in range(last_count):
                arm = contacts[0].rows[slot, from_half, last + j].arm_a
                force = contacts[0].rows[slot, from_half, last + j].force
                force = force * (step.h / contacts[0].rows[slot, from_half, last + j].span)
                if j == 0:
                    first_arm = arm
                    first_force = force
                else:
                    second_arm = arm
                    second_force = force
                contacts[0].rows[slot, from_half, last + j].touching = -1
            if step.everyone == 1:
                last = -1
            count = wp.int32(0)
            if nearer:
                pose_b = pose_of(scene, bodies, w, b)
                m = find_manifold(scene, bodies, w, a, bodies[0].pose[w, a], b, pose_b)
                gap = wp.min(m.gap0, m.gap1)
                contacts[0].near_gap[slot, k] = gap + path
                if gap <= reach:
                    count = m.count
                    if last < 0:
                        # Room for as many points as the pair may ever touch with.
                        most = wp.where(discs(scene, a, b), 1, 2)
                        if rows + most <= capacity:
                            last = rows
                            rows += most
                            contacts[0].rows[slot, half, last + most - 1].touching = -1
                        else:
                            if samples.outcome.overflowed[w] == 0:
                                samples.outcome.diverged_time[w] = step.time
                            samples.outcome.overflowed[w] = 1
                            count = wp.int32(0)
                    for j in range(count):
                        point = m.point0
                        point_gap = m.gap0
                        if j == 1:
                            point = m.point1
                            point_gap = m.gap1
                        row = make_row(scene, bodies, w, pair, m.normal, point, point_gap)
                        row.slot = k
                        row.span = step.h
                        contacts[0].rows[slot, half, last + j] = row
                        contacts[0].active[slot, active] = last + j
                        active += 1
                    for j in range(wp.min(last_count, 2 * count)):
                        arm = wp.where(j == 0, first_arm, second_arm)
                        target = last
                        if count == 2:
                            to_first = wp.length(arm - contacts[0].rows[slot, half, last].arm_a)
                            if wp.length(arm - contacts[0].rows[slot, half, last + 1].arm_a) < to_first:
                                target = last + 1
                        contacts[0].rows[slot, half, target].force = contacts[0].rows[
                            slot, half, target
                        ].force + wp.where(j == 0, first_force, second_force)
            contacts[0].row_at[slot, k] = last
            contacts[0].row_count[slot, k] = count
    return wp.vec3i(half, rows, active)


@wp.func
def find_contacts(
    scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], samples: Samples, step: Step
) -> Step:
    """Find the contact rows of a part, and first the near pairs where the bodies may leave their margins."""
    if step.renew == 1 and step.everyone == 1:
        set_margins(scene, bodies, step)
        step.near = find_near(scene, bodies, contacts, step)
        step.renew = 0
        step.lost = 0
        step.slack = -ONE
    # Slower than what does not bounce, a gap wider than this is not closed within the step.
    step.reach = scene[0].touch
    if step.heaviest > ZERO:
        step.reach = step.reach + step.whole * (step.whole * step.heaviest + SLOW)
    step.active = 0
    if step.everyone == 1 and step.slack > step.reach:  # nothing is near, nor was in the last step
        step.rows = 0
    else:
        found = find_rows(scene, bodies, contacts, samples, step)
        step.half = found[0]
        step.rows = found[1]
        step.active = found[2]
    return step
