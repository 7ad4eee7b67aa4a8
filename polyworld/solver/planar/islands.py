"""Islands: bodies that contact rows connect. An impact changes the paths of its island alone."""

import warp as wp

from polyworld.solver.planar.records import Bodies, Contacts, Scene, Step

wp.set_module_options({"enable_backward": False})


@wp.func
def root_of(label: wp.array2d[wp.int32], w: wp.int32, i: wp.int32) -> wp.int32:
    """Return the root of a body in the forest of connected bodies; paths are halved on the way (Tarjan 1975)."""
    j = wp.int32(i)
    while label[w, j] != j:
        label[w, j] = label[w, label[w, j]]
        j = label[w, j]
    return j


@wp.func
def connect(label: wp.array2d[wp.int32], w: wp.int32, a: wp.int32, b: wp.int32) -> None:
    """Connect two bodies; the root is the lesser, whatever the order."""
    p = root_of(label, w, a)
    q = root_of(label, w, b)
    label[w, wp.max(p, q)] = wp.min(p, q)


@wp.func
def gather_everyone(scene: Scene, bodies: Bodies, step: Step) -> wp.int32:
    """Make all bodies that have joined members of the part; return how many."""
    count = wp.int32(0)
    for i in range(scene.bodies):
        bodies.member[step.w, i] = 0
        if scene.schedule.joins[i] <= step.segment:
            bodies.members[step.w, count] = i
            bodies.member[step.w, i] = 1
            count += 1
    return count


@wp.func
def gather_island(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step, pair: wp.vec2i) -> wp.int32:
    """Make members of the part the bodies that contact rows connect with a pair; return how many."""
    w = step.w
    for i in range(scene.bodies):
        bodies.label[w, i] = i
    for r in range(step.rows):
        b = contacts.rows[step.slot, step.half, r].b
        if contacts.rows[step.slot, step.half, r].touching >= 0 and b < scene.bodies:
            connect(bodies.label, w, contacts.rows[step.slot, step.half, r].a, b)
    if pair[1] < scene.bodies:
        connect(bodies.label, w, pair[0], pair[1])
    root = root_of(bodies.label, w, pair[0])
    count = wp.int32(0)
    for i in range(scene.bodies):
        bodies.member[w, i] = 0
        if scene.schedule.joins[i] <= step.segment and root_of(bodies.label, w, i) == root:
            bodies.members[w, count] = i
            bodies.member[w, i] = 1
            count += 1
    return count


@wp.func
def sort_by_islands(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step) -> wp.int32:
    """Sort the part's rows, and its bodies that rows act on, by islands; return how many there are.

    The order within them is kept.
    """
    w = step.w
    slot = step.slot
    n = scene.bodies
    for m in range(step.members):
        i = bodies.members[w, m]
        bodies.label[w, i] = i
        bodies.island_of[w, i] = -1
    for k in range(step.active):
        r = contacts.active[slot, k]
        b = contacts.rows[slot, step.half, r].b
        if b < n:
            connect(bodies.label, w, contacts.rows[slot, step.half, r].a, b)
    # Count, in the order in which the bodies come; then place.
    count = wp.int32(0)
    bodies.first_body[w, 0] = 0
    bodies.first_row[w, 0] = 0
    for m in range(step.members):
        i = bodies.members[w, m]
        if bodies.coupled[w, i] == 1:
            root = root_of(bodies.label, w, i)
            if bodies.island_of[w, root] < 0:
                bodies.island_of[w, root] = count
                count += 1
                bodies.first_body[w, count] = 0
                bodies.first_row[w, count] = 0
            at = bodies.island_of[w, root]
            bodies.first_body[w, at + 1] = bodies.first_body[w, at + 1] + 1
    for k in range(step.active):
        r = contacts.active[slot, k]
        at = bodies.island_of[w, root_of(bodies.label, w, contacts.rows[slot, step.half, r].a)]
        bodies.first_row[w, at + 1] = bodies.first_row[w, at + 1] + 1
    for g in range(count):
        bodies.first_body[w, g + 1] = bodies.first_body[w, g + 1] + bodies.first_body[w, g]
        bodies.first_row[w, g + 1] = bodies.first_row[w, g + 1] + bodies.first_row[w, g]
    for m in range(step.members):
        i = bodies.members[w, m]
        if bodies.coupled[w, i] == 1:
            at = bodies.island_of[w, root_of(bodies.label, w, i)]
            bodies.island[w, bodies.first_body[w, at]] = i
            bodies.first_body[w, at] = bodies.first_body[w, at] + 1
    for k in range(step.active):
        r = contacts.active[slot, k]
        at = bodies.island_of[w, root_of(bodies.label, w, contacts.rows[slot, step.half, r].a)]
        contacts.order[slot, bodies.first_row[w, at]] = r
        bodies.first_row[w, at] = bodies.first_row[w, at] + 1
    # Each place has moved on to the next island's.
    for g in range(count):
        at = count - g
        bodies.first_body[w, at] = bodies.first_body[w, at - 1]
        bodies.first_row[w, at] = bodies.first_row[w, at - 1]
    bodies.first_body[w, 0] = 0
    bodies.first_row[w, 0] = 0
    return count
