"""What may be missing from joints: friction, damping, a motor, its delay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.catalogue.adding import RIGID, neutral, of_path, with_parts
from polyworld.gap.conditions import Conditions, conditions, reach
from polyworld.parameters import parameter_paths
from polyworld.recording import Recording
from polyworld.representations.joint import Hinge, Motor, Slider
from polyworld.world import World

WIDE = 300.0


def _arm(world: World, joint: Any) -> float:
    """Lever [m] of a body's weight about its joint; 1 for sliders, whose efforts are forces."""
    if isinstance(joint, Slider):
        return 1.0
    item = world.object(joint.object)
    arm = float(np.linalg.norm(np.subtract(item.position, joint.anchor)))
    return max(arm, 0.5 * reach(world, item))


def _resisting(world: World, found: Conditions, field: str) -> tuple[Variant, ...]:
    """A resistance of every joint that can have one: one value for all, or each joint by itself."""
    paths = parameter_paths(world)
    joints = [j for j in world.joints if f"joints.{j.name}.{field}" in paths and j.kind != "spring"]
    if not joints:
        return ()
    efforts = {j.name: found.force * _arm(world, j) for j in joints}
    rates = {j.name: found.speed / _arm(world, j) for j in joints}

    def size(name: str) -> float:
        return efforts[name] if field == "friction" else efforts[name] / rates[name]

    def variant(names: Sequence[str], label: str) -> Variant:
        typical = float(np.median([size(n) for n in names]))
        start = float(getattr(next(j for j in joints if j.name == names[0]), field))
        listed = tuple(f"joints.{n}.{field}" for n in names)
        unknown = of_path(world, listed, field, start, typical, upper=start + WIDE * typical)
        return Variant(world, (unknown,), (neutral((unknown,)),), label, field)

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
        typical = found.force * _arm(world, joint)
        for reverse in (False, True):
            child = _with_motor(world, joint.name, Motor(limit=0.0, reverse=reverse))
            unknown = of_path(
                child, (f"joints.{joint.name}.motor.limit",), "effort", 0.0, typical, upper=WIDE * typical
            )
            label = f"{joint.name}, {'negative' if reverse else 'positive'}"
            made.append(Variant(child, (unknown,), (neutral((unknown,)),), label, "effort"))
    return tuple(made)


def _delay(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Each motor later than told by a time of its own."""
    found = conditions(world, recording)
    made = []
    if world.planar and not world.coupled:
        return ()
    driven = [(j, j.motor) for j in world.joints if isinstance(j, Hinge | Slider) and j.motor is not None]
    for joint, motor in driven:
        step = max(float(np.median(np.diff(run.times))) for run in recording.runs)
        unknown = of_path(
            world, (f"joints.{joint.name}.motor.delay",), "delay", motor.delay, 2.0 * step, upper=found.duration
        )
        starts = tuple({"delay": motor.delay + share * found.duration} for share in (0.0, 0.05, 0.15))
        made.append(Variant(world, (unknown,), starts, f"of {joint.name}" if len(driven) > 1 else "", "delay"))
    return tuple(made)


CANDIDATES = (
    Candidate(
        name="joint_friction",
        group="joint",
        law="|torque| <= T against the joint's motion",
        representations=RIGID,
        signature="swings that shrink by the same angle each time, and stop",
        reference="Coulomb (1785); Lorenz (1924), on the damping of pendulums by dry friction",
        variants=_friction,
        confused_with={
            "joint_damping": "large and small swings: damping takes the same share, friction the same amount"
        },
    ),
    Candidate(
        name="joint_damping",
        group="joint",
        law="torque = -c rate",
        representations=RIGID,
        signature="swings that shrink by the same share each time",
        reference="Landau & Lifshitz, Mechanics, 25",
        variants=_damping,
        confused_with={
            "joint_friction": "large and small swings",
            "linear_drag": "one body on joints of two lengths",
            "quadratic_drag": "large and small swings: the share lost to it falls with the swing",
        },
    ),
    Candidate(
        name="motor",
        group="joint",
        law="a constant torque or force along a joint's motion",
        representations=frozenset({"rigid_spatial"}),
        signature="swings about another middle, or a turn that gets faster",
        reference="Newton's second law for rotation",
        variants=_motor,
        confused_with={"tilt": "a joint turned the other way: tilt pulls as gravity does, on all bodies"},
    ),
    Candidate(
        name="actuator_delay",
        group="joint",
        law="a motor acts at t - d as told for t",
        representations=frozenset({"rigid_spatial"}),
        signature="the motion of driven bodies comes late by the same time, others' does not",
        reference="Franklin, Powell & Emami-Naeini, Feedback Control of Dynamic Systems, 5.6: pure time delay",
        variants=_delay,
        confused_with={"observer_time_offset": "bodies that no motor drives"},
    ),
)
