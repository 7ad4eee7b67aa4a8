"""The kernel: one thread advances one world from its first sample to its last."""

import warp as wp

from polyworld.solver.core.episodes import Log
from polyworld.solver.planar.episodes import record_contacts, record_last_contacts
from polyworld.solver.planar.forces import FAR, find_pushes
from polyworld.solver.planar.impact_time import first_impact
from polyworld.solver.planar.islands import gather_everyone, gather_island
from polyworld.solver.planar.motion import move_bodies
from polyworld.solver.planar.records import Bodies, Contacts, References, Samples, Scene, Step
from polyworld.solver.planar.step import set_paths

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
RENEWALS = 3  # of the near list within a step


@wp.kernel(enable_backward=False)
def roll_out(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    log: Log,
    samples: Samples,
    references: References,
    first: wp.int32,
    slot: wp.int32,
    apart: wp.int32,
) -> None:
    """Roll world first + tid out through the segments of its schedule, with row slot + apart tid of the scratch arrays.

    On a CPU the threads of a launch run one after the other, so one row serves them all (apart 0) and stays in the
    cache; where they run at the same time each has its own (apart 1).
    """
    w = first + wp.tid()
    own = scene.schedule.own[w]
    n = scene.bodies
    scale = bodies.time_scale[w]
    start = scene.schedule.begin[w]
    step = contacts.last[w]
    if start < ZERO:
        start = ZERO
        step = Step()
        step.w = w
        step.slot = slot + apart * wp.tid()
        step.renew = 1
    for segment in range(scene.schedule.reach[w]):
        step.segment = segment
        end = scene.schedule.end[own, segment] * scale
        steps = scene.schedule.steps[own, segment]
        joined = wp.int32(0)
        for i in range(n):
            if scene.schedule.joins[i] == segment:
                step.renew = 1
                joined = wp.int32(1)
        if joined == 1:
            step.members = gather_everyone(scene, bodies, step)
            step.everyone = 1
        step.whole = ZERO
        if steps > 0:
            step.whole = (end - start) / wp.float64(steps)
        for number in range(steps):
            if step.diverged == 1:
                break
            step.start = start + wp.float64(number) * step.whole
            step.begin = ZERO
            step.effort = 0
            step.meets = 0
            if number == 0:
                step.alike = 0
            renewals = wp.int32(0)
            going = wp.int32(1)
            while going == 1:
                step.h = step.whole - step.begin
                step.time = step.start + step.begin
                step.heaviest = find_pushes(scene, bodies, references, samples, step)
                if step.heaviest == FAR:
                    step.diverged = 1
                    break
                step = set_paths(scene, bodies, contacts, samples, references, step)
                time = step.whole
                impact = first_impact(scene, bodies, contacts, step)
                if step.lost == 1 and renewals < RENEWALS:
                    time = step.begin
                    renewals += 1
                    if step.everyone == 0:
                        step.members = gather_everyone(scene, bodies, step)
                        step.everyone = 1
                elif impact >= 0:
                    time = contacts.meet[step.slot, impact]
                    step.members = gather_island(scene, bodies, contacts, step, contacts.near[step.slot, impact])
                    step.everyone = 0
                    step.effort = step.effort + step.members
                else:
                    going = wp.int32(0)
                    if step.everyone == 0:
                        step.members = gather_everyone(scene, bodies, step)
                        step.everyone = 1
                if log.record == 1:
                    record_contacts(bodies, contacts, log, step, time)
                move_bodies(scene, bodies, step, time)
                step.begin = time
        start = end
        step.time = end
        sample = scene.schedule.sample[own, segment]
        if sample >= 0 and step.diverged == 0:
            for i in range(n):
                samples.pose[w, sample, i] = bodies.pose[w, i]
                samples.rate[w, sample, i] = bodies.rate[w, i]
    contacts.last[w] = step
    if log.record == 1 and step.diverged == 0 and n > 0:
        record_last_contacts(bodies, contacts, references, samples, log, step)
