"""Find runs, and when within them, that behave unlike the rest before any law is blamed for it.

Every segment of every run is fitted by itself with the base world. A force that the base lacks hardly shows over a
dozen samples, so a segment that cannot be fitted holds an event: a bounce nobody mentioned, a hand, a wrong track. An
event between two segments shows as a jump of the state, and one that shows alone in its run, far beyond what is
ordinary in all runs, makes the run an exception.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import forward as whole_runs
from polyworld.estimation import profile
from polyworld.estimation.continuity import QUANTITIES, Boundary, jumps
from polyworld.estimation.design import design
from polyworld.estimation.guesses import best_guesses, flipped, propagated
from polyworld.estimation.least_squares import Chains, Point
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.problem import Problem, apart, problem_of
from polyworld.estimation.segment_forward import Forward, Settings
from polyworld.estimation.shooting import Fit, set_scales
from polyworld.estimation.trial import FittedHypothesis
from polyworld.estimation.unknown import Unknown
from polyworld.gap.settings import OutlierSettings
from polyworld.recording import Recording
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OutlyingRun:
    """A run that behaves unlike the rest.

    when [s]: from its start, at which it begins to; None for a run as a whole. how: in words. times: by how much what
    it shows exceeds what is ordinary.
    """

    run: str
    when: float | None
    how: str
    kind: Literal["event", "jump", "whole"]
    times: float

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"run": self.run, "time": self.when, "how": self.how, "kind": self.kind, "times": self.times}

    def summary(self) -> str:
        """Describe it in a sentence."""
        where = "as a whole" if self.when is None else f"from {self.when:.3g} s after its start on"
        return f"run {self.run} behaves unlike the others {where}: {self.how}"


@dataclass(frozen=True)
class SegmentFits:
    """Segments fitted by themselves: chi2 per measurement (K,) of each, and jumps between them in standard errors."""

    problem: Problem
    misfit: Array
    boundaries: tuple[Boundary, ...]
    jump: tuple[Array, ...]


def segment_fits(
    world: World,
    recording: Recording,
    base: Sequence[Unknown],
    settings: OutlierSettings,
    cancelled: Callable[[], bool] | None = None,
) -> SegmentFits | None:
    """Fit every segment by itself; None where runs cannot be cut."""
    problem = problem_of(world, recording)
    if len(problem.segments) <= len(problem.chains):
        return None
    single = apart(problem)
    values = np.array([u.start for u in base])  # a segment determines little of what all runs share
    whole = Chains(Forward(problem, world, tuple(base), cancelled), measured_noise(problem.whole))
    chains = Chains(Forward(single, world, (), cancelled), measured_noise(single.whole))
    fit = Fit(chains, Point(np.zeros(0), best_guesses(whole, values)))
    fit.stage(1.0, settings.iterations, 1.0)
    at = propagated(whole, flipped(whole, Point(values, fit.at.states)))
    fit.at = Point(np.zeros(0), at.states)
    fit.stage(1.0, settings.iterations, 1.0)
    costs, _ = chains.costs([fit.at])
    counts = np.array([max(int(k.sum()), 1) for k in chains.noise.kept])
    set_scales(whole, Point(values, fit.at.states))
    asked = [Settings(s.index, values[None], fit.at.states[s.index][None]) for s in problem.segments]
    outcomes = whole.forward.outcomes(asked)
    found = jumps(whole.continuity, outcomes, [s.states for s in asked])
    scaled = tuple(j[0] / scale for j, scale in zip(found, whole.scale, strict=True))
    return SegmentFits(problem, costs[0] / counts, whole.continuity.boundaries, scaled)


def outlying_runs(fits: SegmentFits, settings: OutlierSettings) -> tuple[OutlyingRun, ...]:
    """Return runs with an event that is no ordinary one, those that stand out most first; none where they are many."""
    problem = fits.problem
    count = len(problem.chains)
    run_of = np.array([s.run for s in problem.segments])
    worst = np.array([fits.misfit[run_of == r].max() for r in range(count)])
    ordinary = max(float(np.quantile(worst, 1.0 - settings.most)), 1.0)
    found: dict[str, OutlyingRun] = {}
    for s in problem.segments:
        excess = float(fits.misfit[s.index])
        if excess > max(settings.misfit, settings.apart * ordinary):
            name = problem.whole.runs[s.run].run.name
            how = (
                f"over {float(s.layout.times[-1]):.2g} s no motion of this world fits (chi2 per measurement "
                f"{excess:.3g}, in the other runs at most {ordinary:.2g}), as after an impact or a push that nobody "
                "mentioned, or on a wrong track"
            )
            _keep(found, OutlyingRun(name, s.offset, how, "event", excess / ordinary))
    moving = [_translation(b, problem.world.planar) for b in fits.boundaries]  # turns may be counted differently
    size = np.array([float(np.max(np.abs(j[m]), initial=0.0)) for j, m in zip(fits.jump, moving, strict=True)])
    owner = np.array([problem.segments[b.after].run for b in fits.boundaries])
    largest = np.array([size[owner == r].max(initial=0.0) for r in range(count)])
    usual = max(float(np.quantile(largest, 1.0 - settings.most)), 1.0)
    for boundary, jump, own, value in zip(fits.boundaries, fits.jump, moving, size, strict=True):
        if value > max(settings.jump, settings.apart * usual):
            s = problem.segments[boundary.after]
            name = problem.whole.runs[s.run].run.name
            component = int(own[np.argmax(np.abs(jump[own]))])
            what = QUANTITIES[int(boundary.kind[component])]
            how = f"its {what} jumps by {value:.3g} standard errors (in the other runs by at most {usual:.2g})"
            _keep(found, OutlyingRun(name, s.offset, how, "jump", float(value) / usual))
    ranked = sorted(found.values(), key=lambda o: -o.times)
    return tuple(ranked) if len(ranked) <= settings.most * count else ()


def _translation(boundary: Boundary, planar: bool) -> NDArray[np.int64]:
    """Components of a jump that are of places and velocities of bodies' centres."""
    moving = boundary.kind < 2
    if planar:
        moving = moving & (boundary.axis < 2)
    return np.flatnonzero(moving)


def explained_runs(trial: FittedHypothesis, recording: Recording, settings: OutlierSettings) -> tuple[str, ...]:
    """Return the runs of a recording that a fitted hypothesis explains as well as those that it was fitted to."""
    world = trial.hypothesis.fitted_world(trial.values)
    plan = design(world, recording)
    noise = measured_noise(plan)
    forward = whole_runs.Forward(plan, world, ())
    fit = profile.fit(forward, noise, np.zeros(0), profile.start_states(plan), horizons=profile.horizons_for(plan))
    ordinary = max(float(np.median(trial.misfits)), 1.0)
    found = []
    for run, r in zip(plan.runs, fit.linear.r, strict=True):
        if float(r @ r) <= settings.excess * ordinary * max(int(noise.kept[run.index].sum()), 1):
            found.append(run.run.name)
    return tuple(found)


def _keep(found: dict[str, OutlyingRun], outlier: OutlyingRun) -> None:
    """Keep the earliest event of each run, with the greatest excess."""
    known = found.get(outlier.run)
    if known is None:
        found[outlier.run] = outlier
        return
    first = outlier if (outlier.when or 0.0) < (known.when or 0.0) else known
    found[outlier.run] = replace(first, times=max(outlier.times, known.times))


def misfitting_runs(
    trials: Sequence[FittedHypothesis], spare: int, settings: OutlierSettings
) -> tuple[OutlyingRun, ...]:
    """Return up to `spare` runs that the law which explains the others best explains far worse.

    Least trimmed squares (Rousseeuw 1984, J. Am. Stat. Assoc. 79, 871) by whole runs: the laws under which the other
    runs fit best are refitted to these (a concentration step), and the best of them judges. No run is returned where
    that law does not explain most of the others either.
    """
    kept = len(trials[0].costs) - spare
    leaders = sorted(trials, key=lambda t: float(np.sort(t.costs)[:kept].sum()))[: settings.leaders]
    ways = [_concentrated(t, spare, settings.light) for t in leaders]
    trial, misfits = min(ways, key=lambda w: float(np.sort(w[1])[:kept].sum()))
    ordinary = max(float(np.quantile(misfits, 1.0 - settings.most)), 1.0)
    if ordinary > settings.explained:
        return ()
    found = []
    for run, misfit in zip(trial.bench.design.runs, misfits, strict=True):
        if misfit > settings.excess * ordinary:
            white = trial.fit.linear.r[run.index]
            names = " + ".join(trial.hypothesis.names) or "the world as it is"
            how = f"its residuals are {np.sqrt(misfit / ordinary):.3g} times those of the others under {names}"
            name = run.run.part_of or run.run.name
            onset = _onset(run.times, run.series, white)
            found.append(OutlyingRun(name, onset, how, "whole", float(misfit / ordinary)))
    return tuple(sorted(found, key=lambda o: -o.times))[:spare]


def _concentrated(trial: FittedHypothesis, spare: int, light: float) -> tuple[FittedHypothesis, Array]:
    """Refit a hypothesis with the runs that it explains worst all but left out; with chi2 per measurement (R,)."""
    worst = set(np.argsort(-trial.misfits, kind="stable")[:spare].tolist())
    noise = trial.bench.noise
    scale = np.array([light if r in worst else 1.0 for r in range(len(noise.sigma))])
    lighter = replace(noise, sigma=tuple(sigma * k for sigma, k in zip(noise.sigma, scale, strict=True)))
    again = trial.bench.with_noise(lighter).refit(trial)
    return again, again.misfits * scale**2


def supporting_run(
    base: FittedHypothesis, best: FittedHypothesis, settings: OutlierSettings, decisive: float
) -> OutlyingRun | None:
    """Return the run on which alone the case for a hypothesis rests; None where other runs make it, too.

    Without that run, what the hypothesis gains over the base would not pay for its unknowns (Cook 1977, Technometrics
    19, 15: one influential case).
    """
    gains = base.costs - best.costs
    if len(gains) * settings.most < 1.0 or not np.all(np.isfinite(gains)):
        return None
    run = int(np.argmax(gains))
    price = (best.ebic - best.chi2) - (base.ebic - base.chi2)
    if gains.sum() - gains[run] > price + decisive:
        return None
    own = best.bench.design.runs[run]
    white = base.fit.linear.r[run]
    names = " + ".join(best.hypothesis.names)
    how = f"it alone supports {names}, which lowers its chi2 by {gains[run]:.3g} and that of all others by " + (
        f"{gains.sum() - gains[run]:.3g}"
    )
    name = own.run.part_of or own.run.name
    return OutlyingRun(name, _onset(own.times, own.series, white), how, "whole", float(gains[run] / price))


def _onset(times: Array, series: Sequence[Any], white: Array) -> float | None:
    """When residuals first exceed a quarter of their largest size, if not at once."""
    size = np.zeros(len(times))
    for s in series:
        size[s.rows] = np.maximum(size[s.rows], np.abs(white[s.where]))
    large = np.flatnonzero(size > 0.25 * size.max(initial=0.0))
    first = float(times[large[0]]) if len(large) else 0.0
    return first if first > 0.1 * float(times[-1]) else None


def without_runs(recording: Recording, names: Sequence[str]) -> Recording:
    """Return the recording without some runs."""
    return Recording(tuple(r for r in recording.runs if r.name not in names))
