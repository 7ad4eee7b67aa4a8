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
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.goodness import MODES, cosines, projected
from polyworld.estimation.noise import Kind, Noise
from polyworld.estimation.projection import column_basis

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ModelError:
    """Variances of low modes and of all others, in units of the noise's, by kind of measurement, each at least 1.

    modes[kind] (MODES,), rest[kind].
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
        """Weigh whitened residuals or slopes (m, n) of a run down by the model error."""
        found = np.array(values, dtype=float)
        for kind, rows, basis in _low_modes(self.design, self.noise, run):
            rest = 1.0 / np.sqrt(self.rest[kind])
            low = 1.0 / np.sqrt(self.modes[kind][: basis.shape[1]])
            own = found[rows]
            found[rows] = rest * own + basis @ ((low - rest)[:, None] * (basis.T @ own))
        return found


def _low_modes(design: Design, noise: Noise, run: int) -> list[tuple[Kind, NDArray[np.int64], Array]]:
    """Kind, rows (q,) and orthonormal low cosine modes (q, k) of every series of a run that is long enough."""
    found = []
    for s in design.runs[run].series:
        kept = np.flatnonzero(noise.kept[run][s.where])
        count = min(MODES, len(kept) // 3)
        if count:
            times = design.runs[run].times[s.rows[kept]]
            found.append((s.kind, kept + s.where.start, cosines(times, count)))
    return found


def model_error_of(trial: FittedHypothesis, left: float) -> ModelError:
    """Estimate the term from a fit: the mean energy of each low mode over all series, fitted directions taken out.

    Pairs of neighbouring modes are pooled, and variances fall with the mode's number, as those of smooth courses do.
    left: part of a mode that fitted directions must leave for it to be counted.
    """
    design, noise = trial.context.design, trial.context.noise
    residuals, own, shared = projected(trial.fit)
    energy = {kind: np.zeros((2, MODES)) for kind in noise.correlation}  # of the modes, and its expectation for noise
    others = {kind: np.zeros(2) for kind in noise.correlation}
    for r in design.runs:
        fitted = np.concatenate([own[r.index], shared[r.index]], axis=1)
        for kind, rows, basis in _low_modes(design, noise, r.index):
            power = (basis.T @ residuals[r.index][rows]) ** 2
            free = np.clip(1.0 - ((basis.T @ fitted[rows]) ** 2).sum(axis=1), 0.0, 1.0)
            energy[kind][:, : len(power)] += np.where(free > left, [power, free], 0.0)
            total = float(residuals[r.index][rows] @ residuals[r.index][rows])
            others[kind] += max(total - float(power.sum()), 0.0), len(rows) - len(power)
    rest = {kind: max(total / count, 1.0) if count else 1.0 for kind, (total, count) in others.items()}
    modes = {}
    for kind, pairs in energy.items():
        found, expected = np.repeat(pairs.reshape(2, -1, 2).sum(axis=2), 2, axis=1)
        pooled = np.where(expected > 0.0, found / np.maximum(expected, 1e-300), 1.0)
        modes[kind] = np.maximum.accumulate(np.maximum(pooled, rest[kind])[::-1])[::-1]
    return ModelError(design, noise, modes, rest)


@dataclass(frozen=True)
class RunEvidence:
    """Evidence of each run on the shared values near a fit, its own initial state profiled out.

    chi2 of run r after a change d of the shared values: level[r] + 2 slope[r] d + d^T curvature[r] d. prior (S,):
    weight of a typical change, which keeps what the data do not determine. free (S,): values not at a bound.
    """

    level: Array
    slope: Array
    curvature: Array
    prior: Array
    free: NDArray[np.bool_]

    def fitted(self, weights: Array) -> tuple[float, Array]:
        """Return the least chi2 over runs weighted (R,), and the change (S,) of the shared values that reaches it."""
        matrix = np.tensordot(weights, self.curvature, axes=1) + np.diag(self.prior)
        vector = weights @ self.slope
        change = np.zeros(len(self.prior))
        if self.free.any():
            block = np.ix_(self.free, self.free)
            change[self.free] = -np.linalg.lstsq(matrix[block], vector[self.free], rcond=1e-12)[0]
        return float(weights @ self.costs(change)), change

    def costs(self, change: Array) -> Array:
        """Return chi2 (R,) of each run after a change of the shared values."""
        costs: Array = self.level + 2.0 * self.slope @ change + np.einsum("i,rij,j->r", change, self.curvature, change)
        return costs


def run_evidence(trial: FittedHypothesis, error: ModelError) -> RunEvidence:
    """Return what each run says of a fitted hypothesis when model error is admitted."""
    linear, unknowns = trial.fit.linear, trial.hypothesis.unknowns
    s = len(unknowns)
    level, slope, curvature = [], [], []
    for run, (r, a, b) in enumerate(zip(linear.r, linear.a, linear.b, strict=True)):
        white = error.whiten(run, np.concatenate([r[:, None], a, b], axis=1))
        basis = column_basis(white[:, 1 + s :])
        both = white[:, : 1 + s] - basis @ (basis.T @ white[:, : 1 + s])
        product = both.T @ both
        level.append(product[0, 0])
        slope.append(product[1:, 0])
        curvature.append(product[1:, 1:])
    lower, upper = np.array([u.lower for u in unknowns]), np.array([u.upper for u in unknowns])
    typical = np.array([u.typical for u in unknowns])
    inside = (trial.values > lower) & (trial.values < upper)
    return RunEvidence(np.array(level), np.array(slope), np.array(curvature), (0.1 / typical) ** 2, inside)
