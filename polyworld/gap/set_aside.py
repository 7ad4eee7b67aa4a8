"""Set aside runs, or tails of runs, that no candidate predicts, judged by the best laws so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Run
from polyworld.estimation.least_squares import Point
from polyworld.gap.cross_validation import refit_states
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import Ground
from polyworld.gap.hypothesis import Hypothesis

Array = NDArray[np.float64]

SHARES = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4)  # of a run's time that may be kept
FEWEST = 8  # samples that have to be left


@dataclass(frozen=True)
class Aside:
    """A run that was set aside, or its tail from `since` [s] on. error, usual: held-out, in the noise's deviations."""

    run: str
    since: float | None
    error: float
    usual: float

    def summary(self) -> str:
        """Say what was set aside and why."""
        what = f"run {self.run}" if self.since is None else f"run {self.run} from {self.since:.3g} s on"
        return (
            f"{what} was set aside: the best laws found leave {self.error:.1f} standard deviations of the noise there, "
            f"{self.usual:.1f} in the other runs"
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {"run": self.run, "since": self.since, "error": self.error, "usual": self.usual}


def outlying(best: Fitted) -> list[int]:
    """Return the runs that stand out under a hypothesis; none where they are too many to be exceptions."""
    settings, count = best.ground.settings, len(best.ground.recording.runs)
    bad = np.flatnonzero(best.errors > settings.outlying * max(float(np.median(best.errors)), 1.0)).tolist()
    return bad if count >= settings.fewest_runs and len(bad) <= settings.most_aside * count else []


def without_runs(best: Fitted, bad: Sequence[int]) -> tuple[Ground, tuple[Aside, ...]]:
    """Return the ground without runs, or without their tails where the hypothesis describes their beginnings."""
    ground = best.ground
    runs = ground.recording.runs
    usual = float(np.median(best.errors))
    kept: list[Run] = []
    noise, aside = [], []
    for r, run in enumerate(runs):
        if r in bad:
            length = _predicted(best, r, 2.0 * max(usual, 1.0))
            since = None if length is None else float(run.times[length] - run.times[0])
            aside.append(Aside(run.name, since, float(best.errors[r]), usual))
            if length is None:
                continue
            run = run.rows(np.arange(len(run.times)) < length)
        kept.append(run)
        noise.append(ground.noise[r])
    return ground.cut(kept, noise), tuple(aside)


def _predicted(best: Fitted, r: int, enough: float) -> int | None:
    """Return how many leading samples of a run the hypothesis describes, None where hardly any."""
    ground = best.ground
    run = ground.recording.runs[r]
    for share in SHARES:
        length = int(share * len(run.times))
        if length < FEWEST:
            return None
        part = ground.cut([run.rows(np.arange(len(run.times)) < length)], [ground.noise[r]])
        started = fit(part, Hypothesis(ground.world), growing=True, scale=best.scale)
        own = np.concatenate([started.of_states()[0], best.of_states()[r][len(started.of_states()[0]) :]])
        problem = part.problem(best.hypothesis)
        problem.settings = best.problem.settings
        at = Point(best.values, ((own,),))
        held = Fitted(best.hypothesis, part, problem, at, at, problem.normal(at, 1.0), best.scale, 0.0)
        errors, _ = refit_states(held, best.values[None], [own], 6)
        if errors[0] < enough:
            return length
    return None
