"""Contact episodes, written as they happen."""

import warp as wp

from polyworld.solver.core.episodes import Episode, Log, record_touch
from polyworld.solver.planar.contacts import find_rows
from polyworld.solver.planar.records import Bodies, Contacts, References, Row, Samples, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)


@wp.func
def touch_of(bodies: Bodies, w: wp.int32, row: Row, time: wp.float64, impulse: wp.float64) -> Episode:
    """Return the touch of a row at `time` by its impact and, over the step, by `impulse` [N s]; plane coordinates."""
    touch = Episode()
    touch.a = row.a
    touch.b = row.b
    touch.begin = time
    touch.last = time
    touch.first_impulse = impulse + row.impact_impulse
    touch.impulse = touch.first_impulse
    touch.speed = row.approach
    pose = bodies.pose[w, row.a]
    touch.position = wp.vec3d(pose[0] + row.arm_a[0], pose[1] + row.arm_a[1], ZERO)
    return touch


@wp.func
def record_contacts(bodies: Bodies, contacts: Contacts, log: Log, step: Step, time: wp.float64) -> None:
    """Record what has touched on the members' paths, which are taken to `time` in the step [s], and its impulses."""
    for r in range(step.rows):
        row = contacts.rows[step.slot, step.half, r]
        acts = row.touching == 1 or (row.touching == 0 and row.force[0] > ZERO)
        if acts and bodies.member[step.w, row.a] == 1:
            begin = step.whole - row.span
            impulse = row.force[0] * (time - begin) / row.span
            record_touch(log, step.w, touch_of(bodies, step.w, row, step.start + begin, impulse))


@wp.func
def record_last_contacts(
    bodies: Bodies,
    contacts: Contacts,
    references: References,
    samples: Samples,
    log: Log,
    step: Step,
) -> None:
    """Record what touches at the end of a run, so that it is seen to go on."""
    found = find_rows(references.scene, references.bodies, references.contacts, samples, step)
    for r in range(found[1]):
        row = contacts.rows[step.slot, found[0], r]
        if row.touching == 1:
            record_touch(log, step.w, touch_of(bodies, step.w, row, step.time, ZERO))
