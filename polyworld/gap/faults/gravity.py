"""Another gravity than the world's."""

from __future__ import annotations

import numpy as np

from polyworld.data.recording import Recording
from polyworld.gap.adding import of_path, one_start
from polyworld.gap.candidate import Candidate, Variant
from polyworld.gap.conditions import conditions
from polyworld.world import World


def _gravity(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    size = float(np.linalg.norm(found.gravity))
    moved = [a for a in found.axes if abs(found.gravity[a]) > 1e-6 * size]
    if not moved:
        return ()  # none, or only across a motion plane, where it acts through friction alone
    unknowns = [
        of_path(
            world,
            (f"environment.gravity.{'xyz'[a]}",),
            "gravity" if len(moved) == 1 else f"gravity_{'xyz'[a]}",
            float(found.gravity[a]),
            0.05 * size,
            lower=float(found.gravity[a]) - 2.0 * size,
            upper=float(found.gravity[a]) + 2.0 * size,
            plausible=size,  # that of the Moon, or of a table without a tilt, is off by about as much
        )
        for a in moved
    ]
    same = ("buoyancy", "observer_clock") + (() if found.touches else ("observer_scale",))
    return (one_start(world, unknowns, same_as=same),)


CANDIDATES = (
    Candidate(
        name="gravity_error",
        group="base",
        law="a = g', another gravity than the world's",
        variants=_gravity,
        plain=True,
    ),
)
