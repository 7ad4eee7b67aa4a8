"""Predict every fold of the data without it: parameters by one Gauss-Newton step, initial states from what is left.

Where there are runs enough a fold is a run: shared unknowns without it, its own initial state refitted to it, since
that belongs to no law. Of fewer runs a fold is a stretch of one; the run's single initial state, from which the
stretch follows by the chain of all motion before, is then estimated from the rest of the run.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.readout import CHANNELS
from polyworld.estimation.robust import huber_weights
from polyworld.estimation.unknown import Unknown
from polyworld.gap.fitting import Fitted, fit, robust_scale
from polyworld.gap.ground import Ground, ground_of
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.settings import GapSettings
from polyworld.world import World

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TRIMMED = 5.0  # robust standard deviations of a run's residuals to which single ones are cut
REFITS = 3  # of the initial state of a run left out
FARTHEST = 100.0  # ordinary changes by which one step may move it: linear steps of what hardly shows go anywhere
VAGUE = 1e-6  # information of an ordinary change: unknowns are no vaguer than a thousand of these
CHORDS = 2  # further steps without a stretch, with the slopes of the fit
SPINS = 6  # channel from which on those of an object are spins
FEW = 0.1  # share of a run's values below which spins are no series
RIDGE = 1e-9  # of the diagonal


@dataclass(frozen=True)
class Fold:
    """A run, or the instants first to last (excluded) of one. whole: whether it is all of it."""

    run: int
    first: int
    last: int
    whole: bool


def folds_of(ground: Ground, settings: GapSettings) -> tuple[Fold, ...]:
    """Return the folds of a ground."""
    runs = ground.recording.runs
    if len(runs) >= settings.fewest_runs:
        return tuple(Fold(r, 0, len(run.times), True) for r, run in enumerate(runs))
    found = []
    lengths = np.array([len(r.times) for r in runs])
    for r, run in enumerate(runs):
        number = max(2, round(settings.folds * len(run.times) / float(lengths.sum())))
        edges = np.linspace(0, len(run.times), number + 1).astype(int)
        found += [Fold(r, int(a), int(b), False) for a, b in itertools.pairwise(edges)]
    return tuple(found)


def predict_left_out(fitted: Fitted, folds: Sequence[Fold]) -> None:
    """Fill in what a hypothesis predicts of every fold without it."""
    settings = fitted.ground.settings
    if all(f.whole for f in folds):
        _by_runs(fitted)
    else:
        _by_stretches(fitted, folds)
    fitted.simplicity = fitted.hypothesis.cost(settings)
    fitted.price = fitted.simplicity + fitted.hypothesis.surprise(fitted.values, settings)


@dataclass(frozen=True)
class Reduced:
    """Normal equations of shared unknowns by run, states eliminated: information (R, S, S), pull (R, S) towards less
    misfit; steps of the states where shared ones stay (R of (n,)), and their answers to shared ones (R of (n, S))."""

    information: Array
    pull: Array
    steps: list[Array]
    answers: list[Array]


def reduced(fitted: Fitted) -> Reduced:
    """Eliminate the initial states of every run."""
    s = len(fitted.values)
    runs = len(fitted.slopes)
    information, pull = np.zeros((runs, s, s)), np.zeros((runs, s))
    steps, answers = [], []
    threshold = fitted.problem.settings.huber
    for r, (one, states) in enumerate(zip(fitted.slopes, fitted.of_states(), strict=True)):
        w = huber_weights(one.residuals, threshold)
        prior = fitted.problem.runs[r][0].states.prior
        yw = one.states * w[:, None]
        own = yw.T @ one.states
        scaled = fitted.scale**2 * np.where(np.isfinite(prior[:, 1]), prior[:, 1], np.inf) ** -2.0
        own[np.diag_indices(len(own))] += scaled + RIDGE * (np.diag(own).max(initial=0.0) + 1e-12)
        gradient = yw.T @ one.residuals + scaled * np.where(scaled > 0.0, states - prior[:, 0], 0.0)
        border = yw.T @ one.shared
        both = np.linalg.solve(own, np.concatenate([gradient[:, None], border], axis=1))
        steps.append(-both[:, 0])
        answers.append(-both[:, 1:])
        aw = one.shared * w[:, None]
        information[r] = aw.T @ one.shared - border.T @ both[:, 1:]
        pull[r] = -(aw.T @ one.residuals - border.T @ both[:, 0])
    return Reduced(information, pull, steps, answers)


def shared_step(fitted: Fitted, information: Array, pull: Array) -> Array:
    """Return the step (S,) of shared unknowns that normal equations ask for, within bounds."""
    lower, upper, at = fitted.problem.lower, fitted.problem.upper, fitted.values
    typical = fitted.problem.typical
    matrix = information * typical[:, None] * typical + fitted.scale**2 * VAGUE * np.eye(len(at))
    return bounded_step(matrix, pull * typical, at, lower, upper, typical) - at


def bounded_step(matrix: Array, pull: Array, at: Array, lower: Array, upper: Array, typical: Array) -> Array:
    """Return where normal equations in units of typical (n,) lead within bounds: what a bound stops takes no part."""
    free = np.ones(len(at), dtype=bool)
    moved = at.copy()
    for _ in range(3):
        if not free.any():
            break
        moved = at.copy()
        moved[free] += typical[free] * np.linalg.lstsq(matrix[np.ix_(free, free)], pull[free], rcond=1e-12)[0]
        beyond = ((moved < lower) & (at <= lower)) | ((moved > upper) & (at >= upper))
        if not beyond[free].any():
            break
        free &= ~beyond
    clipped: Array = np.clip(moved, lower, upper)
    return clipped


def _by_runs(fitted: Fitted) -> None:
    found = reduced(fitted)
    runs = len(fitted.slopes)
    shared = np.repeat(fitted.values[None], runs, axis=0)
    states = []
    total, pull = found.information.sum(axis=0), found.pull.sum(axis=0)
    for r in range(runs):
        step = shared_step(fitted, total - found.information[r], pull - found.pull[r])
        shared[r] += step
        most = FARTHEST * fitted.problem.runs[r][0].states.typical
        states.append(fitted.of_states()[r] + np.clip(found.steps[r] + found.answers[r] @ step, -most, most))
    errors, residuals = refit_states(fitted, shared, states)
    fitted.errors, fitted.left_out = errors, shared
    fitted.grids = tuple(g.grid(x) for g, x in zip(fitted.ground.readouts, residuals, strict=True))


def refit_states(
    fitted: Fitted, shared: Array, states: Sequence[Array], refits: int = REFITS
) -> tuple[Array, list[Array]]:
    """Refit the initial state of each run at shared unknowns (R, S) of its own; return its errors (R,), residuals.

    What priors say against a state counts as a residual does: no unlikely spin may make up for a law that is missing.
    """
    problem = fitted.problem
    best = np.full(len(states), np.inf)
    kept = [one.residuals for one in fitted.slopes]
    columns = [g.columns() for g in fitted.ground.readouts]
    states = [s.copy() for s in states]
    for turn in range(refits + 1):
        settings, widths = [], []
        for run, common, own in zip(problem.runs, shared, states, strict=True):
            n = len(own) if turn < refits else 0
            step = 2.0 * run[0].states.typical[:n] * problem.settings.step
            points = np.repeat(own[None], n + 1, axis=0)
            points[1 + np.arange(n), np.arange(n)] += step
            settings.append((run[0], np.repeat(common[None], n + 1, axis=0), points))
            widths.append(step)
        for r, (one, width) in enumerate(zip(problem.evaluate(settings, 1.0), widths, strict=True)):
            residual, prior = one.residuals[0], problem.runs[r][0].states.prior
            unlikely = float((((states[r] - prior[:, 0]) / prior[:, 1]) ** 2).sum())
            error = run_error(residual, len(states[r]), columns[r]) * np.sqrt(1.0 + unlikely / len(residual))
            if error < best[r]:
                best[r], kept[r] = error, residual
            if not len(width):
                continue
            slopes = ((one.residuals[1:] - residual) / width[:, None]).T
            scale = max(1.0, robust_scale(residual, columns[r]))
            inverse = (scale / prior[:, 1]) ** 2
            w = huber_weights(residual, fitted.ground.settings.soft * scale)
            own_matrix = (slopes * w[:, None]).T @ slopes
            diagonal = np.diag(own_matrix)
            own_matrix = own_matrix + np.diag(inverse + 1e-6 * diagonal + 1e-9 * diagonal.max() + 1e-12)
            pull = (slopes * w[:, None]).T @ residual + inverse * np.where(inverse > 0.0, states[r] - prior[:, 0], 0.0)
            most = FARTHEST * problem.runs[r][0].states.typical
            states[r] = states[r] - np.clip(np.linalg.solve(own_matrix, pull), -most, most)
    return best, kept


def run_error(residuals: Array, states: int, columns: Ints) -> float:
    """Return the root mean square of residuals (m,), the largest trimmed, for so many fitted states; of spins where
    these are described worse. columns (m,): the channel of each."""
    size = np.abs(residuals)
    trimmed = np.minimum(size, TRIMMED * robust_scale(residuals, columns) + 1e-12)
    spins = columns % CHANNELS >= SPINS
    if not FEW * len(size) < spins.sum() < len(size):
        return float(np.sqrt((trimmed**2).sum() / max(len(size) - states, 1)))
    rest = float(np.sqrt((trimmed[~spins] ** 2).sum() / max((~spins).sum() - states, 1)))
    return max(rest, float(np.sqrt(np.mean(trimmed[spins] ** 2))))


def _by_stretches(fitted: Fitted, folds: Sequence[Fold]) -> None:
    """Leave stretches out of runs whose initial states are then estimated without them.

    Steps take the slopes of the fit; the rest of the runs is simulated again after each, since collisions bend them.
    """
    problem, s, ground = fitted.problem, len(fitted.values), fitted.ground
    first = s + np.concatenate([[0], np.cumsum([len(own) for own in fitted.of_states()])]).astype(int)
    typical = np.concatenate([problem.typical, *(run[0].states.typical for run in problem.runs)])
    bounds = [
        np.concatenate([b, np.full(first[-1] - s, e)]) for b, e in ((problem.lower, -np.inf), (problem.upper, np.inf))
    ]
    slopes = []
    for r, one in enumerate(fitted.slopes):
        own = np.zeros((len(one.residuals), first[-1]))
        own[:, :s], own[:, first[r] : first[r + 1]] = one.shared, one.states
        slopes.append(own * typical)
    vague = VAGUE * np.eye(first[-1])
    fits, expected = [], []
    for fold in folds:
        kept = [~_inside(ground, fold) if r == fold.run else np.ones(len(own), bool) for r, own in enumerate(slopes)]
        w = [
            huber_weights(one.residuals, problem.settings.huber) * k for one, k in zip(fitted.slopes, kept, strict=True)
        ]
        matrix = np.sum([(own * v[:, None]).T @ own for own, v in zip(slopes, w, strict=True)], axis=0)
        left = slopes[fold.run][~kept[fold.run]]
        spread = np.einsum("ms,st,mt->m", left, np.linalg.pinv(matrix + vague, hermitian=True), left)
        expected.append(float(np.sqrt(1.0 + spread.mean())) if len(left) else 1.0)
        fits.append((w, matrix + fitted.scale**2 * vague))
    points = np.repeat(np.concatenate([fitted.values, *fitted.of_states()])[None], len(folds), axis=0)
    residuals = [[one.residuals for one in fitted.slopes] for _ in folds]
    costs = np.full(len(folds), np.inf)
    for turn in range(CHORDS + 1):
        trial = points.copy()
        for k, (w, matrix) in enumerate(fits):
            pull = -sum(
                ((own * v[:, None]).T @ x for own, v, x in zip(slopes, w, residuals[k], strict=True)),
                np.zeros(first[-1]),
            )
            trial[k] = bounded_step(matrix, pull, points[k], bounds[0], bounds[1], typical)
        jobs = [(run[0], trial[:, :s], trial[:, first[r] : first[r + 1]]) for r, run in enumerate(problem.runs)]
        evaluated = problem.evaluate(jobs, 1.0)
        for k, (w, _) in enumerate(fits):
            now = [one.residuals[k] for one in evaluated]
            cost = sum(float(v @ x**2) for v, x in zip(w, now, strict=True))
            if turn == 0 or cost < costs[k]:
                points[k], residuals[k], costs[k] = trial[k], now, cost
    grids = [np.full(g.measured.shape, np.nan) for g in ground.readouts]
    errors = np.zeros(len(folds))
    for k, fold in enumerate(folds):
        rows, readout = _inside(ground, fold), ground.readouts[fold.run]
        errors[k] = run_error(residuals[k][fold.run][rows], 0, readout.columns()[rows])
        grids[fold.run][fold.first : fold.last] = readout.grid(residuals[k][fold.run])[fold.first : fold.last]
    fitted.errors, fitted.grids, fitted.expected = errors, tuple(grids), np.array(expected)
    fitted.left_out = points[:, :s]


def _inside(ground: Ground, fold: Fold) -> NDArray[np.bool_]:
    rows = ground.readouts[fold.run].rows()
    inside: NDArray[np.bool_] = (rows >= fold.first) & (rows < fold.last)
    return inside


def fold_counts(ground: Ground, folds: Sequence[Fold]) -> Array:
    """Return how many values (F,) each fold has, of spins only where nothing else was measured."""
    found = []
    for fold in folds:
        columns = ground.readouts[fold.run].columns()[_inside(ground, fold)]
        rest = float((columns % CHANNELS < SPINS).sum())
        found.append(rest or float(len(columns)))
    return np.array(found)


def examined(
    world: World, recording: Recording, base: tuple[Unknown, ...] = (), settings: GapSettings | None = None
) -> Fitted:
    """Fit a world to a recording and predict every fold of it. Raises ValueError where the recording does not fit."""
    settings = settings or GapSettings()
    ground = ground_of(world, recording, settings)
    return predicted(fit(ground, Hypothesis(ground.world, base), growing=True, scale=1.0))


def predicted(fitted: Fitted) -> Fitted:
    """Return a fit with what it predicts of every fold without it."""
    predict_left_out(fitted, folds_of(fitted.ground, fitted.ground.settings))
    return fitted
