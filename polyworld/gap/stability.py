"""Ask whether the same effects are chosen whichever runs are there, and whether they predict runs left out.

Runs are left out a quarter at a time, and in turn (Stone 1974, J. R. Stat. Soc. B 36, 111): whole runs, since what a
model lacks is alike within a run. Hypotheses move along their linearisations, so that neither costs a simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, stdtrit  # scipy.stats is slow to import

from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.gap import ebic
from polyworld.gap.model_error import ModelError, RunEvidence, model_error_of, run_evidence
from polyworld.gap.settings import DecisionSettings

Array = NDArray[np.float64]
Names = tuple[str, ...]
Same = dict[str, frozenset[str]]


@dataclass(frozen=True)
class Contest:
    """Fitted hypotheses compared with model error admitted.

    evidence[h]: of each; price (H,): what its unknowns and the choice of its effects cost (extended BIC).
    """

    evidence: tuple[RunEvidence, ...]
    price: Array

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.evidence[0].level)

    def scores(self, weights: Array | None = None) -> Array:
        """Return the extended BIC (H,) of every hypothesis with runs weighted (R,)."""
        weights = np.ones(self.runs) if weights is None else weights
        return np.array([e.fitted(weights)[0] for e in self.evidence]) + self.price

    def subsets(self, count: int, seed: int) -> Array:
        """Return weights (B, R), 0 or 1, that leave out a quarter of the runs, at least one: all such subsets of fewer
        than eight runs, else `count` random ones (delete-d jackknife, Shao & Wu 1989, Ann. Stat. 17, 1176)."""
        left_out = max(1, self.runs // 4)
        if left_out == 1:
            return np.ones((self.runs, self.runs)) - np.eye(self.runs)
        rng = np.random.default_rng(seed)
        weights = np.ones((count, self.runs))
        for row in weights:
            row[rng.choice(self.runs, left_out, replace=False)] = 0.0
        return weights

    def held_out(self) -> Array:
        """Return chi2 (H, R) of every run at shared values that the others give, its initial state fitted to it."""
        rest = np.ones((self.runs, self.runs)) - np.eye(self.runs)
        return np.array([[e.costs(e.fitted(rest[r])[1])[r] for r in range(self.runs)] for e in self.evidence])


def contest(trials: Sequence[FittedHypothesis], error: ModelError) -> Contest:
    """Compare hypotheses fitted to the same runs, with model error admitted."""
    return Contest(tuple(run_evidence(t, error) for t in trials), np.array([t.price for t in trials]))


def names_of(trial: FittedHypothesis) -> Names:
    """Return the effects of a hypothesis in alphabetical order."""
    return tuple(sorted(trial.hypothesis.names))


def far_fetched(trial: FittedHypothesis) -> int:
    """Return the number of effects of a hypothesis that are neither plain laws nor faults of the observer."""
    return sum(not p.candidate.plain and p.candidate.group != "observer" for p in trial.hypothesis.parts)


def closed(base: FittedHypothesis, trial: FittedHypothesis) -> float:
    """Return the share of the base's root mean square residual beyond the noise that a hypothesis takes away, of the
    kind of measurement of which it takes most: a torque turns bodies and pushes none."""
    shares = [0.0]
    for kind in {s.kind for s in base.context.design.series}:
        before, after = (_beyond_noise(t, kind) for t in (base, trial))
        if before > 0.0:
            shares.append(1.0 - after / before)
    return max(shares)


def _beyond_noise(trial: FittedHypothesis, kind: str) -> float:
    """Return the root mean square of the whitened residuals of one kind beyond that of noise."""
    own = [trial.fit.linear.r[s.run][s.where] for s in trial.context.design.series if s.kind == kind]
    return float(np.sqrt(max(float(np.mean(np.concatenate(own) ** 2)) - 1.0, 0.0)))


def separation(one: FittedHypothesis, other: FittedHypothesis) -> float:
    """Return the squared difference of two fitted motions in units of the noise."""
    return sum(float(np.sum((a - b) ** 2)) for a, b in zip(one.fit.linear.r, other.fit.linear.r, strict=True))


def equivalents(trials: Sequence[FittedHypothesis], chance: float) -> Same:
    """Return every effect's name with those of the effects that these data cannot distinguish from it.

    They are known to be alike, or their fits are: single effects whose motions differ by less than noise does with
    probability `chance`.
    """
    found: dict[str, set[str]] = {}
    for part in (p for trial in trials for p in trial.hypothesis.parts):
        found.setdefault(part.candidate.name, {part.candidate.name}).update(part.variant.same_as)
    single = [t for t in trials if len(t.hypothesis.parts) == 1]
    for i, one in enumerate(single):
        for other in single[:i]:
            if separation(one, other) < float(chdtri(1, chance)):
                found[one.hypothesis.names[0]].update(other.hypothesis.names)
                found[other.hypothesis.names[0]].update(one.hypothesis.names)
    return {name: frozenset(same) for name, same in found.items()}


def contains(one: FittedHypothesis, other: FittedHypothesis, same: Same) -> bool:
    """Return whether a hypothesis has all effects of another, or their equivalents, and so does not contradict it."""
    return all(any(n in same[name] for n in one.hypothesis.names) for name in other.hypothesis.names)


def leader_and_error(pool: Sequence[FittedHypothesis], settings: DecisionSettings) -> tuple[int, ModelError]:
    """Return the index of the leading hypothesis, and the model error that it leaves.

    Plain laws and faults of the observer lead by the extended BIC under the model error that they leave themselves. Any
    other effect has to be decisive, each by itself, even where all that the leader leaves is admitted as model error:
    a sum of far-fetched effects does not win then by taking up what a plain law leaves undone.
    """
    far = np.array([far_fetched(t) for t in pool])
    everyone = np.arange(len(pool))
    leader = int(np.argmin(np.where(far == 0, [t.ebic for t in pool], np.inf)))
    for among, lead in ((everyone[far == 0], 0.0), (everyone, settings.decisive)):
        for _ in range(settings.rounds):
            error = model_error_of(pool[leader], settings.left)
            scores = contest([pool[int(i)] for i in among], error).scores() + lead * np.maximum(far[among], 1)
            scores[among == leader] -= lead * max(far[leader], 1)
            best = int(among[np.argmin(scores)])
            if best == leader:
                break
            leader = best
    return leader, model_error_of(pool[leader], settings.left)


def chosen_in_subsets(scores: Array, leader: int, settings: DecisionSettings) -> NDArray[np.int64]:
    """Return which hypothesis is chosen in each subset of the runs: the leader, unless another is decisively ahead.

    scores (B, H): extended BIC of every hypothesis in every subset.
    """
    best = np.argmin(scores, axis=1)
    held = ebic.within(scores[:, leader], scores[np.arange(len(scores)), best], settings.decisive)
    return np.where(held, leader, best)


def has_effect(pool: Sequence[FittedHypothesis], name: str, same: Same) -> NDArray[np.bool_]:
    """Return which hypotheses (H,) have an effect, or one indistinguishable from it."""
    return np.array([bool(set(t.hypothesis.names) & same[name]) for t in pool])


def support_of(
    pool: Sequence[FittedHypothesis], leader: int, chosen: NDArray[np.int64], scores: Array, same: Same
) -> dict[str, float]:
    """Return the share of subsets of the runs in which each effect is chosen and, if it is the leader's, needed: what
    does without it must not do as well."""
    share: dict[str, float] = {}
    for name in dict.fromkeys(n for t in pool for n in t.hypothesis.names):
        has = has_effect(pool, name, same)
        needed = scores[:, ~has].min(axis=1) > scores[:, leader] if has[leader] else np.ones(len(scores), dtype=bool)
        share[name] = float(np.mean(has[chosen] & needed))
    return share


def widened(intervals: Array, trial: FittedHypothesis, error: ModelError) -> Array:
    """Return 95% intervals (S, 2) widened by the scatter of the runs (cluster-robust) and the model error."""
    evidence = run_evidence(trial, error)
    factor = float(stdtrit(max(len(evidence.level) - 1, 1), 0.975))
    unknowns = trial.hypothesis.unknowns
    spread = factor * np.sqrt(np.maximum(np.diag(_clustered_covariance(evidence)), 0.0))
    lower, upper = np.array([u.lower for u in unknowns]), np.array([u.upper for u in unknowns])
    ends = np.clip([trial.values - spread, trial.values + spread], lower, upper)
    return np.stack([np.minimum(intervals[:, 0], ends[0]), np.maximum(intervals[:, 1], ends[1])], axis=1)


def _clustered_covariance(evidence: RunEvidence) -> Array:
    """Return the covariance (S, S) of shared values, robust against what is alike within a run (Liang & Zeger 1986)."""
    runs = len(evidence.level)
    _, change = evidence.fitted(np.ones(runs))
    bread = np.linalg.pinv(evidence.curvature.sum(axis=0) + np.diag(evidence.prior), hermitian=True)
    scores = evidence.slope + np.einsum("rij,j->ri", evidence.curvature, change)
    meat = scores.T @ scores * runs / max(runs - 1, 1)
    robust: Array = bread @ meat @ bread
    return robust
