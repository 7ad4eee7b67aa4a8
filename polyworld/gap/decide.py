"""Decide which effects the data name, once, from evidence, stability over runs, and held-out prediction.

Where a hypothesis leaves only noise, it is identified, or ambiguous beside others that do. Where none does, model error
is admitted as large as what the leading hypothesis leaves, and effects are named that stay decisive then, are chosen
whichever runs are left out, and predict runs left out better: identified with a remainder. Each check of the program's
own that contradicts a name lowers the verdict by itself, and is reported with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from polyworld.estimation.trial import FittedHypothesis
from polyworld.estimation.unknown import Unknown
from polyworld.gap.model_error import ModelError, model_error_of, run_evidence
from polyworld.gap.settings import DecisionSettings
from polyworld.gap.stability import Contest, clustered_covariance, contest, gain_with_error

Kind = Literal["identified", "identified_with_remainder", "ambiguous", "unexplained", "nothing_missing"]
Names = tuple[str, ...]

PLAIN = (  # laws that are fitted and reported beside any richer answer
    "gravity_error",
    "restitution_error",
    "friction_error",
    "rolling_resistance",
    "linear_drag",
    "quadratic_drag",
    "viscous_friction",
    "joint_damping",
    "joint_friction",
)
ALIKE = 10.83  # squared difference of whitened motions that noise exceeds once in a thousand (chi2, 1 freedom)
ROUNDS = 4  # of choosing a leader and estimating the model error from it


@dataclass(frozen=True)
class Graded:
    """What the data name when model error is admitted.

    leader: the hypothesis chosen, None where no names are stable. error: the model error that it leaves. support:
    effect -> share of subsets of the runs in which it is chosen. rivals: sets of names within reach of the leader.
    held_out, held_out_error: mean gain per left-out run over the base, and its standard error, in chi2.
    ahead: by how much its extended BIC is below that of the base. reasons: why no name is given, where none is.
    alternatives: hypotheses chosen in some subsets of the runs each, where the base is in none and no more is wrong.
    """

    leader: FittedHypothesis | None
    nearest: FittedHypothesis
    error: ModelError
    support: dict[str, float]
    rivals: tuple[Names, ...]
    held_out: float
    held_out_error: float
    ahead: float
    reasons: tuple[str, ...]
    alternatives: tuple[FittedHypothesis, ...] = ()


def names_of(trial: FittedHypothesis) -> Names:
    """Return the effects of a hypothesis in alphabetical order."""
    return tuple(sorted(trial.hypothesis.names))


def equivalents(trials: Sequence[FittedHypothesis]) -> dict[str, frozenset[str]]:
    """Return every effect's name with those of the effects that these data cannot distinguish from it.

    They are known to be alike, or their fits are: single effects whose motions differ by less than noise shows.
    """
    found: dict[str, set[str]] = {}
    for trial in trials:
        for part in trial.hypothesis.parts:
            found.setdefault(part.candidate.name, {part.candidate.name}).update(part.variant.same_as)
    single = [t for t in trials if len(t.hypothesis.parts) == 1]
    for i, one in enumerate(single):
        for other in single[:i]:
            apart = sum(float(np.sum((a - b) ** 2)) for a, b in zip(one.fit.linear.r, other.fit.linear.r, strict=True))
            if apart < ALIKE:
                found[one.hypothesis.names[0]].update(other.hypothesis.names)
                found[other.hypothesis.names[0]].update(one.hypothesis.names)
    return {name: frozenset(same) for name, same in found.items()}


def grade(
    base: FittedHypothesis, trials: Sequence[FittedHypothesis], courses: int, settings: DecisionSettings, seed: int = 0
) -> Graded:
    """Choose effects with model error admitted.

    base: the world without them. trials: fitted hypotheses, all under one noise. courses: distinct courses among the
    runs, as which repeated ones count.

    Plain laws and faults of the observer lead by the extended BIC under the model error that they leave themselves. Any
    other effect has to be decisive, each by itself, even where all that the leader leaves is admitted as model error:
    a sum of far-fetched effects does not win then by taking up what a plain law leaves undone.
    """
    pool = [base, *trials]
    same = equivalents(trials)
    leader = _plain_leader([t for t in pool if not _far_fetched(t)])
    for _ in range(ROUNDS):
        error = model_error_of(leader)
        found = contest(pool, error)
        scores = found.scores(np.ones(found.runs))
        lead = np.array([settings.decisive * max(_far_fetched(t), 1) for t in pool])
        ahead_by = scores[pool.index(leader)] - scores - lead
        best = int(np.argmax(ahead_by))
        if ahead_by[best] <= 0.0:
            break
        leader = pool[best]
    by_subset = np.array([found.scores(w) for w in found.subsets(settings.subsets, seed)])
    chosen_in = _chosen(by_subset, pool.index(leader), settings)
    support = _support(found, pool.index(leader), chosen_in, by_subset, same)
    stable = {name for name, share in support.items() if share >= settings.stable}
    within = [t for t, score in zip(pool, scores, strict=True) if score - scores.min() <= settings.decisive]
    rivals = tuple(dict.fromkeys(names_of(t) for t in within if names_of(t) and not _shares(t, leader, same)))
    chosen = leader if leader.hypothesis.names else None
    reasons = []
    if courses < settings.fewest_runs:
        reasons.append(
            f"the runs follow {_count(courses, 'distinct course')}: stability over runs needs {settings.fewest_runs}"
        )
    gain, gain_error, ahead = 0.0, float("inf"), 0.0
    unstable: list[str] = []
    if chosen is None:
        reasons.append("with model error admitted, no effect is decisive")
    else:
        index = pool.index(chosen)
        unstable = [n for n in chosen.hypothesis.names if not any(m in stable for m in same[n])]
        if unstable:
            reasons.append(
                f"{' and '.join(unstable)} {'is' if len(unstable) == 1 else 'are'} not chosen whichever runs are left "
                f"out (in {100.0 * min(support[n] for n in unstable):.0f}% of the subsets)"
            )
        ahead = float(scores[0] - scores[index])
        held_out = found.held_out()
        gain, gain_error = gain_with_error(held_out[index], held_out[0])
        if ahead <= settings.decisive:
            reasons.append(
                f"with model error admitted, the base is only {ahead:.1f} behind in the extended BIC "
                f"(decisive: {settings.decisive:g})"
            )
        closed = _closed(base, chosen)
        if _far_fetched(chosen) and closed < settings.closed:
            reasons.append(f"only {100.0 * closed:.0f}% of the gap is closed (at least {100.0 * settings.closed:.0f}%)")
        if not gain > settings.clearly * gain_error:
            reasons.append(
                f"runs left out are not predicted better: chi2 falls by {gain:.3g} +- {gain_error:.2g} per run"
            )
        for i, other in enumerate(pool[1:], start=1):
            better, by = gain_with_error(held_out[index], held_out[i])
            rival = not _far_fetched(other) and not _shares(other, chosen, same)
            if rival and better < -settings.clearly * by and scores[i] < scores[index]:
                reasons.append(f"runs left out are predicted better by {' + '.join(names_of(other))}")
                break
    named = None if reasons else chosen
    alternatives: tuple[FittedHypothesis, ...] = ()
    if chosen is not None and unstable and len(reasons) == 1:
        picked = [pool[i] for i in dict.fromkeys([pool.index(leader), *chosen_in.tolist()])]
        doubtful = [t for t in within if t.hypothesis.names and set(t.hypothesis.names) != set(leader.hypothesis.names)]
        picked += [t for t in doubtful if not _far_fetched(t) and t not in picked]
        alternatives = tuple(picked) if base not in picked and len(picked) > 1 else ()
    return Graded(named, leader, error, support, rivals, gain, gain_error, ahead, tuple(reasons), alternatives)


def _closed(base: FittedHypothesis, trial: FittedHypothesis) -> float:
    """Share of the base's root mean square residual beyond the noise that a hypothesis takes away, in positions or in
    rotations, whichever it is more: a torque turns bodies and pushes none."""
    shares = [0.0]
    for kind in {s.kind for s in base.bench.design.series}:
        before, after = (_beyond_noise(t, kind) for t in (base, trial))
        if before > 0.0:
            shares.append(1.0 - after / before)
    return max(shares)


def _beyond_noise(trial: FittedHypothesis, kind: str) -> float:
    """Root mean square of the whitened residuals of one kind beyond that of noise."""
    own = [trial.fit.linear.r[s.run][s.where] for s in trial.bench.design.series if s.kind == kind]
    return float(np.sqrt(max(float(np.mean(np.concatenate(own) ** 2)) - 1.0, 0.0)))


def _far_fetched(trial: FittedHypothesis) -> int:
    """Number of effects of a hypothesis that are neither plain laws nor faults of the observer."""
    return sum(p.candidate.name not in PLAIN and p.candidate.group != "observer" for p in trial.hypothesis.parts)


def _plain_leader(pool: Sequence[FittedHypothesis]) -> FittedHypothesis:
    """The hypothesis with the least extended BIC under the model error that it leaves."""
    leader = min(pool, key=lambda t: t.ebic)
    for _ in range(ROUNDS):
        found = contest(pool, model_error_of(leader))
        best = pool[int(np.argmin(found.scores(np.ones(found.runs))))]
        if best is leader:
            break
        leader = best
    return leader


def _chosen(scores: NDArray[np.float64], leader: int, settings: DecisionSettings) -> NDArray[np.int64]:
    """Which hypothesis is chosen in each subset of the runs: the leader, unless another one is decisively ahead.

    scores (B, H): extended BIC of every hypothesis in every subset.
    """
    best = np.argmin(scores, axis=1)
    ahead = scores[:, leader] - scores[np.arange(len(scores)), best]
    return np.where(ahead > settings.decisive, best, leader)


def _support(
    found: Contest,
    leader: int,
    chosen: NDArray[np.int64],
    scores: NDArray[np.float64],
    same: dict[str, frozenset[str]],
) -> dict[str, float]:
    """Share of subsets of the runs in which each effect, or one indistinguishable from it, is chosen and needed."""
    share: dict[str, float] = {}
    for name in dict.fromkeys(n for t in found.trials for n in t.hypothesis.names):
        has = np.array([bool(set(t.hypothesis.names) & same[name]) for t in found.trials])
        # An effect of the leader has to be missed, too: what does without it must not do as well.
        needed = scores[:, ~has].min(axis=1) > scores[:, leader] if has[leader] else np.ones(len(scores), dtype=bool)
        share[name] = float(np.mean(has[chosen] & needed))
    return share


def _shares(one: FittedHypothesis, other: FittedHypothesis, same: dict[str, frozenset[str]]) -> bool:
    """Whether a hypothesis has all effects of another, or their equivalents: it does not contradict it then."""
    return all(any(n in same[name] for n in one.hypothesis.names) for name in other.hypothesis.names)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


@dataclass(frozen=True)
class Check:
    """One of the program's own checks that contradicts a name: what it is called, and what it found."""

    name: Literal[
        "null_control",
        "held_out",
        "held_out_remainder",
        "runner_up",
        "nothing_held_out",
        "time_limit",
    ]
    found: str


LOWERED: dict[str, dict[Kind, Kind]] = {
    # A name that held-out data refute is not given.
    "held_out": {"identified": "unexplained", "identified_with_remainder": "unexplained"},
    # What leaves only noise in the data fitted and half of the gap in others has not named what acts.
    "held_out_remainder": {"identified": "unexplained"},
    # A procedure that finds effects in data without any proves nothing by finding one.
    "null_control": {"identified": "ambiguous", "identified_with_remainder": "unexplained"},
    # A rival that was not fitted has not lost.
    "time_limit": {"identified": "ambiguous", "identified_with_remainder": "unexplained"},
    "runner_up": {"identified": "ambiguous", "identified_with_remainder": "ambiguous"},
    "nothing_held_out": {"identified": "ambiguous", "identified_with_remainder": "ambiguous"},
}


def lowered(kind: Kind, checks: Sequence[Check]) -> Kind:
    """Return the verdict after the checks that contradict it, each of which lowers it by itself."""
    for check in checks:
        kind = LOWERED[check.name].get(kind, kind)
    return kind


def widened(unknowns: Sequence[Unknown], intervals: np.ndarray, graded: Graded, trial: FittedHypothesis) -> np.ndarray:
    """Return 95% intervals (S, 2) widened by the scatter of the runs (cluster-robust) and the model error."""
    evidence = run_evidence(trial, graded.error)
    runs = len(evidence.level)
    factor = float(student.ppf(0.975, max(runs - 1, 1)))
    spread = factor * np.sqrt(np.maximum(np.diag(clustered_covariance(evidence)), 0.0))
    values = trial.values[: len(intervals)]
    lower = np.array([u.lower for u in unknowns])[: len(intervals)]
    upper = np.array([u.upper for u in unknowns])[: len(intervals)]
    found = intervals.copy()
    found[:, 0] = np.maximum(np.minimum(intervals[:, 0], values - spread[: len(intervals)]), lower)
    found[:, 1] = np.minimum(np.maximum(intervals[:, 1], values + spread[: len(intervals)]), upper)
    return found
