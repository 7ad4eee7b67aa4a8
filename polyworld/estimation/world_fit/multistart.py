"""Several short searches, each polished by least squares: which basin is deepest shows only at its bottom.

The loss at which a global search stops says little about the basin it stopped in, so every search's best
candidate is refined for a few iterations and the most promising ones to the end (multi-start local search with
a second selection, as in Rinnooy Kan & Timmer 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import refine
from polyworld.estimation.world_fit.result import FitResult
from polyworld.estimation.world_fit.search import Cancelled, Progress, SearchProgress, SearchSettings, fit

FIRST_ITERATIONS = 8  # least-squares iterations that every search's candidate gets
FINALISTS = 2  # how many of the best go on to the end


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


def multistart(
    problem: FitProblem,
    settings: SearchSettings,
    restarts: int,
    *,
    refining: bool = True,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[Start, ...]:
    """Search with as many seeds as `restarts` and refine each outcome; the starts in order of their best loss.

    refining: whether least squares follow. progress and cancelled as in `fit`; progress counts the generations of all
    searches. A cancelled fit returns the starts made so far, the last with status `cancelled`.
    """
    starts: list[Start] = []
    for restart in range(restarts):

        def report(step: SearchProgress, restart: int = restart) -> None:
            if progress is not None:
                progress(replace(step, done=restart * step.total + step.done, total=restarts * step.total))

        own = replace(settings, seed=settings.seed + restart)
        found = fit(problem, own, progress=report, cancelled=cancelled)
        starts.append(Start(replace(found, history=tuple(replace(p, restart=restart) for p in found.history))))
        if found.status == "cancelled":
            return _in_order(starts)
        if refining:
            first = refine(problem, found.by_name, iterations=FIRST_ITERATIONS, cancelled=cancelled)
            starts[-1] = replace(starts[-1], refined=first)
    starts = list(_in_order(starts))
    for rank, start in enumerate(starts[:FINALISTS]):
        if start.refined is not None:
            end = refine(problem, start.best.by_name, cancelled=cancelled)
            better = end if end.loss <= start.refined.loss else start.refined
            rollouts = start.refined.rollouts + end.rollouts
            starts[rank] = replace(start, refined=replace(better, rollouts=rollouts, status=end.status))
    return _in_order(starts)


def _in_order(starts: Sequence[Start]) -> tuple[Start, ...]:
    return tuple(sorted(starts, key=lambda start: start.best.loss))
