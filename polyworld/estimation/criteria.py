"""Judge a hypothesis by more than a small residual: evidence for its unknowns, and predictions of data left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import Design
from polyworld.estimation.profile import Fit
from polyworld.estimation.projection import column_basis
from polyworld.estimation.unknown import Unknown

Array = NDArray[np.float64]

CUTS = (0.5, 0.625, 0.75, 0.875)  # of a single run's time: what comes before predicts what comes next
PRIOR_WIDTH = 10.0  # typical changes: how far an unknown that the rest of the data do not determine may stray


def extended_bic(chi2: float, unknowns: int, observations: float, effects: int, candidates: int) -> float:
    """Return chi2 + k log n + 2 m log(candidates): Chen & Chen 2008 (Biometrika 95, 759), with gamma = 1.

    unknowns k: beyond the base's. observations n: independent ones. effects m: chosen among the candidates.
    """
    return chi2 + unknowns * float(np.log(max(observations, 2.0))) + 2.0 * effects * float(np.log(max(candidates, 1)))


@dataclass(frozen=True)
class HeldOutGain:
    """Mean gain over folds, in chi2, of one hypothesis' predictions of left-out data over another's; its error."""

    gain: float
    error: float

    def exceeds(self, errors: float) -> bool:
        """Return whether the gain is more than so many standard errors."""
        return self.gain > errors * self.error


def held_out_gain(better: Array, worse: Array) -> HeldOutGain:
    """Return the gain from two hypotheses' chi2 (F,) on the same folds."""
    gains = worse - better
    folds = len(gains)
    error = float(np.std(gains, ddof=1) / np.sqrt(folds)) if folds > 1 else float("inf")
    return HeldOutGain(float(np.mean(gains)), error)


def held_out(design: Design, unknowns: tuple[Unknown, ...], fit: Fit) -> Array:
    """Return chi2 (F,) of data left out, at shared unknowns that the rest of the data give.

    Several runs: each is left out in turn, its initial state fitted to it. One run: intervals are predicted from all
    that comes before. Unknowns move as the linearisation at the fit has it, so this costs no rollout (Cook & Weisberg
    1982, Residuals and Influence, chapter 5); one that the rest of the data do not determine goes back to its
    start.
    """
    if len(design.runs) > 1:
        return _runs_left_out(unknowns, fit)
    return _intervals_left_out(design, unknowns, fit)


def _runs_left_out(unknowns: tuple[Unknown, ...], fit: Fit) -> Array:
    free = _free(unknowns, fit)
    projected = [_projected(fit, r, free) for r in range(len(fit.states))]
    information = [a.T @ a for a, _ in projected]
    gradient = [a.T @ res for a, res in projected]
    prior, pull = _prior(unknowns, fit, free)
    whole, slope = sum(information, prior), sum(gradient, pull)
    chi2 = []
    for (a, res), own, part in zip(projected, information, gradient, strict=True):
        shift = -np.linalg.lstsq(whole - own, slope - part, rcond=1e-12)[0]
        rest = res + a @ shift
        chi2.append(float(rest @ rest))
    return np.array(chi2)


def _projected(fit: Fit, run: int, free: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return derivatives by shared unknowns and residuals of one run, less what its initial state can take up."""
    a, b, res = fit.linear.a[run][:, free], fit.linear.b[run], fit.linear.r[run]
    basis = column_basis(b)
    return a - basis @ (basis.T @ a), res - basis @ (basis.T @ res)


def _intervals_left_out(design: Design, unknowns: tuple[Unknown, ...], fit: Fit) -> Array:
    free = _free(unknowns, fit)
    own = design.runs[0]
    a, b, res = fit.linear.a[0][:, free], fit.linear.b[0], fit.linear.r[0]
    both = np.concatenate([a, b], axis=1)
    prior, pull = _prior(unknowns, fit, free)
    size = both.shape[1]
    wide, push = np.zeros((size, size)), np.zeros(size)
    wide[: len(prior), : len(prior)], push[: len(pull)] = prior, pull
    chi2 = []
    for cut, end in zip(CUTS, (*CUTS[1:], 1.0), strict=True):
        early, there = own.before(cut), own.before(end)
        late = there & ~early
        x = both[early]
        shift = -np.linalg.lstsq(x.T @ x + wide, x.T @ res[early] + push, rcond=1e-12)[0]
        rest = res[late] + both[late] @ shift
        chi2.append(float(rest @ rest))
    return np.array(chi2)


def _free(unknowns: tuple[Unknown, ...], fit: Fit) -> NDArray[np.bool_]:
    lower = np.array([u.lower for u in unknowns])
    upper = np.array([u.upper for u in unknowns])
    inside: NDArray[np.bool_] = (fit.values > lower) & (fit.values < upper)
    return inside


def _prior(unknowns: tuple[Unknown, ...], fit: Fit, free: NDArray[np.bool_]) -> tuple[Array, Array]:
    weight = np.array([1.0 / (PRIOR_WIDTH * u.typical) ** 2 for u in unknowns])[free]
    away = (fit.values - np.array([u.start for u in unknowns]))[free]
    return np.diag(weight), weight * away
