"""Several short searches, each polished by least squares: which basin is deepest shows only at its bottom.

The loss at which a global search stops says little about the basin it stopped in, so every search's best
candidate is refined for a few iterations and the most promising ones to the end (multi-start local search with
a second selection, as in Rinnooy Kan & Timmer 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from polyworld.identification.fit import Cancelled, FitProgress, FitSettings, Progress, fit
from polyworld.identification.forward import MakeSimulator
from polyworld.identification.free_parameters import FitParameter
from polyworld.identification.refine import RefineSettings, refine
from polyworld.identification.result import FitResult
from polyworld.rollout import simulator
from polyworld.tracks import ObservedTracks
from polyworld.world import World


@dataclass(frozen=True)
class Start:
    """One search and what least squares made of it, None where the fit was cancelled before."""

    searched: FitResult
    refined: FitResult | None = None

    @property
    def best(self) -> FitResult:
        """The result of lower loss."""
        return self.searched if self.refined is None or self.refined.loss >= self.searched.loss else self.refined


@dataclass(frozen=True)
class MultistartSettings:
    """search: its `restarts` searches differ in their seeds. first_iterations: least-squares iterations every
    search's candidate gets; finalists: how many of the best go on with those of `refining`."""

    search: FitSettings
    refining: RefineSettings
    first_iterations: int = 8
    finalists: int = 2

    def __post_init__(self) -> None:
        if self.finalists < 1 or self.first_iterations < 1:
            raise ValueError("finalists and first_iterations must be at least 1")


def fit_refined(
    world: World,
    tracks: ObservedTracks,
    parameters: Sequence[FitParameter],
    *,
    settings: MultistartSettings,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    make_simulator: MakeSimulator = simulator,
) -> tuple[Start, ...]:
    """Search from every seed and refine each outcome; the starts in order of their best loss, best first.

    progress and cancelled as in `fit`; progress counts the generations of all searches, and its checkpoint is that
    of the present search alone. A cancelled fit returns the starts made so far, the last with status `cancelled`.
    """

    def polished(begin: FitResult, iterations: int) -> FitResult:
        values = {value.name: value.value for value in begin.values}
        limited = replace(settings.refining, iterations=iterations)
        return refine(
            world, tracks, parameters, values, settings=limited, cancelled=cancelled, make_simulator=make_simulator
        )

    restarts = settings.search.restarts
    starts: list[Start] = []
    for restart in range(restarts):
        one = replace(settings.search, restarts=1, seed=settings.search.seed + restart)

        def tell(step: FitProgress, restart: int = restart) -> None:
            if progress is not None:
                done = restart * step.total + step.done
                progress(replace(step, done=done, total=restarts * step.total, restart=restart))

        found = fit(
            world, tracks, parameters, settings=one, progress=tell, cancelled=cancelled, make_simulator=make_simulator
        )
        history = tuple(replace(point, restart=restart) for point in found.history)
        found = replace(found, history=history)
        if found.status == "cancelled":
            starts.append(Start(found))
            return _in_order(starts)
        starts.append(Start(found, polished(found, settings.first_iterations)))
    ordered = _in_order(starts)
    finished = []
    for rank, start in enumerate(ordered):
        before = start.refined
        if rank < settings.finalists and before is not None:
            end = polished(start.best, settings.refining.iterations)
            rollouts = before.rollouts + end.rollouts
            start = replace(start, refined=replace(end if end.loss <= before.loss else before, rollouts=rollouts))
            if end.status == "cancelled" and start.refined is not None:
                start = replace(start, refined=replace(start.refined, status="cancelled"))
        finished.append(start)
    return _in_order(finished)


def _in_order(starts: Sequence[Start]) -> tuple[Start, ...]:
    return tuple(sorted(starts, key=lambda start: start.best.loss))
