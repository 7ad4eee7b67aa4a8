"""Search for a world's unknowns by the cross-entropy method over a growing horizon, and by random samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.world_fit import cem, random_search
from polyworld.estimation.world_fit.cem import CemSettings, CemState
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.result import FitResult, LossPoint, Status

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SearchSettings:
    """How to search.

    generations x cem.population rollouts are spent. horizon: shares of the sample times that the stages of the search
    reach, of which the last gets `final_share` of the generations. reopen: at the start of a stage, standard
    deviations are raised to at least this share of their initial value, so that what the new observations show can
    still move them.
    """

    generations: int = 60
    cem: CemSettings = field(default_factory=CemSettings)
    horizon: tuple[float, ...] = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)
    final_share: float = 0.4
    reopen: float = 0.15
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.reopen <= 1.0:
            raise ValueError(f"reopen must lie in 0..1, got {self.reopen}")
        stages(100, self)


@dataclass(frozen=True)
class SearchProgress:
    """Where a search stands after a generation; `fit` resumes exactly at `state` (None for random search)."""

    done: int
    total: int
    samples: int
    loss: float
    rollouts: int
    state: CemState | None = None


Progress = Callable[[SearchProgress], None]
Cancelled = Callable[[], bool]


def stages(sample_count: int, settings: SearchSettings) -> list[int]:
    """Sample times that each generation compares: short windows first, so that later events refine what earlier ones
    showed.

    `final_share` of the generations see all, the rest in equal parts the shorter windows; stages of equal length after
    rounding are merged. Raises ValueError unless the shares of the horizon increase to 1.
    """
    fractions, generations = settings.horizon, settings.generations
    if not fractions or fractions[-1] != 1.0 or fractions[0] <= 0.0 or np.any(np.diff(fractions) <= 0.0):
        raise ValueError(f"horizon must increase within (0, 1] and end at 1, got {fractions}")
    if not 0.0 < settings.final_share <= 1.0:
        raise ValueError(f"final_share must lie in (0, 1], got {settings.final_share}")
    if generations < 1:
        raise ValueError(f"generations must be at least 1, got {generations}")
    lengths = sorted({max(min(2, sample_count), round(f * sample_count)) for f in fractions})
    *earlier, whole = lengths[-generations:]  # fewer generations than stages: drop the shortest windows
    last = generations
    if earlier:
        last = min(generations - len(earlier), max(1, round(settings.final_share * generations)))
    shares = [len(part) for part in np.array_split(np.arange(generations - last), max(len(earlier), 1))]
    return [length for length, count in zip(earlier, shares, strict=False) for _ in range(count)] + [whole] * last


def fit(
    problem: FitProblem,
    settings: SearchSettings | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    resume: CemState | None = None,
) -> FitResult:
    """Search by the cross-entropy method; the values found do not depend on interruptions.

    progress is called after every generation; cancelled is asked before every generation, and a cancelled fit
    returns the best found so far. resume: the state of an earlier search of the same problem and settings, which this
    one continues; its history and counts begin there.
    """
    settings = settings or SearchSettings()
    problem.begin()
    space, schedule = problem.space, stages(problem.samples, settings)
    state = resume or CemState.start(space.mean, space.sd, settings.seed)
    history: list[LossPoint] = []
    stopped = False
    for index in range(state.generation, len(schedule)):
        if cancelled is not None and cancelled():
            stopped = True
            break
        samples = schedule[index]
        if index and samples != schedule[index - 1]:
            state = replace(state, sd=np.maximum(state.sd, settings.reopen * space.sd))

        def evaluate(candidates: Array, samples: int = samples) -> Array:
            return problem.losses(candidates, samples)

        free = space.entered(float(problem.objective.sample_times[samples - 1]))
        floor = settings.cem.floor * space.sd
        state = cem.generation(state, evaluate, space.lower, space.upper, floor, settings.cem, free=free)
        best = float(state.elite_losses[0])
        history.append(LossPoint(index, 0, samples, best, float(np.median(state.elite_losses))))
        if progress is not None:
            progress(SearchProgress(index + 1, len(schedule), samples, best, problem.rollouts, state))
    # The search may have been cut short on a shorter horizon: judge its outcomes on the full one.
    contenders = np.concatenate([state.elite[:1], np.clip(state.mean, space.lower, space.upper)[None]])
    at = contenders[int(np.argmin(problem.losses(contenders, problem.samples)))]
    return problem.finish("cem", _status(stopped), at, state.elite_sd, history, settings.seed)


def fit_by_random_search(
    problem: FitProblem,
    settings: SearchSettings | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> FitResult:
    """Search the same box by uniform random samples over the full horizon, with the budget `fit` would spend."""
    settings = settings or SearchSettings()
    problem.begin()
    space, samples, total = problem.space, problem.samples, settings.generations
    at, spread = space.mean, space.sd
    history: list[LossPoint] = []
    searched = random_search.generations(
        lambda candidates: problem.losses(candidates, samples),
        space.lower,
        space.upper,
        count=total,
        population=settings.cem.population,
        keep=settings.cem.elites,
        seed=settings.seed,
    )
    stopped = False
    for number in range(total):
        if cancelled is not None and cancelled():
            stopped = True
            break
        best, losses = next(searched)
        at, spread = best[0], best.std(axis=0)
        history.append(LossPoint(number, 0, samples, float(losses[0]), float(np.median(losses))))
        if progress is not None:
            progress(SearchProgress(number + 1, total, samples, float(losses[0]), problem.rollouts))
    return problem.finish("random_search", _status(stopped), at, spread, history, settings.seed)


def _status(stopped: bool) -> Status:
    return "cancelled" if stopped else "completed"
