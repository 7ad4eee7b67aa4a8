"""Friction and damping that a world's joints lack."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.effects.absence import WIDE
from polyworld.effects.conditions import SHARE, Conditions
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import of_path, one_start
from polyworld.gap.conditions import conditions, lever
from polyworld.parameters import parameter_paths
from polyworld.recording import Recording
from polyworld.world import World


def _resisting(world: World, found: Conditions, field: str) -> tuple[Variant, ...]:
    """A resistance of every joint that can have one: one value for all, or each joint by itself."""
    paths = parameter_paths(world)
    joints = [j for j in world.joints if f"joints.{j.name}.{field}" in paths and j.kind != "spring"]
    if not joints:
        return ()
    arms = {j.name: lever(world, j) for j in joints}

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


CANDIDATES = (
    Candidate(
        name="joint_friction",
        group="joint",
        law="|torque| <= T against the joint's motion",
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
        signature="swings that shrink by the same share each time",
        reference="Landau & Lifshitz, Mechanics, 25",
        variants=_damping,
        confused_with={
            "joint_friction": "large and small swings",
            "linear_drag": "one body on joints of two lengths",
            "quadratic_drag": "large and small swings: the share lost to it falls with the swing",
        },
    ),
)
