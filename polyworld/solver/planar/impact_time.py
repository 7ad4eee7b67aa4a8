"""When, within a step, the next pair touches: bodies that are fast or thin cannot pass through each other."""

import warp as wp

from polyworld.solver.planar.motion import pose_at, rate_at
from polyworld.solver.planar.records import Bodies, Contacts, References, Scene, Step
from polyworld.solver.planar.rows import point_velocity, pushed_along, row_velocity, slow_approach
from polyworld.solver.planar.separation import Manifold, find_manifold

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
EIGHT = wp.float64(8.0)
FAR = wp.float64(1.0e30)
ROUNDING = wp.float64(1.0e-12)  # part of a step that is none
EFFORT, EFFORT_OF_BODY = 64, 2  # bodies solved for again in a step, in all and for each that there is
MOST_CUTS = 64  # impacts that may cut a body's path in a step
MARCHES = 1_000_000  # a body of 1 cm is followed for 30 m along another that it all but touches, in one step


@wp.func
def manifold_at(
    scene: Scene,
    bodies: Bodies,
    references: References,
    w: wp.int32,
    a: wp.int32,
    b: wp.int32,
    time: wp.float64,
    whole: wp.float64,
) -> Manifold:
    return find_manifold(
        references.scene,
        references.bodies,
        w,
        a,
        pose_at(scene, bodies, w, a, time, whole),
        b,
        pose_at(scene, bodies, w, b, time, whole),
    )


@wp.func
def last_rate(scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32, whole: wp.float64) -> wp.vec3d:
    """Rate at the end of a path; zero of a static."""
    if i >= scene.bodies:
        return wp.vec3d()
    return bodies.shift[w, i] * (TWO / (whole - bodies.since[w, i])) - bodies.rate[w, i]


@wp.func
def path_bound(
    scene: Scene, bodies: Bodies, w: wp.int32, a: wp.int32, b: wp.int32, begin: wp.float64, whole: wp.float64
) -> wp.float64:
    """No point of a moves further than this against b from `begin` to the end of the step [m]."""
    # Along quadratic paths the rates run between those at the start and those at the end.
    first = rate_at(scene, bodies, w, a, begin, whole)
    last = last_rate(scene, bodies, w, a, whole)
    spin = wp.max(wp.abs(first[2]), wp.abs(last[2])) * (scene.bound[a] - scene.sweep[a])
    if b < scene.bodies:
        first_b = rate_at(scene, bodies, w, b, begin, whole)
        last_b = last_rate(scene, bodies, w, b, whole)
        spin += wp.max(wp.abs(first_b[2]), wp.abs(last_b[2])) * (scene.bound[b] - scene.sweep[b])
        first = first - first_b
        last = last - last_b
    speed = wp.max(wp.length(wp.vec2d(first[0], first[1])), wp.length(wp.vec2d(last[0], last[1])))
    return (speed + spin) * (whole - begin)


@wp.func
def bounces(
    scene: Scene, bodies: Bodies, m: Manifold, w: wp.int32, a: wp.int32, b: wp.int32, time: wp.float64, step: Step
) -> bool:
    """Check whether a pair that touches at `time` approaches faster than what does not bounce.

    What does not needs no impact: it is kept apart as what touches is.
    """
    point = m.point0
    if m.gap1 < m.gap0:
        point = m.point1
    pose = pose_at(scene, bodies, w, a, time, step.whole)
    v = point_velocity(rate_at(scene, bodies, w, a, time, step.whole), wp.vec2d(point[0] - pose[0], point[1] - pose[1]))
    push = bodies.push[w, a]
    pushed = wp.abs(m.normal[0] * push[0] + m.normal[1] * push[1])
    if b < scene.bodies:
        pose = pose_at(scene, bodies, w, b, time, step.whole)
        v = v - point_velocity(
            rate_at(scene, bodies, w, b, time, step.whole), wp.vec2d(point[0] - pose[0], point[1] - pose[1])
        )
        push = bodies.push[w, b]
        pushed = wp.max(pushed, wp.abs(m.normal[0] * push[0] + m.normal[1] * push[1]))
    if pushed == ZERO:
        return True
    return wp.dot(m.normal, v) > slow_approach(step, pushed)


@wp.func
def first_touch(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    references: References,
    step: Step,
    k: wp.int32,
    bound: wp.float64,
) -> wp.float64:
    """When in the rest of the step a near pair first touches, FAR if it does not. `bound`: see `path_bound`.

    Marches so far at a time that the pair cannot pass through, nor two discs graze by more than `touch` unseen, then
    closes in by regula falsi (Illinois) on the middle of the contact band 0..touch.
    """
    w = step.w
    a = contacts.near[step.slot, k][0]
    b = contacts.near[step.slot, k][1]
    # The chord of a circle of the lesser radius that is as high as the contact band: on a path no longer than that, two
    # discs overlap by no more. (About one disc, the circle that another's centre may not enter is larger.)
    radius = scene.bound[a]
    leap = scene.depth[a]
    if scene.first[b + 1] > scene.first[b]:
        radius = wp.min(radius, scene.bound[b])
        leap = wp.min(leap, scene.depth[b])
    leap = wp.min(leap, wp.sqrt(EIGHT * radius * scene.touch))
    close = HALF * HALF * scene.touch
    time = step.begin
    early = time
    late = step.whole
    early_offset = ZERO
    late_offset = ZERO
    bracketed = wp.int32(0)
    side = wp.int32(0)
    for _ in range(MARCHES):
        m = manifold_at(scene, bodies, references, w, a, b, time, step.whole)
        gap = wp.min(m.gap0, m.gap1)
        if gap != gap:  # not a number: the world is about to be stopped as diverged
            return FAR
        offset = gap - HALF * scene.touch
        if time == step.begin:
            if step.everyone == 1:
                contacts.near_gap[step.slot, k] = gap + bodies.room[w, a][0]
                if b < scene.bodies:
                    contacts.near_gap[step.slot, k] = contacts.near_gap[step.slot, k] + bodies.room[w, b][0]
            if bound < gap - scene.touch:
                return FAR
        if bracketed == 0 and gap > scene.touch:
            if time >= step.whole:
                return FAR
            early = time
            early_offset = offset
            time = wp.min(step.whole, time + step.h * (gap + leap) / bound)
        else:
            within = bracketed == 0 and offset > ZERO  # nearer than `touch` already, and perhaps never nearer
            if within or wp.abs(offset) < close or late - early < wp.float64(1.0e-15) * step.whole:
                if bounces(scene, bodies, m, w, a, b, time, step):
                    return time
                return FAR
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
    return FAR


@wp.func
def second_touch(
    scene: Scene, bodies: Bodies, contacts: Contacts, references: References, step: Step, r: wp.int32
) -> wp.float64:
    """When in the rest of the step the second corner of a pair touches that touches with one; FAR if it does not.

    From its gap along the normal, to second order.
    """
    h = step.h
    gap = contacts.rows[step.slot, step.half, r].gap
    speed = row_velocity(references.scene, references.contacts, bodies.rate, step.w, step.slot, step.half, r)[0]
    move = row_velocity(references.scene, references.contacts, bodies.shift, step.w, step.slot, step.half, r)[0]
    if gap + move >= ZERO:
        return FAR
    # gap + speed t + bend t^2 = touch / 2
    bend = (move - speed * h) / (h * h)
    c = gap - HALF * scene.touch
    root = wp.sqrt(wp.max(ZERO, speed * speed - wp.float64(4.0) * bend * c))
    t = TWO * c / (root - speed)
    pushed = pushed_along(references.scene, references.bodies, references.contacts, step, r)
    if t > ZERO and t < h and (pushed == ZERO or -speed - TWO * bend * t > slow_approach(step, pushed)):
        return step.begin + t
    return FAR


@wp.func
def kept_apart(contacts: Contacts, step: Step, k: wp.int32) -> bool:
    """Check whether the impulses of a row keep a near pair apart already."""
    first = contacts.row_at[step.slot, k]
    if first < 0:
        return False
    for j in range(contacts.row_count[step.slot, k]):
        if contacts.rows[step.slot, step.half, first + j].solved == 1:
            return True
    return False


@wp.func
def cuts_of(scene: Scene, bodies: Bodies, w: wp.int32, a: wp.int32, b: wp.int32) -> wp.int32:
    """Return how often impacts have cut the path of that body of a pair that they cut most often in this step."""
    cuts = bodies.cuts[w, a]
    if b < scene.bodies:
        cuts = wp.max(cuts, bodies.cuts[w, b])
    return cuts


@wp.func
def find_meetings(scene: Scene, bodies: Bodies, contacts: Contacts, references: References, step: Step) -> wp.vec2d:
    """Find when the members' near pairs collide; return when the first does, FAR for none, and the least gap [m]."""
    w = step.w
    slot = step.slot
    n = scene.bodies
    slack = FAR
    soonest = FAR
    for k in range(step.near):
        pair = contacts.near[slot, k]
        a = pair[0]
        b = pair[1]
        own = step.everyone
        if own == 0:
            own = bodies.member[w, a]
            if own == 0 and b < n:
                own = bodies.member[w, b]
        if own == 1:
            meet = FAR
            least = contacts.near_gap[slot, k] - bodies.room[w, a][0]
            ahead = bodies.ahead[w, a][0]
            if b < n:
                least -= bodies.room[w, b][0]
                ahead += bodies.ahead[w, b][0]
            near = ahead >= least - scene.touch and cuts_of(scene, bodies, w, a, b) < MOST_CUTS
            if near and not kept_apart(contacts, step, k):
                bound = path_bound(scene, bodies, w, a, b, step.begin, step.whole)
                if bound >= least - scene.touch:
                    meet = first_touch(scene, bodies, contacts, references, step, k, bound)
                    soonest = wp.min(soonest, meet)
            contacts.meet[slot, k] = meet
            slack = wp.min(slack, least)
    for j in range(step.active):
        r = contacts.active[slot, j]
        if contacts.rows[slot, step.half, r].touching == 0 and contacts.rows[slot, step.half, r].solved == 0:
            k = contacts.rows[slot, step.half, r].slot
            pair = contacts.near[slot, k]
            if cuts_of(scene, bodies, w, pair[0], pair[1]) < MOST_CUTS and kept_apart(contacts, step, k):
                t = second_touch(scene, bodies, contacts, references, step, r)
                soonest = wp.min(soonest, t)
                if t < FAR:
                    contacts.meet[slot, k] = wp.min(contacts.meet[slot, k], t)
    return wp.vec2d(soonest, slack)


@wp.func
def find_impacts(scene: Scene, bodies: Bodies, contacts: Contacts, references: References, step: Step) -> Step:
    """Find when the members collide, with each other or with others, in the rest of the step."""
    least = step.slack - TWO * step.longest
    if step.everyone == 0 or least <= scene.touch:  # something may be near
        found = find_meetings(scene, bodies, contacts, references, step)
        step.meets = wp.where(found[0] < FAR, 1, step.meets)
        least = wp.where(step.everyone == 1, found[1] - TWO * step.longest, -ONE)
    step.slack = least
    return step


@wp.func
def first_impact(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step) -> wp.int32:
    """Return the near pair that collides first in the rest of the step, -1 for none.

    Where too many bodies have been solved for again in this step, only those that could pass through each other: the
    others collide, somewhat late, when the next step begins.
    """
    w = step.w
    first = wp.int32(-1)
    if step.meets == 0:
        return first
    time = step.whole * (ONE - ROUNDING)
    for k in range(step.near):
        if contacts.meet[step.slot, k] < time:
            due = step.effort <= EFFORT + EFFORT_OF_BODY * scene.bodies
            if not due:
                a = contacts.near[step.slot, k][0]
                b = contacts.near[step.slot, k][1]
                depth = scene.depth[a]
                if scene.first[b + 1] > scene.first[b]:
                    depth = wp.min(depth, scene.depth[b])
                due = path_bound(scene, bodies, w, a, b, step.begin, step.whole) > depth
            if due:
                time = contacts.meet[step.slot, k]
                first = k
    return first
