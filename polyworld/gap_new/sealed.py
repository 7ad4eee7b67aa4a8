"""Measure the gap on sealed runs, which no step has seen: shared numbers as fitted, initial states refitted."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from polyworld.data.recording import Recording
from polyworld.estimation.least_squares import Point
from polyworld.gap_new.fitting import Fitted, fit
from polyworld.gap_new.ground import ground_of
from polyworld.gap_new.held_out import refit_states
from polyworld.gap_new.hypothesis import Hypothesis

REFITS = 6


@dataclass(frozen=True)
class SealedGap:
    """Root mean square errors over sealed runs in standard deviations of the noise, before and after. share: of the
    gap beyond the noise that is left."""

    before: float
    after: float
    share: float
    by_run: dict[str, tuple[float, float]]

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)


def sealed_gap(null: Fitted, best: Fitted, sealed: Recording) -> SealedGap:
    """Measure the gap that the base and a hypothesis leave on sealed runs."""
    ground = ground_of(null.ground.world, sealed, null.ground.settings)
    names = [r.name for r in sealed.runs]
    errors = []
    for fitted in (null, best):
        # Fixed at what was fitted: unknowns of the fit that cannot move.
        problem = ground.problem(fitted.hypothesis)
        started = fit(ground, Hypothesis(ground.world), growing=True, scale=fitted.scale)
        own = []
        for run, states in zip(problem.runs, started.of_states(), strict=True):
            own.append(np.concatenate([states, run[0].states.start[len(states) :]]))
        problem.settings = started.problem.settings
        at = Point(fitted.values, tuple((s,) for s in own))
        held = Fitted(fitted.hypothesis, ground, problem, at, at, problem.normal(at, 1.0), started.scale, 0.0)
        found, _ = refit_states(held, np.repeat(fitted.values[None], len(own), 0), own, REFITS)
        errors.append(found)
    before, after = (float(np.sqrt(np.mean(e**2))) for e in errors)
    gap = np.sqrt(max(before**2 - 1.0, 1e-12))
    share = float(np.sqrt(max(after**2 - 1.0, 0.0)) / gap)
    by_run = {n: (float(a), float(b)) for n, a, b in zip(names, *errors, strict=True)}
    return SealedGap(before, after, share, by_run)
