"""Propose effects and where their fits begin: score tests at zero strength, over a grid of places and frequencies.

The score test (Rao 1948) takes the slope of residuals by a strength at zero, projects off it what initial states and
the unknowns already fitted take up, and predicts by how much chi-square would fall. What changes courses at once, as a
wall does, has no such slope: its starts are read off the changes of course and tried as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.least_squares import Point
from polyworld.estimation.robust import huber_weights as weights
from polyworld.gap.candidate import Candidate
from polyworld.gap.cross_validation import FARTHEST
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.hypothesis import Hypothesis, extended, replace_starts, starts_of
from polyworld.gap.kinks import kinks

Array = NDArray[np.float64]

BEGINNINGS = (0.05, 0.12, 0.3)  # shares of the time over which periods are compared
BRIEF = 3  # iterations of fits that compare them
FEWEST = 6  # samples before a kink that give a state
BEFORE = 0.75  # of the time up to a kink: noise displaces it
KINKS = 4  # the sharpest
NARROWER = 0.5  # times the width at which the law begins elsewhere: what makes a kink is narrow
ENOUGH = 50.0  # nats against the bare noise from which a start is tried although model error drowns it
FAINT = 1e-6  # of the largest change by ordinary steps, below which an unknown does nothing at a start
SMALL = 0.3  # of an ordinary change: start of a strength whose slope points beyond its bound


@dataclass(frozen=True)
class Start:
    """Where the fit of a hypothesis may begin. gain: predicted fall of chi-square, in squared scales. growing: whether
    over growing parts of the time, from states that a short one gave."""

    hypothesis: Hypothesis
    point: Point
    gain: float
    growing: bool = False


class Projection:
    """Residuals and slopes of a fit, weighted, with what states and shared unknowns take up projected off.

    Departures of states from their priors are residuals, too: a spin that nobody measured takes up what it may.
    """

    def __init__(self, fitted: Fitted) -> None:
        threshold = fitted.problem.settings.huber
        self.roots = [np.sqrt(weights(one.residuals, threshold)) for one in fitted.slopes]
        self.departures: list[Array] = []
        self.bases: list[Array] = []
        for one, w, own, run in zip(fitted.slopes, self.roots, fitted.of_states(), fitted.problem.runs, strict=True):
            mean, width = run[0].states.prior.T
            self.departures.append(fitted.scale * ((own - mean) / width)[:, None])
            moved = np.concatenate([one.states * w[:, None], np.diag(fitted.scale / width)])
            basis, size, _ = np.linalg.svd(moved * run[0].states.typical, full_matrices=False)
            self.bases.append(basis[:, FARTHEST * size > 1.0])  # the rest moves less than the noise
        shared = np.concatenate([self.off_states(r, one.shared) for r, one in enumerate(fitted.slopes)])
        size = np.linalg.norm(shared, axis=0)
        self.shared = np.linalg.qr(shared[:, size > 0.0] / size[size > 0.0])[0] if (size > 0.0).any() else None
        rest = [self.off_states(r, one.residuals[:, None], self.departures[r]) for r, one in enumerate(fitted.slopes)]
        self.rest: Array = self.off_shared(np.concatenate(rest))[:, 0]

    def off_states(self, run: int, slopes: Array, departures: Array | float = 0.0) -> Array:
        """Return slopes (m, K) of one run, and departures (n, K) of its state, less what its initial state takes up."""
        basis = self.bases[run]
        weighted = np.zeros((len(basis), slopes.shape[1]))
        weighted[: len(slopes)], weighted[len(slopes) :] = slopes * self.roots[run][:, None], departures
        found: Array = weighted - basis @ (basis.T @ weighted)
        return found

    def off_shared(self, slopes: Array) -> Array:
        """Return slopes (M, K) of all runs less what shared unknowns take up."""
        return slopes if self.shared is None else slopes - self.shared @ (self.shared.T @ slopes)


def proposals(
    parent: Fitted, candidates: Sequence[Candidate], keep: int, share: float = 1.0, known: frozenset[str] = frozenset()
) -> list[Start]:
    """Return starts of every hypothesis that one of the candidates makes of a parent, at most `keep` of each.

    share: of values that count as independent, by which predicted gains are believed. known: effects that stand for all
    that do the same to every digit.
    """
    projection, undisturbed = Projection(parent), None
    found = []
    for candidate in candidates:
        own: list[Start] = []
        for hypothesis in extended(parent.hypothesis, candidate, parent.ground.recording):
            part = hypothesis.parts[-1]
            if known.intersection(part.variant.same_as):
                continue
            if not part.shared:
                own.append(Start(hypothesis, _point(parent, hypothesis, np.zeros(0)), np.inf))
            elif any(u.name == "shift_time" for u in part.shared):
                own += _dropped(parent, hypothesis, projection, keep, share)
            elif part.rescales:
                own += _rescaled(parent, hypothesis, projection, keep)
            elif part.sudden:
                undisturbed = undisturbed or _undisturbed(parent)
                own += _sudden(parent, hypothesis, undisturbed, keep)
            else:
                own += _scored(parent, hypothesis, projection, keep, share)
            phases = candidate.plain and any(p.rescales for p in parent.hypothesis.parts)
            courses = candidate.group == "contact" and parent.error > parent.ground.settings.near_noise
            if part.shared and (phases or courses):
                added = np.array([u.start + (SMALL * u.typical if u.lower >= u.start else 0.0) for u in part.shared])
                early = _point(parent, hypothesis, added, parent.early)  # what comes later is elsewhere
                own.append(Start(hypothesis, early, np.inf, growing=True))
        found += sorted(own, key=lambda s: -s.gain)[: 2 * keep]
    return found


def _point(parent: Fitted, hypothesis: Hypothesis, added: Array, at: Point | None = None) -> Point:
    """Return the parent's point, or another of its points, with values (p,) of the shared unknowns that a part adds,
    and neutral ones of runs."""
    at = at or parent.point
    states = []
    for run, own in zip(parent.ground.recording.runs, at.states, strict=True):
        extra = np.array([u.start for u in hypothesis.parts[-1].own if u.run == run.name])
        states.append((np.concatenate([own[0], extra]),))
    return Point(np.concatenate([at.shared, added]), tuple(states))


def _scored(parent: Fitted, hypothesis: Hypothesis, projection: Projection, keep: int, share: float) -> list[Start]:
    settings, part = parent.ground.settings, hypothesis.parts[-1]
    problem = parent.ground.problem(hypothesis)
    starts = _with_kinks(parent, hypothesis)
    acting = [i for i, u in enumerate(part.shared) if u.name not in part.variant.idle]
    first = len(parent.values)
    lower, upper = problem.lower[first:], problem.upper[first:]
    typical = np.array([u.typical for u in part.shared])
    a, k = len(acting), len(starts)
    shared = np.repeat(np.concatenate([np.repeat(parent.values[None], k, 0), starts], axis=1), a + 1, axis=0)
    step = np.where(starts + settings.probe * typical > upper, -1.0, 1.0) * settings.probe * typical  # (k, p)
    for j, i in enumerate(acting):
        shared[1 + j :: a + 1, first + i] += step[:, i]
    point = _point(parent, hypothesis, starts[0])
    slopes, starting = [], []
    jobs = [
        (run[0], shared, np.repeat(own[0][None], len(shared), 0))
        for run, own in zip(problem.runs, point.states, strict=True)
    ]
    for r, one in enumerate(problem.evaluate(jobs, 1.0)):
        moved = one.residuals.reshape(k, a + 1, -1)
        z = (moved[:, 1:] - moved[:, :1]) / step[:, acting][:, :, None]  # (k, a, m)
        slopes.append(projection.off_states(r, z.reshape(k * a, -1).T))
        starting.append(projection.off_states(r, moved[:, 0].T, projection.departures[r]))
    every = projection.off_shared(np.concatenate(slopes)).T.reshape(k, a, -1)
    rests = projection.off_shared(np.concatenate(starting)).T
    found = []
    for start, z, rest in zip(starts, every, rests, strict=True):
        size = np.linalg.norm(z, axis=1)
        if not np.all(np.isfinite(size)) or not size.max(initial=0.0) > 0.0:
            continue
        faint = size * typical[acting] < FAINT * float((size * typical[acting]).max())  # slopes of rounding
        z[faint], size[faint] = 0.0, 1.0
        z = z / np.maximum(size, 1e-300)[:, None]
        solved = -np.linalg.lstsq(z @ z.T, z @ rest, rcond=1e-9)[0]
        values, size = start.copy(), np.maximum(size, 1e-300)
        wished, bound = start[acting] + solved / size, np.where(solved < 0.0, lower[acting], upper[acting])
        beyond = (wished < lower[acting]) | (wished > upper[acting])
        values[acting] = np.where(beyond, 0.5 * (start[acting] + bound), wished)
        left = rest + ((values[acting] - start[acting]) * size) @ z
        gain = float((projection.rest**2).sum() - (left**2).sum()) / parent.scale**2
        if np.all(beyond & (start[acting] == bound)):
            values[acting] = start[acting] - SMALL * np.sign(solved) * typical[acting]
            gain = 0.0
        found.append(Start(hypothesis, _point(parent, hypothesis, values), gain))
    found.sort(key=lambda s: -s.gain)
    kept = found[: 1 if k == 1 else keep]
    if part.candidate.plain and len(hypothesis.parts) == 1:
        return kept
    if part.candidate.plain and len(hypothesis.parts) == 2:
        return [s for s in kept if s.gain >= 2.0]  # what predicts less than a nat is the same as the other
    asked = 2.0 * (settings.nats + hypothesis.cost(settings) - parent.hypothesis.cost(settings) - 1.0)
    first = len(hypothesis.parts) == 1
    drowned = [s for s in kept if first and s.gain * parent.scale**2 >= 2.0 * ENOUGH]
    return [s for s in kept if share * s.gain >= asked] or drowned


def _with_kinks(parent: Fitted, hypothesis: Hypothesis) -> Array:
    """Return the starts (K, p) of the last part, of a law that acts about a place also at the sharpest kinks."""
    starts, names = starts_of(hypothesis), [u.name for u in hypothesis.parts[-1].shared]
    places = {names.index(f"centre_{a}"): "xyz".index(a) for a in "xyz" if f"centre_{a}" in names}
    if "width" not in names or "width" not in hypothesis.parts[-1].variant.idle or not places:
        return starts
    narrow = starts[np.argmin(starts[:, names.index("width")])].copy()
    narrow[names.index("width")] *= NARROWER
    found = []
    for kink in kinks(parent.ground.world, parent.ground.recording)[:KINKS]:
        for start in (narrow, starts[0]):
            row = start.copy()
            for column, axis in places.items():
                row[column] = kink.place[axis]
            found.append(row)
    return np.concatenate([starts, *[f[None] for f in found]])


def _sudden(parent: Fitted, hypothesis: Hypothesis, undisturbed: Point, keep: int) -> list[Start]:
    """Return the starts that describe the data best as they are, with states of fits to the whole runs, to their first
    samples, and to what precedes the first kink (`undisturbed`)."""
    states = (parent.point, parent.early, undisturbed)
    points = [_point(parent, hypothesis, s, at) for s in starts_of(hypothesis) for at in states]
    problem = parent.ground.problem(hypothesis)
    problem.settings = parent.problem.settings
    costs = problem.costs(points, 1.0) / parent.scale**2
    order = np.argsort(costs)[: 2 * keep]
    return [Start(hypothesis, points[i], parent.cost - float(costs[i]), growing=True) for i in order.tolist()]


def _undisturbed(parent: Fitted) -> Point:
    """Return the parent's point with initial states fitted to each run up to its first kink.

    Of a run that struck something the whole gives a mean velocity, and its first samples a noisy one.
    """
    ground = parent.ground
    first: dict[str, float] = {}
    for kink in kinks(ground.world, ground.recording):
        first[kink.run] = min(first.get(kink.run, np.inf), kink.time)
    runs = []
    for run in ground.recording.runs:
        until = max(FEWEST, int(BEFORE * np.searchsorted(run.times, first.get(run.name, np.inf))))
        runs.append(run.rows(np.arange(len(run.times)) < until) if run.name in first else run)
    part = ground.cut(runs, ground.noise)
    start = part.problem(parent.hypothesis).start().states
    mixed = tuple(s if run.name in first else o for run, s, o in zip(runs, start, parent.point.states, strict=True))
    found = fit(part, parent.hypothesis, Point(parent.values, mixed), iterations=ground.settings.full, scale=1.0)
    return Point(parent.values, found.point.states)


def _rescaled(parent: Fitted, hypothesis: Hypothesis, projection: Projection, keep: int) -> list[Start]:
    """Return the factors on a period that describe the beginning of the data best, from states read off the data."""
    starts = starts_of(hypothesis)
    problem = parent.ground.problem(hypothesis)
    problem.settings = parent.problem.settings
    fresh = problem.start().states
    points = [Point(np.concatenate([parent.values, s]), fresh) for s in starts]
    problem.settings = replace(problem.settings, iterations=BRIEF)
    ends = []
    for share in BEGINNINGS:
        fitted = [problem.descend(p, share) for p in points]
        order = sorted(fitted, key=lambda m: m.cost)
        points = [m.point for m in order[: max(2, len(order) // 4)]]
        ends = order
    found = [Start(hypothesis, m.point, np.inf, growing=True) for m in ends[:2]]
    slope = _scored(parent, replace_starts(hypothesis), projection, 1, 1.0)
    return [*slope, *found][: 1 + keep]


def _dropped(parent: Fitted, hypothesis: Hypothesis, projection: Projection, keep: int, share: float) -> list[Start]:
    """Return onsets from which on frames of one run may have been dropped or repeated, all scored by one rollout.

    A shift displaces what is seen later by itself times the velocity, whatever the onset.
    """
    part = hypothesis.parts[-1]
    observer = hypothesis.world.observer
    r = next(i for i, run in enumerate(parent.ground.recording.runs) if observer and run.name == observer.shift_run)
    run, readout = parent.ground.recording.runs[r], parent.ground.readouts[r]
    stamps = run.times - run.times[0] + run.lead
    if len(stamps) < 8:
        return []
    frame = float(np.median(np.diff(stamps)))
    names = [u.name for u in part.shared]
    problem = parent.ground.problem(hypothesis)
    added = np.array([[{"shift": s, "shift_time": float(stamps[0])}[n] for n in names] for s in (0.0, 0.1 * frame)])
    shared = np.concatenate([np.repeat(parent.values[None], 2, 0), added], axis=1)
    own = np.repeat(_point(parent, hypothesis, added[0]).states[r][0][None], 2, 0)
    (one,) = problem.evaluate([(problem.runs[r][0], shared, own)], 1.0)
    slope = (one.residuals[1] - one.residuals[0]) / (0.1 * frame)
    onsets = 0.5 * (stamps[2:-3] + stamps[3:-2])
    late = stamps[readout.rows()][:, None] > onsets[None]
    every = np.zeros((len(projection.rest), len(onsets)))
    before, own_slopes = sum(map(len, projection.bases[:r])), projection.off_states(r, slope[:, None] * late)
    every[before : before + len(own_slopes)] = own_slopes
    every = projection.off_shared(every)
    square = (every**2).sum(axis=0)
    shift = -(every.T @ projection.rest) / np.maximum(square, 1e-12 * square.max(initial=1.0))
    limit = max(abs(u.lower) for u in part.shared if u.name == "shift")
    gain = np.where(np.abs(shift) < 0.5 * frame, 0.0, shift**2 * square) / parent.scale**2  # frames are lost whole
    shift = np.clip(shift, -limit, limit)
    found = []
    for i in np.argsort(-gain)[:keep]:
        values = np.array([{"shift": shift[i], "shift_time": onsets[i]}[n] for n in names])
        found.append(Start(hypothesis, _point(parent, hypothesis, values), float(gain[i])))
    asked = 2.0 * (parent.ground.settings.nats + hypothesis.cost(parent.ground.settings))
    return [s for s in found if share * s.gain >= asked]
