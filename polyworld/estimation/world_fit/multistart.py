"""Several short searches, each polished by least squares: which basin is deepest shows only at its bottom.

The loss at which a global search stops says little about the basin it stopped in, so every search's best
candidate is refined for a few iterations and the most promising ones to the end (multi-start local search with
a second selection, as in Rinnooy Kan & Timmer 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import RefineSettings, refine
from polyworld.estimation.world_fit.result import FitResult
from polyworld.estimation.world_fit.search import Cancelled, Progress, SearchProgress, SearchSettings, fit


@dataclass(frozen=True)
class Start:
    """One search and what least squares made of it, None where it was not refined."""

    searched: FitResult
    refined: FitResult | None = None

    @property
    def results(self) -> tuple[FitResult, ...]:
        """Outcomes of both stages."""
        return (self.searched,) if self.refined is None else (self.searched, self.refined)

    @property
    def best(self) -> FitResult:
        """The result of lowest loss."""
        return min(self.results, key=lambda result: result.loss)


@dataclass(frozen=True)
class MultistartSettings:
    """restarts: searches, which differ in their seeds. refining: of the best ones, to the end (None: no search is
    refined). first_iterations: least-squares iterations that every search's candidate gets; finalists: how many of the
    best go on."""

    search: SearchSettings
    restarts: int = 1
    refining: RefineSettings | None = None
    first_iterations: int = 8
    finalists: int = 2

    def __post_init__(self) -> None:
        for name in ("restarts", "finalists", "first_iterations"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")


def multistart(
    problem: FitProblem,
    settings: MultistartSettings,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[Start, ...]:
    """Search from every seed and refine each outcome; the starts in order of their best loss, best first.

    progress and cancelled as in `fit`; progress counts the generations of all searches. A cancelled fit returns the
    starts made so far, the last with status `cancelled`.
    """
    starts: list[Start] = []
    for restart in range(settings.restarts):

        def report(step: SearchProgress, restart: int = restart) -> None:
            if progress is not None:
                done, total = restart * step.total + step.done, settings.restarts * step.total
                progress(replace(step, done=done, total=total))

        own = replace(settings.search, seed=settings.search.seed + restart)
        found = fit(problem, own, progress=report, cancelled=cancelled)
        found = replace(found, history=tuple(replace(point, restart=restart) for point in found.history))
        starts.append(Start(found))
        if found.status == "cancelled":
            return _in_order(starts)
        if settings.refining is not None:
            short = replace(settings.refining, iterations=settings.first_iterations)
            starts[-1] = Start(found, refine(problem, found.by_name, short, cancelled=cancelled))
    starts = list(_in_order(starts))
    if settings.refining is not None:
        for rank, start in enumerate(starts[: settings.finalists]):
            end = refine(problem, start.best.by_name, settings.refining, cancelled=cancelled)
            before = start.refined or start.searched
            better = end if end.loss <= before.loss else before
            refined = replace(better, rollouts=before.rollouts + end.rollouts, status=end.status)
            starts[rank] = replace(start, refined=refined)
    return _in_order(starts)


def _in_order(starts: Sequence[Start]) -> tuple[Start, ...]:
    return tuple(sorted(starts, key=lambda start: start.best.loss))
