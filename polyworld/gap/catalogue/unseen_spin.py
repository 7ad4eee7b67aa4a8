"""Lift by spins that nobody measured: of each run its own, so that only its product with the lift can be told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from polyworld.estimation.candidate import Variant
from polyworld.estimation.linkage import is_held
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import effect, neutral, of_effect, with_effects
from polyworld.gap.conditions import SHARE, conditions
from polyworld.recording import Recording, Run
from polyworld.world import World

MOST = 48  # unknowns, three of each flight
LABEL = "by spins that nobody measured, of each run its own"
WIDE = 300.0  # ordinary sizes that a rate may have at most


def lift_by_unseen_spins(world: World, recording: Recording) -> tuple[Variant, ...]:
    """One way, with a rate vector for each run; none where spins were measured or the world tells them, where bodies
    touch anything, which changes spins, or where less than two components of their paths were measured."""
    found = conditions(world, recording)
    flights = list(_flights(world, recording))
    if world.planar or found.touches or found.spin > 0.0 or not flights or 3 * len(flights) > MOST:
        return ()
    names = tuple(dict.fromkeys(name for name, _ in flights))
    typical = SHARE * found.acceleration / found.speed
    child, unknowns = world, list[Unknown]()
    for name in names:
        added = effect(child, "unseen_spin_lift", objects=(name,))
        child = with_effects(child, added)
        for run in (r for n, r in flights if n == name):
            whom = run.name if len(names) == 1 else f"{run.name}, {name}"
            for axis in "xyz":
                size = WIDE * typical
                rate = of_effect(added, f"rate_{axis}", typical, name=f"rate_{axis} in {whom}", lower=-size, upper=size)
                unknowns.append(replace(rate, run=run.name))
    # In a single flight, turning axes do what a spin of its own does.
    same = ("coriolis",) if len(flights) == 1 else ()
    return (Variant(child, tuple(unknowns), (neutral(unknowns),), LABEL, same_as=same),)


def _flights(world: World, recording: Recording) -> Iterator[tuple[str, Run]]:
    """Free rigid bodies with the runs in which their places, but not their turns, were measured."""
    rigid = {o.name for o in world.objects if not is_held(world, o.name)}
    for run in recording.runs:
        for column, name in enumerate(run.names):
            seen = np.isfinite(run.positions[:, column]).any(axis=0)
            turned = np.isfinite(run.orientations[:, column]).all(axis=-1).sum() >= 2
            if name in rigid and seen.sum() >= 2 and not turned:
                yield name, run
