"""Fit a study: prepare its runs, descend from few starts, sample what the data allow, test what is predicted."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.edits.removal import without_pulses
from polyworld.estimation.accuracy import BEYOND, predicted
from polyworld.estimation.declared import Rolling, constants, with_resistance
from polyworld.estimation.fit_settings import FitSettings
from polyworld.estimation.fitted import (
    Drawn,
    FittedRun,
    Found,
    Method,
    StudyFit,
    accuracy_of,
    constants_of,
    drawn_from,
    fitted_constants,
    members_of,
    with_values,
)
from polyworld.estimation.least_squares import Point, Problem
from polyworld.estimation.noise import track_sigma
from polyworld.estimation.posterior import SamplingSettings
from polyworld.estimation.problem import Block
from polyworld.estimation.readout import sample_times, tracks_readout
from polyworld.estimation.search import Search, SearchSettings, search
from polyworld.estimation.states import stretch_state
from polyworld.estimation.stretches import Stretch, stretches
from polyworld.estimation.study import Study, StudyRun
from polyworld.estimation.support import supports, with_supports
from polyworld.estimation.unknown import Unknown, joined
from polyworld.estimation.whole_run import Through, through
from polyworld.solver.work import affordable, work_of
from polyworld.world import World
from polyworld.world.geometry import circumscribed_radius
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

Edit = Callable[[list[Unknown]], list[Unknown]]
COSTLY = SamplingSettings(most=1, draws=32, turns=0)  # of worlds with deformable bodies, whose rollouts take seconds
WORK = 5e6  # of the members of a posterior, see `polyworld.solver.work`: some ten seconds
Watch = Callable[[float, str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """Request of a fit. only: names or parameter paths of the constants to fit, which else are all; the others keep the
    world's values. edit: changes the declared constants. states: whether initial states are fitted. share:
    part of the frames at the end that is left out at first, to see how well the rest predicts it. holdout: frame from
    which on the fit sees nothing at all, in place of that.
    """

    method: Method = "least_squares"
    only: tuple[str, ...] | None = None
    edit: Edit | None = None
    states: bool = True
    time_base: bool = False
    materials: tuple[str, ...] | None = None
    share: float = 0.2
    holdout: int | None = None
    members: int = 64
    generations: int = 60
    population: int = 64
    seed: int = 0


def fit(
    study: Study,
    options: FitOptions | None = None,
    *,
    settings: FitSettings | None = None,
    watch: Watch | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> StudyFit:
    """Fit the constants that runs share and the initial states of each.

    watch: called with the share done, the step, and the root mean square standardised misfit. cancelled: asked between
    iterations; a cancelled fit returns the best so far. Raises ValueError where nothing was observed or can be fitted.
    """
    began = time.perf_counter()
    work = _Fit(study, options or FitOptions(), settings or FitSettings(), watch, cancelled)
    return replace(work.run(), seconds=time.perf_counter() - began)


class _Fit:
    def __init__(
        self,
        study: Study,
        options: FitOptions,
        settings: FitSettings,
        watch: Watch | None,
        cancelled: Callable[[], bool] | None,
    ) -> None:
        self.options, self.settings, self._watch, self._cancelled = options, settings, watch, cancelled
        self.study = Study(tuple(replace(r, world=with_resistance(without_pulses(r.world))) for r in study.runs))
        held = options.holdout
        self.shown = [r.tracks if held is None else _before(r.tracks, held) for r in study.runs]
        self.noise = [track_sigma(tracks) for tracks in self.shown]
        self.sigma = [
            np.hypot(own, self.settings.model.tolerance * _sizes(r))
            for r, own in zip(study.runs, self.noise, strict=True)
        ]
        self.share, self.step, self.rollouts = (0.0, 1.0), "", 0

    # -- steps ---------------------------------------------------------------------------------------------------

    def run(self) -> StudyFit:
        """Fit the frames before the cut, see how they predict the rest, then fit all frames."""
        if self.options.holdout is not None:
            self.share, self.step = (0.0, 0.85), "fitting the frames before those held out"
            held = [self.options.holdout] * len(self.study.runs)
            found = self.fitted(self.shown)
            return self.report(found, found, held)
        cuts = [_cut(run.tracks, self.options.share) for run in self.study.runs]
        early: Found | None = None
        if any(c is not None for c in cuts) and self.options.method == "least_squares":
            self.share, self.step = (0.0, 0.4), "fitting without the last frames"
            shown = [r.tracks if c is None else r.tracks.window(int(r.tracks.frames[0]), c - 1)
                     for r, c in zip(self.study.runs, cuts, strict=True)]  # fmt: skip
            early = self.fitted(shown)
        self.share, self.step = (0.4 if early else 0.0, 0.85), "fitting all frames"
        whole = self.fitted([r.tracks for r in self.study.runs], early)
        self.share, self.step = (0.85, 1.0), "sampling the posterior"
        return self.report(whole, early, cuts)

    def fitted(self, tracks: Sequence[ObservedTracks], before: Found | None = None) -> Found:
        """Fit every mode of rolling, unless a fit before decided it; the best first."""
        if self.options.method != "least_squares":
            return self.searched(tracks, self.options.method)
        modes = self.modes() if before is None else list(before.kept)
        found: list[Found] = []
        for rolling in modes:
            problem = self.problem(tracks, rolling, cut=True)
            at = problem.start()
            stages = None
            if before is not None:
                at, carried = _continued(problem, next(f for f in before.every if f.rolling == rolling))
                stages = [1.0] if carried else None
            cost = float(problem.costs([problem.start()], 1.0)[0])
            minimum = problem.fit(at, watch=self._watched(problem), cancelled=self._cancelled, stages=stages)
            found.append(Found(problem, minimum, rolling, cost))
        found.sort(key=lambda f: f.evidence)
        return replace(found[0], others=tuple(found[1:]))

    def searched(self, tracks: Sequence[ObservedTracks], method: Search) -> Found:
        """Search by the cross-entropy method or at random, runs whole."""
        rolling: Rolling = "rolls" if "rolls" in self.modes() else "slides"
        problem = self.problem(tracks, rolling, cut=False)
        o = self.options
        elites = max(2, o.population // 4)
        chosen = SearchSettings(o.generations, o.population, elites, min(4, elites), seed=o.seed)
        cost = float(problem.costs([problem.start()], 1.0)[0])

        def watched(number: int, least: float) -> None:
            self._say(number / o.generations, f"generation {number} of {o.generations}", least, problem)

        point = search(problem, method, chosen, watched, self._cancelled)
        return Found(problem, problem.at(point), rolling, cost)

    def modes(self) -> list[Rolling]:
        """Return the modes in which what can roll may move; one where nothing can, or where it flies."""
        worlds = [r.world for r in self.study.runs]
        if any(w.coupled or w.joints for w in worlds):
            return ["slides"]
        if worlds[0].planar:
            balls = any(isinstance(o.shape, Sphere) for w in worlds for o in w.objects)
            return ["slides", "rolls"] if balls and worlds[0].environment.motion_plane.supports else ["slides"]
        rolling = [
            name
            for run, tracks in zip(self.study.runs, self.shown, strict=True)
            for name, support in supports(with_initial_states(run.world, tracks), tracks).items()
            if support.rolls and not support.turns
        ]
        return ["rolls", "slides", "skids"] if rolling else ["slides"]

    def problem(self, tracks: Sequence[ObservedTracks], rolling: Rolling, *, cut: bool) -> Problem:
        """Lay the runs out; cut: at their collisions."""
        shared = constants(self.study, self.settings.priors, rolling=rolling, time_base=self.options.time_base,
                           materials=self.options.materials)  # fmt: skip
        if self.options.only is not None:
            shared = _chosen(shared, self.options.only)
        if self.options.edit is not None:
            shared = self.options.edit(shared)
        runs = []
        for i, (run, own) in enumerate(zip(self.study.runs, tracks, strict=True)):
            runs.append(self._blocks(i, replace(run, tracks=own), rolling, cut))
        if not shared and not any(b.states.count for run in runs for b in run):
            raise ValueError("nothing to fit: no parameter shows in these tracks, or every one of them was fixed")
        descent = self.settings.descent
        if any(run.world.coupled for run in self.study.runs):
            descent = replace(descent, step=descent.wide, dampings=descent.few, renewed=descent.seldom)
        return Problem(runs, shared, descent)

    def _blocks(self, index: int, run: StudyRun, rolling: Rolling, cut: bool) -> list[Block]:
        sigma = self.sigma[index]
        if not self.options.states:
            parts: Sequence[Stretch] = (Stretch(index, 0.0, run.world, run.tracks, None),)
        else:
            parts = stretches(index, run.world, run.tracks, self.noise[index], self.settings.links, cut=cut)
        blocks = []
        for part in parts:
            world = with_supports(part.world, part.tracks) if self.options.states else part.world
            world = _coarser(world, self.settings.descent.substep)
            part = replace(part, world=world)
            states = stretch_state(part, self.settings.priors, rolling) if self.options.states else joined([])
            readout = tracks_readout(world, part.tracks, sigma)
            blocks.append(
                Block(run.name, world, sample_times(world, part.tracks), readout, states, part.link, groups=part.groups)
            )
        for before, after in itertools.pairwise(blocks):
            before.after = after
        return blocks

    # -- report --------------------------------------------------------------------------------------------------

    def report(self, found: Found, early: Found | None, cuts: Sequence[int | None]) -> StudyFit:
        """Sample the posterior, and compare runs with what was measured."""
        problem, minimum = found.problem, found.minimum
        drawn = self._drawn(found)
        first = self._drawn(early, SamplingSettings(most=4, draws=64), max(BEYOND)) if early else ()
        runs = [self._run(r, run, drawn, first, cuts[r]) for r, run in enumerate(self.study.runs)]
        self.rollouts += problem.rollouts + (early.problem.rollouts if early else 0)
        count = sum(b.size for blocks in problem.runs for b in blocks)
        return StudyFit(
            method=self.options.method,
            constants=fitted_constants(drawn),
            runs=tuple(runs),
            cost=minimum.cost,
            cost_start=found.cost_start,
            misfit=minimum.misfit / max(count, 1),
            rolling=found.rolling,
            effective=drawn[-1 if len(drawn) < 2 else 1][1].effective,
            rollouts=self.rollouts,
            seconds=0.0,
            cancelled=self._cancelled is not None and self._cancelled(),
        )

    def _drawn(self, found: Found, sampling: SamplingSettings | None = None, beyond: float = 0.0) -> Drawn:
        """Sample a posterior, of which members are rolled out to a time beyond the measurements [s]."""
        draws = COSTLY if any(r.world.coupled for r in self.study.runs) else sampling or SamplingSettings()
        works = [work_of(b.world, float(b.times[-1]) + beyond) for run in found.problem.runs for b in run]
        return drawn_from(found, affordable(works, WORK, self.options.members), self.options.seed, draws)

    def _run(self, r: int, run: StudyRun, drawn: Drawn, early: Drawn, cut: int | None) -> FittedRun:
        found, shown = drawn[0][0], self.shown[r]
        led = self._through(drawn, r, run)
        world = _first(led)
        prediction = held_out = None
        if early and cut is not None:
            before = early[0][0]
            members, names = members_of(early, r, -1), constants_of(early)
            block, begin = before.problem.runs[r][-1], before.begins(r)
            prediction = predicted(block, members, run, self.sigma[r], cut, begin, names)
            held_out = accuracy_of(_first(self._through(early[:1], r, run)), run.tracks, cut)
        return FittedRun(
            name=run.name,
            world=world,
            start=led.world,
            sample=led.overrides,
            accuracy=accuracy_of(world, shown),
            accuracy_start=accuracy_of(run.world, shown),
            held_out=held_out,
            prediction=prediction,
            slack=found.problem.slacks(found.minimum.point, r),
            frames=(int(shown.frames[0]), int(shown.frames[-1])),
        )

    def _through(self, drawn: Drawn, r: int, run: StudyRun) -> Through:
        """Lead the starts of a sample through all stretches of a run."""
        blocks = drawn[0][0].problem.runs[r]
        first = blocks[0].world.model_copy(update={"time": run.world.time})
        return through(first, blocks, [members_of(drawn, r, b) for b in range(len(blocks))],
                       self.settings.links.passes)  # fmt: skip

    def _watched(self, problem: Problem) -> Callable[[float, float], None]:
        def watched(share: float, cost: float) -> None:
            self._say(share, self.step, cost, problem)

        return watched

    def _say(self, share: float, step: str, cost: float, problem: Problem) -> None:
        if self._watch is not None:
            count = max(sum(b.size for run in problem.runs for b in run), 1)
            begin, end = self.share
            self._watch(begin + share * (end - begin), step, float(np.sqrt(cost / count)))


def _continued(problem: Problem, before: Found) -> tuple[Point, bool]:
    """Return a start where a fit to fewer frames ended, and whether all stretches have one of its states."""
    start, at = problem.start(), before.minimum.point
    if len(at.shared) != len(start.shared):
        return start, False
    states, carried = [], True
    for run, own, old, theirs in zip(problem.runs, start.states, before.problem.runs, at.states, strict=True):
        begins = [np.cumsum([0.0, *(b.link.time for b in r if b.link)]) for r in (run, old)]
        found = []
        for block, values, begin in zip(run, own, begins[0], strict=True):
            same = [y for b, y, t in zip(old, theirs, begins[1], strict=True)
                    if abs(t - begin) < 1e-9 and b.states.labels == block.states.labels]  # fmt: skip
            found.append(same[0] if same else values)
            carried &= bool(same)
        states.append(tuple(found))
    return Point(at.shared, tuple(states)), carried


def _first(led: Through) -> World:
    """Return the world of the first member, the minimum."""
    return with_values(led.world, {path: float(v[0]) for path, v in led.overrides.items()})


def _coarser(world: World, substep: float) -> World:
    """Return a spatial world of rigid bodies with longer steps, which change where they go by less than is measured."""
    if world.planar or world.coupled or world.joints or world.time.substep >= substep:
        return world
    return world.model_copy(update={"time": world.time.model_copy(update={"substep": substep})})


def _sizes(run: StudyRun) -> Array:
    """Return the size (n,) [m] of the rigid body of each track, 0 where there is none."""
    sizes = {o.name: circumscribed_radius(o.shape) for o in run.world.objects}
    return np.array([sizes.get(n, 0.0) for n in run.tracks.names])


def _cut(tracks: ObservedTracks, share: float) -> int | None:
    """Return the first frame left out; None where too few frames would be left on either side."""
    count = len(tracks.frames)
    left = round(share * count)
    return int(tracks.frames[count - left]) if left >= 2 and count - left >= 8 else None


def _chosen(shared: list[Unknown], only: Sequence[str]) -> list[Unknown]:
    """Return the constants of these names or paths; raises ValueError naming the choices."""
    for name in only:
        if not any(name in (u.name, *u.paths) for u in shared):
            choices = sorted({label for u in shared for label in (u.name, *u.paths)})
            raise ValueError(f"no constant {name!r} to fit; there are: {', '.join(choices)}")
    return [u for u in shared if {u.name, *u.paths} & {*only}]


def _before(tracks: ObservedTracks, frame: int) -> ObservedTracks:
    return tracks.window(int(tracks.frames[0]), frame - 1)
