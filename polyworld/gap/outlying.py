"""Find runs, and when within them, that behave unlike the rest before any law is blamed for it.

Every segment of every run is fitted by itself with the base world. A force that the base lacks hardly shows over a
dozen samples, so a segment that cannot be fitted holds an event: a bounce nobody mentioned, a hand, a wrong track. One
that shows alone in its run, far beyond what is ordinary in all runs, makes the run an exception.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation import profile
from polyworld.estimation.design import RunDesign, design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.forward import Forward
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import Noise, measured_noise
from polyworld.estimation.segments import Segments, short_segments
from polyworld.gap import ebic
from polyworld.gap.settings import OutlierSettings
from polyworld.world import World

Array = NDArray[np.float64]

SAMPLES = 12  # of a segment: a state has about six coordinates a body, and twice as many instants determine it
SHIFTS = (0.0, 0.5)  # of a segment, between the two sets


@dataclass(frozen=True)
class OutlyingRun:
    """A run that behaves unlike the rest.

    when [s]: from its start, at which it begins to; None for a run as a whole. how: in words. times: by how much what
    it shows exceeds what is ordinary.
    """

    run: str
    when: float | None
    how: str
    kind: Literal["event", "whole"]
    times: float

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"run": self.run, "time": self.when, "how": self.how, "kind": self.kind, "times": self.times}

    def summary(self) -> str:
        """Describe it in a sentence."""
        where = "as a whole" if self.when is None else f"from {self.when:.3g} s after its start on"
        return f"run {self.run} behaves unlike the others {where}: {self.how}"


@dataclass(frozen=True)
class _SegmentFits:
    """Segments of all runs fitted by themselves, and chi2 per measurement (K,) of each."""

    segments: Segments
    context: FitContext
    misfit: Array
    iterations: int

    def again(self, k: int) -> None:
        """Fit a segment again with an earlier start: before an impact its own samples hardly determine its state."""
        plan, first = self.segments.whole, self.segments.first[k]
        run = plan.runs[int(self.segments.run[k])].run
        since = run.times - run.times[0]
        last = first + float(self.context.design.runs[k].times[-1])
        begin = max(int(np.searchsorted(since, first - 1e-9)) - SAMPLES // 2, 0)
        chosen = (np.arange(len(since)) >= begin) & (since <= last + 1e-9)
        piece = replace(run.rows(chosen), name=f"{run.name} from {begin}", window_of=run.name)
        laid = design(plan.world, Recording((piece,)))
        context = FitContext(laid, self._noise_of(laid.runs[0]), 1, self.context.cancelled)
        states, horizons = profile.start_states(laid), profile.FINE_HORIZONS
        nothing, none = Hypothesis(plan.world, ()), np.zeros(0)
        fit = context.fit(nothing, none, states, horizons=horizons, iterations=self.iterations)
        self.misfit[k] = min(self.misfit[k], fit.misfits[0])

    def _noise_of(self, run: RunDesign) -> Noise:
        """White noise of one run, as large as in all segments: an event would pass for noise in so few samples."""
        levels = {(level.name, level.kind): level.sigma for level in self.context.noise.levels}
        sigma = np.empty(run.length)
        for s in run.series:
            sigma[s.where] = levels[s.name, s.kind]
        index = np.arange(run.length)
        return Noise((sigma,), (np.ones(run.length, dtype=bool),), (index,), (np.zeros(run.length),))


def event_runs(
    world: World, recording: Recording, settings: OutlierSettings, cancelled: Callable[[], bool] | None = None
) -> tuple[OutlyingRun, ...]:
    """Return runs that hold an event which is no ordinary one, those that stand out most first.

    None where such runs are many, or runs cannot be cut into segments.
    """
    fits = _segment_fits(world, recording, settings, cancelled)
    if not fits:
        return ()
    names = [r.name for r in recording.runs]

    every = np.concatenate([f.misfit for f in fits])
    limit = max(settings.misfit, settings.exceptional * _ordinary(every, settings))
    beyond = [(f, int(k)) for f in fits for k in np.flatnonzero(f.misfit > limit)]
    for f, k in beyond:
        f.again(k)
    worst = [max(float(f.misfit[f.segments.run == r].max(initial=0.0)) for f in fits) for r in range(len(names))]
    usual = max(_ordinary(np.array(worst), settings), 1.0)
    found: dict[str, OutlyingRun] = {}
    for f, k in beyond:
        excess = float(f.misfit[k])
        if excess > max(settings.misfit, settings.exceptional * usual):
            length = float(f.context.design.runs[k].times[-1])
            how = (
                f"over {length:.2g} s no motion of this world fits (chi2 per measurement {excess:.3g}, in the other "
                f"runs at most {usual:.2g}), as after an impact or a push that nobody mentioned, or on a wrong track"
            )
            name = names[int(f.segments.run[k])]
            _keep(found, OutlyingRun(name, float(f.segments.first[k]), how, "event", excess / usual))
    ranked = sorted(found.values(), key=lambda o: -o.times)
    return tuple(ranked) if len(ranked) <= settings.most * len(names) else ()


def _ordinary(misfits: Array, settings: OutlierSettings) -> float:
    """Return the largest of what is left where as many are left out as may be set aside: none of these has a part in
    it."""
    return float(np.quantile(misfits, 1.0 - settings.most, method="lower"))


def _segment_fits(
    world: World, recording: Recording, settings: OutlierSettings, cancelled: Callable[[], bool] | None
) -> tuple[_SegmentFits, ...]:
    """Fit every segment of two sets by itself. What lies between two segments of one set is inside one of the other."""
    plan = design(world, recording)
    found = []
    for shift in SHIFTS:
        cut = short_segments(plan, SAMPLES, shift)
        if cut is None:
            return ()
        context = FitContext(cut.parts, measured_noise(cut.parts), 1, cancelled)
        states = profile.start_states(cut.parts)
        fit = context.fit(Hypothesis(world, ()), np.zeros(0), states, iterations=2 * settings.iterations)
        found.append(_SegmentFits(cut, context, fit.misfits, settings.iterations))
    return tuple(found)


def explained_runs(trial: FittedHypothesis, recording: Recording, settings: OutlierSettings) -> tuple[str, ...]:
    """Return the runs of a recording that a fitted hypothesis explains as well as those that it was fitted to."""
    world = trial.hypothesis.fitted_world(trial.values)
    plan = design(world, recording)
    noise = measured_noise(plan)
    forward = Forward(plan, world, ())
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
    ordinary = max(_ordinary(misfits, settings), 1.0)
    if ordinary > settings.explained:
        return ()
    found = []
    for run, misfit in zip(trial.context.design.runs, misfits, strict=True):
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
    noise = trial.context.noise
    scale = np.array([light if r in worst else 1.0 for r in range(len(noise.sigma))])
    lighter = replace(noise, sigma=tuple(sigma * k for sigma, k in zip(noise.sigma, scale, strict=True)))
    again = trial.context.with_noise(lighter).refit(trial)
    return again, again.misfits * scale**2


def supporting_run(
    base: FittedHypothesis, best: FittedHypothesis, settings: OutlierSettings, decisive: float
) -> OutlyingRun | None:
    """Return the run on which alone the case for a hypothesis rests; None where other runs make it, too.

    Without that run, what the hypothesis gains over another, its base or one with fewer effects, would not pay for its
    unknowns (Cook 1977, Technometrics 19, 15: one influential case).
    """
    gains = base.costs - best.costs
    if len(gains) * settings.most < 1.0 or not np.all(np.isfinite(gains)):
        return None
    run = int(np.argmax(gains))
    price = ebic.added_price(base, best)
    if gains.sum() - gains[run] > price + decisive:
        return None
    own = best.context.design.runs[run]
    white = base.fit.linear.r[run]
    names = " + ".join(n for n in best.hypothesis.names if n not in base.hypothesis.names)
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
