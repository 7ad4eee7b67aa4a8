"""Search for a world's unknowns by the cross-entropy method over a growing horizon, and by random samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import cem
from polyworld.estimation.cem import CemSettings, CemState, Evaluate
from polyworld.estimation.world_fit.objective import Judged
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.result import FitResult, LossPoint, Method, Status

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
    """Where a search stands after a generation.

    samples: sample times compared, of `of_samples`. loss, best_error: of the best candidate so far; error: of the
    generation's candidate in the middle of its elite. Errors are in `Objective.error_unit`.
    """

    done: int
    total: int
    samples: int
    loss: float
    rollouts: int
    state: CemState
    of_samples: int
    error: float
    best_error: float


Progress = Callable[[SearchProgress], None]
Cancelled = Callable[[], bool]


def stages(sample_count: int, settings: SearchSettings) -> list[int]:
    """Return how many sample times each generation compares: short windows first, so that later events refine what
    earlier ones showed.

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
) -> FitResult:
    """Search by the cross-entropy method.

    progress is called after every generation; cancelled is asked before every generation, and a cancelled fit
    returns the best found so far.
    """
    settings = settings or SearchSettings()
    space, schedule = problem.space, stages(problem.samples, settings)

    def step(state: CemState, evaluate: Evaluate) -> CemState:
        index = state.generation
        if index and schedule[index] != schedule[index - 1]:
            state = replace(state, sd=np.maximum(state.sd, settings.reopen * space.sd))
        free = space.entered(float(problem.objective.sample_times[schedule[index] - 1]))
        floor = settings.cem.floor * space.sd
        return cem.generation(state, evaluate, space.lower, space.upper, floor, settings.cem, free=free)

    return _search(problem, "cem", settings, schedule, step, progress, cancelled)


def fit_by_random_search(
    problem: FitProblem,
    settings: SearchSettings | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> FitResult:
    """Search the same box by independent uniform samples over the full horizon, with the budget `fit` would spend.

    The yardstick for any better search.
    """
    settings = settings or SearchSettings()

    def step(state: CemState, evaluate: Evaluate) -> CemState:
        return uniform_generation(state, evaluate, problem.space.lower, problem.space.upper, settings.cem)

    schedule = [problem.samples] * settings.generations
    return _search(problem, "random_search", settings, schedule, step, progress, cancelled)


def uniform_generation(
    state: CemState, evaluate: Evaluate, lower: Array, upper: Array, settings: CemSettings
) -> CemState:
    """Draw and evaluate one population of uniform samples and keep the best so far as elite."""
    rng = np.random.default_rng(0)
    rng.bit_generator.state = state.rng
    candidates = rng.uniform(lower, upper, size=(settings.population, len(lower)))
    every, losses = np.concatenate([state.elite, candidates]), np.append(state.elite_losses, evaluate(candidates))
    order = np.argsort(losses, kind="stable")[: settings.elites]
    best = every[order]
    found = replace(state, generation=state.generation + 1, rng=dict(rng.bit_generator.state))
    return replace(found, mean=best[0], elite=best, elite_losses=losses[order], elite_sd=best.std(axis=0))


def _search(
    problem: FitProblem,
    method: Method,
    settings: SearchSettings,
    schedule: list[int],
    step: Callable[[CemState, Evaluate], CemState],
    progress: Progress | None,
    cancelled: Cancelled | None,
) -> FitResult:
    """Run the generations of a schedule, and report the best on the full horizon."""
    problem.begin()
    space = problem.space
    state = CemState.start(space.mean, space.sd, settings.seed)
    history: list[LossPoint] = []
    status: Status = "completed"
    best_error = float("nan")
    for index in range(len(schedule)):
        if cancelled is not None and cancelled():
            status = "cancelled"
            break
        samples = schedule[index]
        judged = Judged(np.zeros(0), np.zeros(0))

        def evaluate(candidates: Array, samples: int = samples) -> Array:
            nonlocal judged
            judged = problem.judged(candidates, samples)
            return judged.losses

        state = step(state, evaluate)
        order = np.argsort(judged.losses, kind="stable")
        if judged.losses[order[0]] == state.elite_losses[0]:  # else the best is of an earlier generation
            best_error = float(judged.errors[order[0]])
        best = float(state.elite_losses[0])
        history.append(LossPoint(index, 0, samples, best, float(np.median(state.elite_losses))))
        if progress is not None:
            progress(
                SearchProgress(
                    index + 1,
                    len(schedule),
                    samples,
                    best,
                    problem.rollouts,
                    state,
                    problem.samples,
                    float(judged.errors[order[len(state.elite) // 2]]),
                    best_error,
                )
            )
    # The search may have been cut short on a shorter horizon: judge its outcomes on the full one.
    contenders = np.concatenate([state.elite[:1], np.clip(state.mean, space.lower, space.upper)[None]])
    at = contenders[int(np.argmin(problem.losses(contenders, problem.samples)))]
    return problem.finish(method, status, at, state.elite_sd, history, settings.seed)
