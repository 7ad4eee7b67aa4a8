"""The estimation problem: runs as chains of segments, each with an initial state of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import Design, RunDesign, design
from polyworld.estimation.parts import starts_anywhere
from polyworld.estimation.segments import SegmentSettings, cut_instants, segment_runs
from polyworld.estimation.states import SPIN
from polyworld.recording import Recording
from polyworld.representations.rigid import RigidObject
from polyworld.shapes import Sphere
from polyworld.world import World

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Segment:
    """One segment of a run.

    index: among all segments. run: index of its run. layout: its series and initial-state coordinates. own (m,):
    entries of the run's residual vector, in the order of the segment's own. first: the run's instant at which it
    begins, offset [s] after the run's first one.
    """

    index: int
    run: int
    layout: RunDesign
    own: Ints
    first: int
    offset: float


@dataclass(frozen=True)
class Problem:
    """All runs of a recording of one world as chains of segments.

    whole: the runs laid out whole. segments: of all runs, in order. chains[run]: indices of its segments.
    """

    world: World
    whole: Design
    segments: tuple[Segment, ...]
    chains: tuple[tuple[int, ...], ...]

    @property
    def recording(self) -> Recording:
        """The recording, in whole runs."""
        return self.whole.recording

    @cached_property
    def parts(self) -> Design:
        """The layout of all segments as if each were a run."""
        layouts = tuple(s.layout for s in self.segments)
        return Design(self.world, Recording(tuple(x.run for x in layouts)), layouts)

    @cached_property
    def guess(self) -> tuple[Array, ...]:
        """Initial-state coordinates (N,) of every segment as its first samples suggest them."""
        return tuple(s.layout.start for s in self.segments)


def problem_of(world: World, recording: Recording, settings: SegmentSettings | None = None) -> Problem:
    """Lay a recording out as chains of segments; runs that cannot restart anywhere are one segment each."""
    settings = settings or SegmentSettings()
    whole = design(world, recording)
    cuts = [[0] for _ in whole.runs]
    if restartable(world, recording):
        for layout in whole.runs:
            wanted = cut_instants(layout.run, settings)
            pieces = segment_runs(layout.run, wanted)
            if all(_determined(layout, design(world, Recording((p,))).runs[0]) for p in pieces):
                cuts[layout.index] = wanted
    return with_cuts(whole, cuts)


def with_cuts(whole: Design, cuts: Sequence[Sequence[int]]) -> Problem:
    """Lay runs out as chains of segments that begin at the given instants of each run."""
    segments: list[Segment] = []
    chains: list[tuple[int, ...]] = []
    for layout, firsts in zip(whole.runs, cuts, strict=True):
        run = layout.run
        pieces = design(whole.world, Recording(tuple(segment_runs(run, firsts)))).runs if len(firsts) > 1 else (layout,)
        chain = []
        for first, piece in zip(firsts, pieces, strict=True):
            own = (_with_spins(whole.world, piece) if first else piece).counted(len(segments))
            offset = float(run.times[first] - run.times[0])
            segments.append(Segment(own.index, layout.index, own, _entries(layout, own, first), first, offset))
            chain.append(own.index)
        chains.append(tuple(chain))
    return Problem(whole.world, whole, tuple(segments), tuple(chains))


def apart(problem: Problem) -> Problem:
    """Every segment as a run of its own."""
    return with_cuts(problem.parts, [[0]] * len(problem.segments))


def restartable(world: World, recording: Recording) -> bool:
    """Whether trajectories may be restarted at any instant: what is not measured of a state must not be lost there.

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


def _with_spins(world: World, layout: RunDesign) -> RunDesign:
    """A segment within a run with the spins of balls that nobody measured among its initial-state coordinates."""
    if world.planar or not (world.statics or len(world.objects) > 1):
        return layout
    found = []
    for own in layout.states:
        item = world.item(own.name)
        known = any(label.startswith("angular_velocity") for label in own.labels)
        if own.linkage is not None or known or not isinstance(item, RigidObject) or not item.friction:
            found.append(own)
            continue
        none, spread = np.zeros(3), np.full(3, SPIN)
        found.append(
            replace(
                own,
                labels=(*own.labels, *(f"angular_velocity.{a}" for a in "xyz")),
                start=np.concatenate([own.start, none]),
                typical=np.concatenate([own.typical, spread / 6.0]),
                spread=np.concatenate([own.spread, spread]),
                reach=np.concatenate([own.reach, none]),
                hasty=np.concatenate([own.hasty, np.zeros((len(own.hasty), 3))], axis=1),
            )
        )
    return replace(layout, states=tuple(found))


def _determined(whole: RunDesign, part: RunDesign) -> bool:
    """Whether a segment measures all that its run measures."""
    return {(s.name, s.kind, s.axis) for s in whole.series} == {(s.name, s.kind, s.axis) for s in part.series}


def _entries(whole: RunDesign, part: RunDesign, first: int) -> Ints:
    found = np.empty(part.length, dtype=np.int64)
    by_key = {(s.name, s.kind, s.axis): s for s in whole.series}
    for s in part.series:
        of_run = by_key[(s.name, s.kind, s.axis)]
        found[s.where] = of_run.where.start + np.searchsorted(of_run.rows, s.rows + first)
    return found
