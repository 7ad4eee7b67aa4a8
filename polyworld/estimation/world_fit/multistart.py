"""Several short searches, each polished by least squares: which basin is deepest shows only at its bottom.

The loss at which a global search stops says little about the basin it stopped in, so every search's best
candidate is refined for a few iterations and the most promising ones to the end (multi-start local search with
a second selection, as in Rinnooy Kan & Timmer 1987).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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


def restarts(
    problem: FitProblem,
    settings: SearchSettings,
    count: int,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> Iterator[FitResult]:
    """Search `count` times by the cross-entropy method, from one seed after the other; a cancelled search is the last.

    progress and cancelled as in `fit`; progress counts the generations of all searches.
    """
    for restart in range(count):

        def report(step: SearchProgress, restart: int = restart) -> None:
            if progress is not None:
                progress(replace(step, done=restart * step.total + step.done, total=count * step.total))

        found = fit(problem, replace(settings, seed=settings.seed + restart), progress=report, cancelled=cancelled)
        yield replace(found, history=tuple(replace(point, restart=restart) for point in found.history))
        if found.status == "cancelled":
            return


def multistart(
    problem: FitProblem,
    settings: SearchSettings,
    count: int,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[Start, ...]:
    """Refine the outcome of each of `count` searches by least squares; the starts in order of their best loss.

    A cancelled fit returns the starts made so far, the last with status `cancelled`.
    """
    starts: list[Start] = []
    for found in restarts(problem, settings, count, progress=progress, cancelled=cancelled):
        starts.append(Start(found))
        if found.status == "cancelled":
            return in_order(starts)
        first = refine(problem, found.by_name, iterations=FIRST_ITERATIONS, cancelled=cancelled)
        starts[-1] = Start(found, first)
    starts = list(in_order(starts))
    for rank, start in enumerate(starts[:FINALISTS]):
        before, end = start.refined, refine(problem, start.best.by_name, cancelled=cancelled)
        if before is not None:
            better = end if end.loss <= before.loss else before
            refined = replace(better, rollouts=before.rollouts + end.rollouts, status=end.status)
            starts[rank] = Start(start.searched, refined)
    return in_order(starts)


def in_order(starts: Iterable[Start]) -> tuple[Start, ...]:
    """Return starts by their best loss, lowest first."""
    return tuple(sorted(starts, key=lambda start: start.best.loss))
