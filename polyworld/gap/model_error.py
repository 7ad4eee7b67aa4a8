"""Admit model error: smooth residuals that are larger than noise, as a term of the noise model.

Real residuals are never only noise. What a law leaves is smooth in time, so it shows in the low cosine modes of the
whitened residuals. Their variance is estimated from one fit, and all hypotheses are compared again with low modes
weighted down by it (Kennedy & O'Hagan 2001, J. R. Stat. Soc. B 63, 425, call the term model inadequacy). A hypothesis
that leads only because it takes up what a neighbour's law leaves undone loses its lead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import Design
from polyworld.estimation.goodness import MODES, cosines, projected
from polyworld.estimation.noise import Kind, Noise
from polyworld.estimation.trial import FittedHypothesis

Array = NDArray[np.float64]

LEFT = 0.3  # part of a mode that initial states and shared values must have left for it to be counted


@dataclass(frozen=True)
class ModelError:
    """Variances of low modes and of all others, in units of the noise's, by kind of measurement, each at least 1.

    modes[kind] (MODES,), rest[kind]. bases[run]: (rows (q,), orthonormal (q, k), kind, mode numbers (k,)) per series.
    """

    design: Design
    noise: Noise
    modes: dict[Kind, Array]
    rest: dict[Kind, float]

    @property
    def size(self) -> dict[Kind, float]:
        """Root mean square of the smooth residuals in units of the noise, by kind; 0 where they are noise."""
        return {k: float(np.sqrt(max(float(v.mean()) - 1.0, 0.0))) for k, v in self.modes.items()}

    def whiten(self, run: int, values: Array) -> Array:
        """Weigh whitened residuals or slopes (m, ...) of a run down by the model error."""
        found = np.array(values, dtype=float)
        for s in self.design.runs[run].series:
            rows, basis = self._basis(run, s.where, self.design.runs[run].times[s.rows])
            rest = 1.0 / np.sqrt(self.rest[s.kind])
            low = 1.0 / np.sqrt(self.modes[s.kind][: basis.shape[1]])
            own = found[rows]
            along = basis.T @ own
            weight = (low - rest).reshape(-1, *[1] * (own.ndim - 1))
            found[rows] = rest * own + np.tensordot(basis, weight * along, axes=1)
        return found

    def _basis(self, run: int, where: slice, times: Array) -> tuple[NDArray[np.int64], Array]:
        kept = np.flatnonzero(self.noise.kept[run][where])
        count = min(MODES, len(kept) // 3)
        if count < 1:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 0))
        return kept + where.start, cosines(times[kept], count)


def no_model_error(trial: FittedHypothesis) -> ModelError:
    """Return the term as it is where residuals are only noise."""
    kinds = list(trial.bench.noise.correlation)
    return ModelError(
        trial.bench.design, trial.bench.noise, {k: np.ones(MODES) for k in kinds}, dict.fromkeys(kinds, 1.0)
    )


def model_error_of(trial: FittedHypothesis) -> ModelError:
    """Estimate the term from a fit: the mean energy of each low mode over all series, fitted directions taken out.

    Pairs of neighbouring modes are pooled, and variances fall with the mode's number, as those of smooth courses do.
    """
    design, noise = trial.bench.design, trial.bench.noise
    none = no_model_error(trial)
    residuals, own, shared = projected(trial.fit)
    energy = {k: np.zeros(MODES) for k in none.modes}
    left = {k: np.zeros(MODES) for k in none.modes}
    rest = {k: [0.0, 0.0] for k in none.modes}
    for r in design.runs:
        fitted = np.concatenate([own[r.index], shared[r.index]], axis=1)
        for s in r.series:
            rows, basis = none._basis(r.index, s.where, r.times[s.rows])
            if not basis.shape[1]:
                continue
            amplitude = basis.T @ residuals[r.index][rows]
            free = np.clip(1.0 - ((basis.T @ fitted[rows]) ** 2).sum(axis=1), 0.0, 1.0)
            use = free > LEFT
            count = basis.shape[1]
            energy[s.kind][:count] += np.where(use, amplitude**2, 0.0)
            left[s.kind][:count] += np.where(use, free, 0.0)
            total = float(residuals[r.index][rows] @ residuals[r.index][rows])
            rest[s.kind][0] += max(total - float(amplitude @ amplitude), 0.0)
            rest[s.kind][1] += len(rows) - count
    modes, others = {}, {}
    for kind in none.modes:
        others[kind] = max(rest[kind][0] / rest[kind][1], 1.0) if rest[kind][1] else 1.0
        pooled = np.maximum(_pooled(energy[kind], left[kind]), others[kind])
        modes[kind] = np.maximum.accumulate(pooled[::-1])[::-1]
    return ModelError(design, noise, modes, others)


def _pooled(energy: Array, left: Array) -> Array:
    pairs = np.repeat(np.arange(MODES // 2), 2)
    total, weight = np.bincount(pairs, energy), np.bincount(pairs, left)
    mean = np.where(weight > 0.0, total / np.maximum(weight, 1e-300), 1.0)
    result: Array = mean[pairs]
    return result


@dataclass(frozen=True)
class RunEvidence:
    """What each run says of the shared values near a fit, its own initial state profiled out.

    chi2 of run r after a change d of the shared values: level[r] + 2 slope[r] d + d^T curvature[r] d. prior (S,):
    weight of a typical change, which keeps what the data do not determine. free (S,): values not at a bound.
    """

    level: Array
    slope: Array
    curvature: Array
    prior: Array
    free: NDArray[np.bool_]

    def fitted(self, weights: Array) -> tuple[float, Array]:
        """Least chi2 over runs weighted (R,), and the change (S,) of the shared values that reaches it."""
        matrix = np.tensordot(weights, self.curvature, axes=1) + np.diag(self.prior)
        vector = weights @ self.slope
        change = np.zeros(len(self.prior))
        if self.free.any():
            block = np.ix_(self.free, self.free)
            change[self.free] = -np.linalg.lstsq(matrix[block], vector[self.free], rcond=1e-12)[0]
        return float(weights @ self.costs(change)), change

    def costs(self, change: Array) -> Array:
        """chi2 (R,) of each run after a change of the shared values."""
        costs: Array = self.level + 2.0 * self.slope @ change + np.einsum("i,rij,j->r", change, self.curvature, change)
        return costs


def run_evidence(trial: FittedHypothesis, error: ModelError) -> RunEvidence:
    """Return what each run says of a fitted hypothesis when model error is admitted."""
    linear, unknowns = trial.fit.linear, trial.hypothesis.unknowns
    s = len(unknowns)
    level, slope, curvature = [], [], []
    for run, (r, a, b) in enumerate(zip(linear.r, linear.a, linear.b, strict=True)):
        white = error.whiten(run, np.concatenate([r[:, None], a, b], axis=1))
        r, a, b = white[:, 0], white[:, 1 : 1 + s], white[:, 1 + s :]
        if b.shape[1]:
            basis, size, _ = np.linalg.svd(b / np.maximum(np.linalg.norm(b, axis=0), 1e-300), full_matrices=False)
            basis = basis[:, size > 1e-8 * size.max(initial=0.0)]
            r, a = r - basis @ (basis.T @ r), a - basis @ (basis.T @ a)
        level.append(float(r @ r))
        slope.append(a.T @ r)
        curvature.append(a.T @ a)
    lower, upper = np.array([u.lower for u in unknowns]), np.array([u.upper for u in unknowns])
    typical = np.array([u.typical for u in unknowns])
    inside = (trial.values > lower) & (trial.values < upper)
    return RunEvidence(
        np.array(level),
        np.array(slope).reshape(len(slope), s),
        np.array(curvature).reshape(len(slope), s, s),
        (0.1 / typical) ** 2,
        inside,
    )
