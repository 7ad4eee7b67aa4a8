"""Fit a study: prepare its runs, descend from few starts, sample what the data allow, test what is predicted."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import Accuracy, errors
from polyworld.estimation.declared import Rolling, constants, with_resistance
from polyworld.estimation.fit_settings import FitSettings
from polyworld.estimation.least_squares import Minimum, Point, Problem
from polyworld.estimation.noise import track_sigma
from polyworld.estimation.posterior import Posterior, SamplingSettings, sample
from polyworld.estimation.predict import Prediction, predicted
from polyworld.estimation.problem import Block
from polyworld.estimation.readout import sample_times, tracks_readout
from polyworld.estimation.search import CemSettings, Search, SearchSettings, search
from polyworld.estimation.starts import initial_state
from polyworld.estimation.stretches import Stretch, stretches
from polyworld.estimation.study import Study, StudyRun
from polyworld.estimation.support import supports, with_supports
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.whole_run import refined, through
from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from polyworld.world.geometry import circumscribed_radius
from polyworld.world.parameters import parameter_paths, read_parameter, with_parameters
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

Method = Literal["least_squares", "cem", "random_search"]
Edit = Callable[[list[Unknown]], list[Unknown]]
STATE = ("position", "velocity", "rotation", "angular_velocity")  # fields of a body at its start
TINY = 1e-15  # below which a number is rounding
COSTLY = SamplingSettings(rounds=2, most=2, draws=32)  # of worlds with deformable bodies, whose rollouts take seconds
SKIDS_RARELY = 4.6  # minus twice the logarithm of one in ten: few balls slide and never begin to roll
WEAK = 12.0  # difference of twice the log-evidence beyond which a way of rolling has less than three in a thousand
Watch = Callable[[float, str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """Request of a fit. edit: changes the declared constants. states: whether initial states are fitted. share:
    part of the frames at the end that is left out at first, to see how well the rest predicts it. holdout: frame from
    which on the fit sees nothing at all, in place of that.
    """

    method: Method = "least_squares"
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


@dataclass(frozen=True)
class FittedConstant:
    """A constant: its value at the minimum, its standard deviation and the interval that holds 80% of the posterior.

    prior: mean and standard deviation, of the natural logarithm where the scale is "log"; None where there is none.
    informed: part of the prior's variance that the data took away; below a half the value is the prior's. draws (N,):
    of the posterior.
    """

    unknown: Unknown
    value: float
    standard_error: float
    interval: tuple[float, float]
    informed: float
    draws: Array

    @property
    def at_bound(self) -> bool:
        """Whether the value lies on a bound that is no physical zero."""
        u, width = self.unknown, self.unknown.upper - self.unknown.lower
        return self.value > u.upper - 0.01 * width or (self.value < u.lower + 0.01 * width and u.lower > 0.0)


@dataclass(frozen=True)
class FittedRun:
    """One run of a fitted study.

    start: the world as the run's initial state was first guessed, to which `sample` refers. sample: parameter path ->
    values (N,) of the posterior, the minimum first. slack: by collision, standard deviations by which the state after
    it departs from what the model predicts.
    """

    name: str
    world: World
    start: World
    sample: dict[str, Array]
    accuracy: Accuracy | None
    accuracy_start: Accuracy | None
    held_out: Accuracy | None
    prediction: Prediction | None
    slack: tuple[float, ...]
    frames: tuple[int, int]


@dataclass(frozen=True)
class StudyFit:
    """A fitted study. cost: robust chi-square with priors at the minimum, and where the fit started; misfit: mean
    robust chi-square of a measured component. rolling: how what can roll moves. others: costs of the starts that were
    not taken."""

    method: Method
    constants: tuple[FittedConstant, ...]
    runs: tuple[FittedRun, ...]
    cost: float
    cost_start: float
    misfit: float
    rolling: Rolling
    others: dict[str, float]
    effective: float
    rollouts: int
    seconds: float
    cancelled: bool

    def constant(self, name: str) -> FittedConstant:
        """Return a constant by name; raises KeyError naming the choices."""
        for found in self.constants:
            if found.unknown.name == name:
                return found
        raise KeyError(f"unknown constant {name!r}; fitted: {[c.unknown.name for c in self.constants]}")


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
        self.study = Study(tuple(replace(r, world=with_resistance(r.world)) for r in study.runs))
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
        early: _Found | None = None
        if any(c is not None for c in cuts) and self.options.method == "least_squares":
            self.share, self.step = (0.0, 0.4), "fitting without the last frames"
            shown = [r.tracks if c is None else r.tracks.window(int(r.tracks.frames[0]), c - 1)
                     for r, c in zip(self.study.runs, cuts, strict=True)]  # fmt: skip
            early = self.fitted(shown)
        self.share, self.step = (0.4 if early else 0.0, 0.85), "fitting all frames"
        whole = self.fitted([r.tracks for r in self.study.runs], early)
        self.share, self.step = (0.85, 1.0), "sampling the posterior"
        return self.report(whole, early, cuts)

    def fitted(self, tracks: Sequence[ObservedTracks], before: _Found | None = None) -> _Found:
        """Fit every way in which what can roll may move, unless a fit before decided it; the best first."""
        if self.options.method != "least_squares":
            return self.searched(tracks, self.options.method)
        ways = self.ways() if before is None else list(before.kept)
        found: list[_Found] = []
        for rolling in ways:
            problem = self.problem(tracks, rolling, cut=True)
            at = problem.start()
            stages = None
            if before is not None:
                at, carried = _continued(problem, next(f for f in before.every if f.rolling == rolling))
                stages = [1.0] if carried else None
            cost = float(problem.costs([problem.start()], 1.0)[0])
            minimum = problem.fit(at, watch=self._watched(problem), cancelled=self._cancelled, stages=stages)
            found.append(_Found(problem, minimum, rolling, cost))
        found.sort(key=lambda f: f.evidence)
        return replace(found[0], others=tuple(found[1:]))

    def searched(self, tracks: Sequence[ObservedTracks], method: Search) -> _Found:
        """Search by the cross-entropy method or at random, runs whole."""
        rolling: Rolling = "rolls" if "rolls" in self.ways() else "slides"
        problem = self.problem(tracks, rolling, cut=False)
        o = self.options
        elites = max(2, o.population // 4)
        chosen = SearchSettings(o.generations, CemSettings(o.population, elites, min(4, elites)), o.seed)
        cost = float(problem.costs([problem.start()], 1.0)[0])

        def watched(number: int, least: float) -> None:
            self._say(number / o.generations, f"generation {number} of {o.generations}", least, problem)

        point = search(problem, method, chosen, watched, self._cancelled)
        return _Found(problem, problem.at(point), rolling, cost)

    def ways(self) -> list[Rolling]:
        """Ways in which what can roll may move; one where nothing can, or where it flies."""
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
        if self.options.edit is not None:
            shared = self.options.edit(shared)
        runs = []
        for i, (run, own) in enumerate(zip(self.study.runs, tracks, strict=True)):
            runs.append(self._blocks(i, replace(run, tracks=own), rolling, cut))
        if not shared and not any(b.states.count for run in runs for b in run):
            raise ValueError("nothing to fit: no parameter shows in these tracks, or every one of them was fixed")
        descent = self.settings.descent
        if any(run.world.coupled for run in self.study.runs):
            descent = replace(descent, step=descent.wide)
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
            states = initial_state(part, self.settings.priors, rolling, free=self.options.states)
            readout = tracks_readout(world, part.tracks, sigma)
            blocks.append(
                Block(run.name, world, sample_times(world, part.tracks), readout, states, part.link, groups=part.groups)
            )
        return blocks

    # -- report --------------------------------------------------------------------------------------------------

    def report(self, found: _Found, early: _Found | None, cuts: Sequence[int | None]) -> StudyFit:
        """Sample the posterior, and compare runs with what was measured."""
        problem, minimum = found.problem, found.minimum
        drawn = self._drawn(found)
        first = self._drawn(early, SamplingSettings(rounds=2, most=4)) if early else None
        runs = [self._run(r, run, found, drawn, early, first, cuts[r]) for r, run in enumerate(self.study.runs)]
        self.rollouts += problem.rollouts + (early.problem.rollouts if early else 0)
        count = sum(problem.runs[r][b].size for r in range(len(runs)) for b in range(len(problem.runs[r])))
        return StudyFit(
            method=self.options.method,
            constants=_constants(problem, minimum, _named(found, drawn)),
            runs=tuple(runs),
            cost=minimum.cost,
            cost_start=found.cost_start,
            misfit=minimum.misfit / max(count, 1),
            rolling=found.rolling,
            others={f.rolling: f.minimum.cost for f in found.others},
            effective=drawn[0][1].effective,
            rollouts=self.rollouts,
            seconds=0.0,
            cancelled=self._cancelled is not None and self._cancelled(),
        )

    def _drawn(self, found: _Found, sampling: SamplingSettings | None = None) -> list[tuple[_Found, Posterior]]:
        """Sample the posterior of every way of rolling that the evidence leaves, in proportion to its probability."""
        shares = found.shares
        counts = [round(p * (self.options.members - 1)) for _, p in shares]
        counts[0] = self.options.members - 1 - sum(counts[1:])
        draws = sampling or (COSTLY if any(r.world.coupled for r in self.study.runs) else SamplingSettings())
        draws = replace(draws, alike=self._alike())
        return [
            (f, sample(f.problem, f.minimum, n, self.options.seed, draws))
            for (f, _), n in zip(shares, counts, strict=True)
            if n
        ]

    def _alike(self) -> float:
        """Return how many samples count as one, as far as noise does not hide what the model leaves."""
        drift = [self.settings.model.drift * _sizes(r) / np.maximum(own, TINY)
                 for r, own in zip(self.study.runs, self.noise, strict=True)]  # fmt: skip
        every = np.concatenate(drift)
        ratio = float(np.mean(every**2)) if len(every) else 0.0
        return min(1.0 + ratio, self.settings.model.alike)

    def _run(
        self,
        r: int,
        run: StudyRun,
        found: _Found,
        drawn: list[tuple[_Found, Posterior]],
        early: _Found | None,
        first: list[tuple[_Found, Posterior]] | None,
        cut: int | None,
    ) -> FittedRun:
        blocks = found.problem.runs[r]
        impact = self.settings.priors.impact
        first_world = blocks[0].world.model_copy(update={"time": run.world.time})
        led = through(first_world, blocks, [_members(found, drawn, r, b, impact) for b in range(len(blocks))])
        start, joint = led.world, led.overrides
        if len(blocks) > 1:
            given = {
                p: float(v[0])
                for p, v in joint.items()
                if p.startswith("effects.") or p.rsplit(".", 2)[-2] not in STATE
            }
            coarse = _written(_coarser(start, self.settings.descent.substep), given)
            readout, times = tracks_readout(coarse, self.shown[r], self.sigma[r]), sample_times(coarse, self.shown[r])
            joint = refined(led, coarse, blocks, readout, times, found.minimum.point.states[r][0], self.settings)
        world = _written(start, {path: float(v[0]) for path, v in joint.items()})
        shown = self.shown[r]
        accuracy = _accuracy(world, shown)
        prediction, held_out = None, None
        if early is not None and first is not None and cut is not None:
            own = early.problem.runs[r][-1]
            names = _named(early, first)
            prediction = predicted(
                own, _members(early, first, r, -1, impact), run, self.sigma[r], cut, early.begins(r), names
            )
            held_out = _accuracy(world if early is found else self._led(early, r, run), run.tracks, cut)
        frames = (int(shown.frames[0]), int(shown.frames[-1]))
        slack = found.problem.slacks(found.minimum.point, r)
        started = _accuracy(run.world, shown)
        return FittedRun(run.name, world, start, joint, accuracy, started, held_out, prediction, slack, frames)

    def _led(self, found: _Found, r: int, run: StudyRun) -> World:
        """Return the world of a fit's minimum that one start leads through the whole run."""
        blocks = found.problem.runs[r]
        first = blocks[0].world.model_copy(update={"time": run.world.time})
        led = through(first, blocks, [_members(found, [], r, b) for b in range(len(blocks))])
        return _written(led.world, {path: float(v[0]) for path, v in led.overrides.items()})

    def _watched(self, problem: Problem) -> Callable[[float, float], None]:
        def watched(share: float, cost: float) -> None:
            self._say(share, self.step, cost, problem)

        return watched

    def _say(self, share: float, step: str, cost: float, problem: Problem) -> None:
        if self._watch is not None:
            count = max(sum(b.size for run in problem.runs for b in run), 1)
            begin, end = self.share
            self._watch(begin + share * (end - begin), step, float(np.sqrt(cost / count)))


@dataclass(frozen=True)
class _Found:
    """A fit of one way of rolling."""

    problem: Problem
    minimum: Minimum
    rolling: Rolling
    cost_start: float
    others: tuple[_Found, ...] = ()

    @property
    def evidence(self) -> float:
        """Minus twice the log-evidence, up to a constant: the minimum, and the volume of the prior that it leaves."""
        rare = SKIDS_RARELY if self.rolling == "skids" else 0.0
        return self.minimum.cost + self.problem.occam(self.minimum) + rare

    @property
    def kept(self) -> tuple[Rolling, ...]:
        """Ways of rolling that the evidence leaves, the best first."""
        near = [f.rolling for f in self.others if f.evidence < self.evidence + WEAK]
        return (self.rolling, *near)

    @property
    def every(self) -> tuple[_Found, ...]:
        """All ways of rolling, the best first."""
        return (self, *self.others)

    @property
    def shares(self) -> list[tuple[_Found, float]]:
        """Ways of rolling that the evidence leaves, with their probabilities."""
        every = [self, *(f for f in self.others if f.rolling in self.kept)]
        weights = np.exp(-0.5 * (np.array([f.evidence for f in every]) - self.evidence))
        return list(zip(every, weights / weights.sum(), strict=True))

    def begins(self, r: int) -> float:
        """When the last stretch of a run begins [s]."""
        return float(sum(b.link.time for b in self.problem.runs[r] if b.link is not None))


def _continued(problem: Problem, before: _Found) -> tuple[Point, bool]:
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


def _coarser(world: World, substep: float) -> World:
    """Return a spatial world of rigid bodies with longer steps, which change where they go by less than is measured."""
    if world.planar or world.coupled or world.joints or world.time.substep >= substep:
        return world
    return world.model_copy(update={"time": world.time.model_copy(update={"substep": substep})})


def _sizes(run: StudyRun) -> Array:
    """Return the size (n,) [m] of the rigid body of each track, 0 where there is none."""
    sizes = {o.name: circumscribed_radius(o.shape) for o in run.world.objects}
    return np.array([sizes.get(n, 0.0) for n in run.tracks.names])


def _members(
    found: _Found, drawn: list[tuple[_Found, Posterior]], r: int, b: int, impact: float = 0.0
) -> dict[str, Array]:
    """Return parameter path -> values (N,) of the minimum, then of the members, of one block.

    impact: standard deviation of what a body's restitution in a single collision has of its own.
    """
    rng = np.random.default_rng([r, 0x1E])
    at = found.minimum.point
    block = found.problem.runs[r][b]
    parts = [block.overrides(at.shared[None], at.states[r][b][None])]
    parts += [f.problem.runs[r][b].overrides(p.shared, p.states[r][b]) for f, p in drawn]
    counts = [len(next(iter(part.values()), np.zeros(1))) for part in parts]
    joint: dict[str, Array] = {}
    for path in dict.fromkeys(path for part in parts for path in part):
        own = read_parameter(block.world, path) or 0.0
        joint[path] = np.concatenate([part.get(path, np.full(n, own)) for part, n in zip(parts, counts, strict=True)])
        if path.endswith(".restitution"):
            joint[path][1:] = np.clip(joint[path][1:] + impact * rng.standard_normal(len(joint[path]) - 1), 0.0, 1.0)
    return joint


def _named(found: _Found, drawn: list[tuple[_Found, Posterior]]) -> dict[str, Array]:
    """Return constants by name, coordinates (N,) of the minimum, then of the members; NaN where one has no such."""
    own = {u.name: i for i, u in enumerate(found.problem.shared)}
    joint: dict[str, Array] = {}
    for name in dict.fromkeys(u.name for f, _ in [(found, None), *drawn] for u in f.problem.shared):
        u = next(u for f, _ in [(found, None), *drawn] for u in f.problem.shared if u.name == name)
        parts = [np.full(1, found.minimum.point.shared[own[name]] if name in own else np.nan)]
        for f, p in drawn:
            column = next((i for i, u in enumerate(f.problem.shared) if u.name == name), None)
            parts.append(np.full(len(p.shared), np.nan) if column is None else p.shared[:, column])
        joint[name] = np.concatenate(parts)
        if u.scale == "linear":
            joint[name] = np.maximum(joint[name], u.lower)
    return joint


def _cut(tracks: ObservedTracks, share: float) -> int | None:
    """Return the first frame left out; None where too few frames would be left on either side."""
    count = len(tracks.frames)
    left = round(share * count)
    return int(tracks.frames[count - left]) if left >= 2 and count - left >= 8 else None


def _before(tracks: ObservedTracks, frame: int) -> ObservedTracks:
    return tracks.window(int(tracks.frames[0]), frame - 1)


def _written(world: World, values: dict[str, float]) -> World:
    known = parameter_paths(world)
    inside = {p: float(np.clip(v, known[p].lower, known[p].upper)) for p, v in values.items() if p in known}
    inside = {p: v if abs(v) > TINY else 0.0 for p, v in inside.items()}
    return with_parameters(world, inside)


def _accuracy(world: World, tracks: ObservedTracks, cut: int | None = None) -> Accuracy | None:
    """Compare a world with tracks, from frame `cut` on; None where it diverges."""
    batch: BatchTrajectory = simulator(world, sample_times(world, tracks), n_worlds=1).run()
    if batch.stopped[0]:
        return None
    first = 0 if cut is None else int(np.searchsorted(tracks.frames, cut))
    return errors(tracks_readout(world, tracks), batch, first, len(tracks.frames))


def _constants(problem: Problem, minimum: Minimum, named: dict[str, Array]) -> tuple[FittedConstant, ...]:
    found = []
    for i, u in enumerate(problem.shared):
        draws = named[u.name][1:]
        draws = draws[np.isfinite(draws)]
        spread = float(draws.std())
        prior = (
            problem.prior_sd[i]
            if np.isfinite(problem.prior_sd[i])
            else (problem.upper - problem.lower)[i] / np.sqrt(12.0)
        )
        if u.prior is not None and u.lower == 0.0 and u.prior[0] == 0.0:
            prior *= np.sqrt(0.5 - 0.5 / np.pi)  # of a normal variable, 0 where it is negative
        values = np.exp(draws) if u.scale == "log" else draws
        x = float(minimum.point.shared[i] if u.scale == "log" else max(minimum.point.shared[i], u.lower))
        low, high = np.quantile(values, [0.1, 0.9])
        informed = float(np.clip(1.0 - (spread / prior) ** 2, 0.0, 1.0))
        value = float(np.exp(x)) if u.scale == "log" else x
        found.append(FittedConstant(u, value, float(values.std()), (float(low), float(high)), informed, values))
    return tuple(found)
