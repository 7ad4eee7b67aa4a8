"""When, within a step, the next pair touches: bodies that are fast or thin cannot pass through each other."""

import warp as wp

from polyworld.solver.planar.motion import pose_at
from polyworld.solver.planar.records import Bodies, Contacts, Scene, Step
from polyworld.solver.planar.separation import find_manifold

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
EIGHT = wp.float64(8.0)
MOST_PARTS = 64  # into which impacts may cut a step
MARCHES = 1_000_000  # a body of 1 cm is followed for 30 m along another that it all but touches, in one step


@wp.func
def gap_at(
    scene: Scene, bodies: Bodies, w: wp.int32, a: wp.int32, b: wp.int32, time: wp.float64, h: wp.float64
) -> wp.float64:
    m = find_manifold(
        scene, bodies, w, a, pose_at(scene, bodies, w, a, time, h), b, pose_at(scene, bodies, w, b, time, h)
    )
    return wp.min(m.gap0, m.gap1)


@wp.func
def path_bound(scene: Scene, bodies: Bodies, w: wp.int32, a: wp.int32, b: wp.int32, h: wp.float64) -> wp.float64:
    """No point of a moves further than this against b during the step [m]."""
    # Along a quadratic path the rate runs between that at the start and that at the end.
    first = bodies.rate[w, a]
    last = bodies.shift[w, a] * (wp.float64(2.0) / h) - first
    spin = wp.max(wp.abs(first[2]), wp.abs(last[2])) * (scene.bound[a] - scene.sweep[a])
    if b < scene.bodies:
        first_b = bodies.rate[w, b]
        last_b = bodies.shift[w, b] * (wp.float64(2.0) / h) - first_b
        spin += wp.max(wp.abs(first_b[2]), wp.abs(last_b[2])) * (scene.bound[b] - scene.sweep[b])
        first = first - first_b
        last = last - last_b
    speed2 = wp.max(first[0] * first[0] + first[1] * first[1], last[0] * last[0] + last[1] * last[1])
    return (wp.sqrt(speed2) + spin) * h


@wp.func
def first_touch(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    w: wp.int32,
    slot: wp.int32,
    bound: wp.float64,
    h: wp.float64,
    until: wp.float64,
) -> wp.float64:
    """First time in 0..until at which a near pair touches; h + 1 if it does not. Notes the pair's gap at time 0.

    Marches so far at a time that the pair cannot pass through, nor two discs graze by more than `touch` unseen, then
    closes in by regula falsi (Illinois) on the middle of the contact band 0..touch.
    """
    a = contacts.near[w, slot][0]
    b = contacts.near[w, slot][1]
    # The chord of a circle of the lesser radius that is as high as the contact band: on a path no longer than that, two
    # discs overlap by no more. (About one disc, the circle that another's centre may not enter is larger.)
    radius = scene.bound[a]
    leap = scene.depth[a]
    if scene.first[b + 1] > scene.first[b]:
        radius = wp.min(radius, scene.bound[b])
        leap = wp.min(leap, scene.depth[b])
    leap = wp.min(leap, wp.sqrt(EIGHT * radius * scene.touch))
    close = HALF * HALF * scene.touch
    time = ZERO
    early = ZERO
    late = until
    early_offset = ZERO
    late_offset = ZERO
    bracketed = wp.int32(0)
    side = wp.int32(0)
    for _ in range(MARCHES):
        gap = gap_at(scene, bodies, w, a, b, time, h)
        if gap != gap:  # not a number: the world is about to be stopped as diverged
            return h + ONE
        offset = gap - HALF * scene.touch
        if time == ZERO:
            contacts.near_gap[w, slot] = gap
            if bound < gap - scene.touch:
                return h + ONE
        if bracketed == 0 and gap > scene.touch:
            if time >= until:
                return h + ONE
            early = time
            early_offset = offset
            time = wp.min(until, time + h * (gap + leap) / bound)
        else:
            within = bracketed == 0 and offset > ZERO  # nearer than `touch` already, and perhaps never nearer
            if within or wp.abs(offset) < close or late - early < wp.float64(1.0e-15) * h:
                return time
            if bracketed == 0 or offset <= ZERO:
                late = time
                late_offset = offset
                if side == -1:
                    early_offset = early_offset * HALF
                side = wp.int32(-1)
            else:
                early = time
                early_offset = offset
                if side == 1:
                    late_offset = late_offset * HALF
                side = wp.int32(1)
            bracketed = wp.int32(1)
            time = (early_offset * late - late_offset * early) / (early_offset - late_offset)
    return h + ONE


@wp.func
def next_impact(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step, reach: wp.float64) -> wp.float64:
    """Time of the first new contact within a step of length h whose paths are set; h if there is none.

    No two points of any pair approach by more than `reach` in the step.
    """
    w = step.w
    h = step.h
    time = h
    for k in range(step.near):
        gap = contacts.near_gap[w, k]
        if gap > scene.touch:
            pair = contacts.near[w, k]
            a = pair[0]
            b = pair[1]
            if reach >= gap - scene.touch:
                bound = path_bound(scene, bodies, w, a, b, h)
                if bound >= gap - scene.touch:
                    time = wp.min(time, first_touch(scene, bodies, contacts, w, k, bound, h, time))
    # The second corner of a pair that touches with one: its gap along the normal, to second order.
    for k in range(step.rows):
        row = contacts.rows[w, step.half, k]
        if row.touching == 0 and row.gap > scene.touch:
            va = bodies.rate[w, row.a]
            sa = bodies.shift[w, row.a]
            speed = -(row.normal[0] * (va[0] - va[2] * row.arm_a[1]) + row.normal[1] * (va[1] + va[2] * row.arm_a[0]))
            move = -(row.normal[0] * (sa[0] - sa[2] * row.arm_a[1]) + row.normal[1] * (sa[1] + sa[2] * row.arm_a[0]))
            if row.b < scene.bodies:
                vb = bodies.rate[w, row.b]
                sb = bodies.shift[w, row.b]
                speed += row.normal[0] * (vb[0] - vb[2] * row.arm_b[1]) + row.normal[1] * (vb[1] + vb[2] * row.arm_b[0])
                move += row.normal[0] * (sb[0] - sb[2] * row.arm_b[1]) + row.normal[1] * (sb[1] + sb[2] * row.arm_b[0])
            if row.gap + move < ZERO:
                # gap + speed t + bend t^2 = touch / 2
                bend = (move - speed * h) / (h * h)
                c = row.gap - HALF * scene.touch
                root = wp.sqrt(wp.max(ZERO, speed * speed - wp.float64(4.0) * bend * c))
                t = wp.float64(2.0) * c / (root - speed)
                if t > ZERO and t < time:
                    time = t
    return time


@wp.func
def longest_path(scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32, h: wp.float64) -> wp.float64:
    """No point of body i moves further than this during the step whose path is set [m]."""
    first = bodies.rate[w, i]
    last = bodies.shift[w, i] * (wp.float64(2.0) / h) - first
    spin = wp.max(wp.abs(first[2]), wp.abs(last[2])) * (scene.bound[i] - scene.sweep[i])
    speed2 = wp.max(first[0] * first[0] + first[1] * first[1], last[0] * last[0] + last[1] * last[1])
    return (wp.sqrt(speed2) + spin) * h


@wp.func
def time_to_impact(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step) -> wp.float64:
    """Return how much of a step may be taken before the next impact; near pairs come closer by at most their motion."""
    reach = ZERO
    for i in range(scene.bodies):
        if scene.schedule.joins[i] <= step.segment:
            reach = wp.max(reach, TWO * longest_path(scene, bodies, step.w, i, step.h))
    part = step.h
    if step.parts < MOST_PARTS:
        part = next_impact(scene, bodies, contacts, step, reach)
    for k in range(step.near):  # the gaps stay lower bounds
        contacts.near_gap[step.w, k] = contacts.near_gap[step.w, k] - reach * (part / step.h)
    return part
