"""The kernel: one thread advances one world from its first sample to its last."""

import warp as wp

from polyworld.solver.core.episodes import Log
from polyworld.solver.planar.episodes import record_last_contacts
from polyworld.solver.planar.joints import begin_hinges
from polyworld.solver.planar.records import Bodies, Contacts, Joints, References, Samples, Scene, Step
from polyworld.solver.planar.step import advance

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
ONE = wp.float64(1.0)
ROUNDING = wp.float64(1.0e-12)  # part of a step that is none


@wp.kernel(enable_backward=False)
def roll_out(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    log: Log,
    samples: Samples,
    references: References,
    first: wp.int32,
) -> None:
    """Roll world first + tid out through the segments of its schedule."""
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
        step.room = -ONE
        step.last_h = ONE
    for segment in range(scene.schedule.reach[w]):
        step.segment = segment
        end = scene.schedule.end[own, segment] * scale
        steps = scene.schedule.steps[own, segment]
        joined = wp.int32(0)
        for i in range(n):
            if scene.schedule.joins[i] == segment:
                step.room = -ONE
                joined = wp.int32(1)
        if joints.count > 0 and joined == 1:
            begin_hinges(scene, joints, w, segment)
        step.whole = ZERO
        if steps > 0:
            step.whole = (end - start) / wp.float64(steps)
        for number in range(steps):
            if step.diverged == 1:
                break
            left = step.whole
            step.parts = 0
            while left > ROUNDING * step.whole and step.diverged == 0:
                step.h = left
                step.time = start + wp.float64(number + 1) * step.whole - left
                step = advance(scene, bodies, contacts, joints, log, samples, references, step)
                left -= step.part
                step.parts = step.parts + 1
        start = end
        step.time = end
        sample = scene.schedule.sample[own, segment]
        if sample >= 0 and step.diverged == 0:
            for i in range(n):
                samples.pose[w, sample, i] = bodies.pose[w, i]
                samples.rate[w, sample, i] = bodies.rate[w, i]
    contacts.last[w] = step
    if log.record == 1 and step.diverged == 0 and n > 0:
        record_last_contacts(scene, bodies, contacts, samples, log, step)
