"""Ask whether the same effects are chosen whichever runs are there, and whether they predict runs left out.

Runs are left out a quarter at a time, and in turn (Stone 1974, J. R. Stat. Soc. B 36, 111): whole runs, since what a
model lacks is alike within a run. Hypotheses move along their linearisations, so that
neither costs a simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.criteria import extended_bic
from polyworld.estimation.trial import FittedHypothesis
from polyworld.gap.model_error import ModelError, RunEvidence, run_evidence

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contest:
    """Fitted hypotheses compared with model error admitted.

    evidence[h]: of each; price (H,): what its unknowns and the choice of its effects cost (extended BIC).
    """

    trials: tuple[FittedHypothesis, ...]
    evidence: tuple[RunEvidence, ...]
    price: Array

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.evidence[0].level)

    def scores(self, weights: Array) -> Array:
        """Extended BIC (H,) of every hypothesis with runs weighted (R,)."""
        return np.array([e.fitted(weights)[0] for e in self.evidence]) + self.price

    def subsets(self, count: int, seed: int) -> Array:
        """Weights (B, R), 0 or 1, that leave out a quarter of the runs, at least one: all such subsets of fewer than
        eight runs, else `count` random ones (delete-d jackknife, Shao & Wu 1989, Ann. Stat. 17, 1176)."""
        left_out = max(1, self.runs // 4)
        if left_out == 1:
            return np.ones((self.runs, self.runs)) - np.eye(self.runs)
        rng = np.random.default_rng(seed)
        weights = np.ones((count, self.runs))
        for row in weights:
            row[rng.choice(self.runs, left_out, replace=False)] = 0.0
        return weights

    def held_out(self) -> Array:
        """chi2 (H, R) of every run at shared values that the others give, its own initial state fitted to it."""
        found = np.empty((len(self.evidence), self.runs))
        for run in range(self.runs):
            weights = np.ones(self.runs)
            weights[run] = 0.0
            for h, e in enumerate(self.evidence):
                found[h, run] = e.costs(e.fitted(weights)[1])[run]
        return found


def contest(trials: Sequence[FittedHypothesis], error: ModelError) -> Contest:
    """Set hypotheses fitted to the same runs against each other, with model error admitted."""
    price = np.array(
        [
            extended_bic(0.0, t.hypothesis.extra, t.bench.observations, len(t.hypothesis.parts), t.bench.candidates)
            for t in trials
        ]
    )
    return Contest(tuple(trials), tuple(run_evidence(t, error) for t in trials), price)


def gain_with_error(better: Array, worse: Array) -> tuple[float, float]:
    """Mean gain per run in chi2 (R,) and its standard error, by runs."""
    gains = worse - better
    error = float(np.std(gains, ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else float("inf")
    return float(np.mean(gains)), error


def clustered_covariance(evidence: RunEvidence) -> Array:
    """Covariance (S, S) of shared values, robust against what is alike within a run (Liang & Zeger 1986)."""
    runs = len(evidence.level)
    _, change = evidence.fitted(np.ones(runs))
    bread = np.linalg.pinv(evidence.curvature.sum(axis=0) + np.diag(evidence.prior), hermitian=True)
    scores = evidence.slope + np.einsum("rij,j->ri", evidence.curvature, change)
    meat = scores.T @ scores * runs / max(runs - 1, 1)
    robust: Array = bread @ meat @ bread
    return robust
