"""A motor that nobody mentioned, and the delay of one that is known."""

from __future__ import annotations

import numpy as np

from polyworld.effects.absence import WIDE
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import of_path, one_start, with_parts
from polyworld.gap.conditions import conditions, lever
from polyworld.recording import Recording
from polyworld.representations.joint import Hinge, Motor, Slider
from polyworld.world import World

SLOW = 0.3  # delay of a servo that is still ordinary [s]


def _with_motor(world: World, name: str, motor: Motor) -> World:
    joints = tuple(j.model_copy(update={"motor": motor}) if j.name == name else j for j in world.joints)
    return with_parts(world, joints=joints)


def _motor(world: World, recording: Recording) -> tuple[Variant, ...]:
    """A constant effort, one way or the other, at each joint that has no motor."""
    found = conditions(world, recording)
    if world.planar and not world.coupled:
        return ()  # hinges of planar worlds turn freely
    made = []
    for joint in world.joints:
        if not isinstance(joint, Hinge | Slider) or joint.motor is not None:
            continue
        typical = found.force * lever(world, joint)
        for reverse in (False, True):
            child = _with_motor(world, joint.name, Motor(limit=0.0, reverse=reverse))
            path = f"joints.{joint.name}.motor.limit"
            unknown = of_path(child, (path,), "effort", 0.0, typical, upper=WIDE * typical)
            label = f"{joint.name}, {'negative' if reverse else 'positive'}"
            made.append(one_start(child, (unknown,), label))
    return tuple(made)


def _delay(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Each motor later than commanded by a time of its own."""
    found = conditions(world, recording)
    made = []
    if world.planar and not world.coupled:
        return ()
    driven = [(j, j.motor) for j in world.joints if isinstance(j, Hinge | Slider) and j.motor is not None]
    for joint, motor in driven:
        step = max(float(np.median(np.diff(run.times))) for run in recording.runs)
        path = f"joints.{joint.name}.motor.delay"
        unknown = of_path(world, (path,), "delay", motor.delay, 2.0 * step, upper=found.duration, plausible=SLOW)
        starts = tuple({"delay": motor.delay + share * found.duration} for share in (0.0, 0.05, 0.15))
        made.append(Variant(world, (unknown,), starts, f"of {joint.name}" if len(driven) > 1 else "", "delay"))
    return tuple(made)


CANDIDATES = (
    Candidate(
        name="motor",
        group="joint",
        law="a constant torque or force along a joint's motion",
        signature="swings about another middle, or a turn that gets faster",
        reference="Newton's second law for rotation",
        variants=_motor,
        confused_with={"tilt": "a joint turned the other way: tilt pulls as gravity does, on all bodies"},
    ),
    Candidate(
        name="actuator_delay",
        group="joint",
        law="a motor acts at t - d as told for t",
        signature="the motion of driven bodies comes late by the same time, others' does not",
        reference="Franklin, Powell & Emami-Naeini, Feedback Control of Dynamic Systems, 5.6: pure time delay",
        variants=_delay,
        confused_with={"observer_time_offset": "bodies that no motor drives"},
    ),
)
