"""Faults of a world's joints: friction, damping, a motor; and the delay of a motor that is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.data.recording import Recording
from polyworld.effects.absence import WIDE
from polyworld.effects.conditions import SHARE, Conditions
from polyworld.gap.candidate import Candidate, Variant, of_path, one_start, with_parts
from polyworld.gap.conditions import conditions, moment_arm
from polyworld.world import World
from polyworld.world.parameters import parameter_paths
from polyworld.world.representations.joint import Hinge, Motor, Slider

SLOW = 0.3  # delay of a servo that is still ordinary [s]


def _resisting(world: World, found: Conditions, field: str) -> tuple[Variant, ...]:
    """Return a resistance of every joint that can have one: one value for all, or each joint by itself."""
    paths = parameter_paths(world)
    joints = [j for j in world.joints if f"joints.{j.name}.{field}" in paths and j.kind != "spring"]
    if not joints:
        return ()
    arms = {j.name: moment_arm(world, j) for j in joints}

    def variant(names: Sequence[str], label: str) -> Variant:
        efforts = [found.force * arms[n] for n in names]
        rates = [1.0 if field == "friction" else found.speed / arms[n] for n in names]
        typical = float(np.median(np.divide(efforts, rates)))
        start = float(getattr(next(j for j in joints if j.name == names[0]), field))
        listed = tuple(f"joints.{n}.{field}" for n in names)
        # A joint that resists with more than the weight on its arm would not swing.
        plausible = typical / SHARE
        unknown = of_path(world, listed, field, start, typical, upper=start + WIDE * typical, plausible=plausible)
        return one_start(world, (unknown,), label)

    names = [j.name for j in joints]
    made = []
    if len({float(getattr(j, field)) for j in joints}) == 1:
        made.append(variant(names, "" if len(names) == 1 else "of all joints"))
    if len(names) > 1:
        made += [variant((n,), f"of {n}") for n in names]
    return tuple(made)


def _friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    return _resisting(world, conditions(world, recording), "friction")


def _damping(world: World, recording: Recording) -> tuple[Variant, ...]:
    return _resisting(world, conditions(world, recording), "damping")


def _motor(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Return a constant effort, one way or the other, at each joint that has no motor."""
    found = conditions(world, recording)
    made = []
    for joint in world.joints:
        if not isinstance(joint, Hinge | Slider) or joint.motor is not None:
            continue
        typical = found.force * moment_arm(world, joint)
        for reverse in (False, True):
            driven = joint.model_copy(update={"motor": Motor(limit=0.0, reverse=reverse)})
            child = with_parts(world, joints=tuple(driven if j is joint else j for j in world.joints))
            path = f"joints.{joint.name}.motor.limit"
            unknown = of_path(child, (path,), "effort", 0.0, typical, upper=WIDE * typical)
            label = f"{joint.name}, {'negative' if reverse else 'positive'}"
            made.append(one_start(child, (unknown,), label))
    return tuple(made)


def _delay(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Delay each motor by a time of its own."""
    found = conditions(world, recording)
    made = []
    driven = [(j, j.motor) for j in world.joints if isinstance(j, Hinge | Slider) and j.motor is not None]
    for joint, motor in driven:
        step = max(float(np.median(np.diff(run.times))) for run in recording.runs)
        path = f"joints.{joint.name}.motor.delay"
        unknown = of_path(world, (path,), "delay", motor.delay, 2.0 * step, upper=found.duration, plausible=SLOW)
        starts = tuple({"delay": motor.delay + share * found.duration} for share in (0.0, 0.05, 0.15))
        made.append(Variant(world, (unknown,), starts, f"of {joint.name}" if len(driven) > 1 else ""))
    return tuple(made)


CANDIDATES = (
    Candidate("joint_friction", "joint", "|torque| <= T against the joint's motion", _friction, plain=True),
    Candidate("joint_damping", "joint", "torque = -c rate", _damping, plain=True),
    Candidate("motor", "joint", "a constant torque or force along a joint's motion", _motor),
    Candidate("actuator_delay", "joint", "a motor acts at t - d as commanded for t", _delay),
)
