"""Cut runs into segments, each with an initial state of its own: a model that lacks something stays near the data.

Multiple shooting (Bock 1983, in Numerical Treatment of Inverse Problems, p. 95) without conditions of continuity. Over
a whole run a missing effect adds up, and behind a few impacts the slopes predict nothing; over a segment it does not.
Raising a weight on continuity until segments join to one trajectory did worse than fitting ever longer parts of whole
runs: a cut beside an impact has it counted twice or not at all.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import Design, design
from polyworld.estimation.run_segments import FEWEST, is_seen, roughness, smooth_near, starts_anywhere
from polyworld.estimation.states import with_unobserved_spins
from polyworld.world import World
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

LONG_RUN = 512  # samples of a run; one that is so many times as long is cut into so many times the segments
LEAST = 5  # instants at which each component has to be measured for its state to leave a residual
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Segments:
    """The segments of all runs of a design, laid out as if each were a run.

    whole: the runs. parts: the segments, run by run. run (K,): index of the run of each; first (K,): its first instant
    [s] after that of the run.
    """

    whole: Design
    parts: Design
    run: NDArray[np.int64]
    first: Array

    def per_run(self, values: Array) -> Array:
        """Sum values (K,) of segments over each run (R,)."""
        return np.bincount(self.run, weights=values, minlength=len(self.whole.runs)).astype(float)

    @property
    def states_added(self) -> NDArray[np.int64]:
        """How many initial-state coordinates (R,) more the segments of each run have than the run itself."""
        counts = self.per_run(np.array([float(r.count) for r in self.parts.runs]))
        return np.array(counts - [r.count for r in self.whole.runs], dtype=np.int64)

    def states_of_runs(self, states: Sequence[Array]) -> tuple[Array, ...]:
        """Return initial states of whole runs: those of their first segments."""
        found = []
        for run in self.whole.runs:
            own = self.parts.runs[int(np.flatnonzero(self.run == run.index)[0])]
            known = dict(zip(own.labels, states[own.index], strict=True))
            found.append(np.array([known.get(lab, v) for lab, v in zip(run.labels, run.start, strict=True)]))
        return tuple(found)


def segments(plan: Design, pieces: int) -> Segments | None:
    """Cut every run into at most so many segments of equal length, more of a long run; None where a component that was
    measured is missing in one of them, or trajectories cannot be restarted anywhere."""

    def cuts(run: Run) -> list[int]:
        count = len(run.times)
        most = pieces * max(count // LONG_RUN, 1)
        number = min(most, max(count // FEWEST, 1))
        return _smoothed(run, [k * (count // number) for k in range(number)])

    return _cut(plan, cuts, FEWEST // 2) if starts_anywhere(plan.world, plan.recording) else None


def short_segments(plan: Design, samples: int, shift: float) -> Segments | None:
    """Cut every run into segments of about so many samples; None as for `segments`.

    shift: part of a segment by which the first one is shorter, so that what lies between two segments of one set is
    inside one of another.
    """

    def cuts(run: Run) -> list[int]:
        first = int(samples * shift)
        later = list(range(first or samples, len(run.times) - samples + 1, samples))
        return [0, *later]

    return _cut(plan, cuts, LEAST) if restartable(plan.world, plan.recording) else None


def _cut(plan: Design, cuts: Callable[[Run], list[int]], fewest: int) -> Segments | None:
    pieces: list[Run] = []
    owner: list[int] = []
    first: list[float] = []
    for own in plan.runs:
        run = own.run
        begins = cuts(run)
        edges = [*begins, len(run.times)]
        index = np.arange(len(run.times))
        parts = [
            replace(run.rows((index >= a) & (index < b)), name=f"{run.name} from {a}", window_of=run.name)
            for a, b in itertools.pairwise(edges)
        ]
        if not all(is_seen(run, p, fewest) for p in parts):
            return None
        pieces += parts
        owner += [own.index] * len(parts)
        first += [float(run.times[a] - run.times[0]) for a in begins]
    laid = design(plan.world, Recording(tuple(pieces)))
    starts = {(k, f == 0.0) for k, f in enumerate(first)}
    runs = tuple(
        r if (r.index, True) in starts else replace(r, states=with_unobserved_spins(plan.world, r.states))
        for r in laid.runs
    )
    return Segments(plan, Design(plan.world, laid.recording, runs), np.array(owner), np.array(first))


def _smoothed(run: Run, begins: Sequence[int]) -> list[int]:
    """Move first instants to where the paths are smooth: just before an impact a state is hardly determined."""
    count = len(run.times)
    rough = roughness(run)
    size = min(np.diff([*begins, count]), default=count)
    found = [0]
    for k, begin in enumerate(begins[1:], start=1):
        end = begins[k + 1] if k + 1 < len(begins) else count
        reach = int(min(size // 4, (end - begin) // 4))
        there = [begin + m for m in range(-reach, reach + 1) if found[-1] < begin + m < count]
        found.append(smooth_near(rough, begin, there) if there else begin)
    return found


def restartable(world: World, recording: Recording) -> bool:
    """Return whether trajectories may be restarted at any instant: what is not measured of a state must not be dropped
    there.

    Balls whose turns were not measured have their spin among the unknowns of each segment.
    """
    if starts_anywhere(world, recording):
        return True
    if world.planar or any(not isinstance(o.shape, Sphere) for o in world.objects):
        return False
    turned = Recording(
        tuple(
            replace(r, orientations=np.where(np.isnan(r.orientations), _IDENTITY, r.orientations))
            for r in recording.runs
        )
    )
    return starts_anywhere(world, turned)
