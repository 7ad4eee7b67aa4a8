"""Decide which effects the data name, once, from evidence, stability over runs, and held-out prediction.

Where hypotheses leave only noise, one is identified, or several stand side by side. Model error is admitted where none
does, and where the one that does may only imitate a plain law of a slightly different form: effects are named then that
stay decisive, are chosen whichever runs are left out, and predict runs left out better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.special import chdtri

from polyworld.estimation.criteria import HeldOutGain, held_out_gain
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.gap import ebic
from polyworld.gap.model_error import ModelError
from polyworld.gap.settings import DecisionSettings
from polyworld.gap.stability import (
    Names,
    chosen_in_subsets,
    closed,
    contains,
    contest,
    equivalents,
    far_fetched,
    has_effect,
    leader_and_error,
    names_of,
    separation,
    support_of,
)

Kind = Literal["identified", "identified_with_remainder", "ambiguous", "unexplained", "nothing_missing"]

DEFAULT = DecisionSettings()


@dataclass(frozen=True)
class RunnerUp:
    """The best hypothesis with another name: how far behind it is."""

    trial: FittedHypothesis
    ebic_behind: float
    held_out: HeldOutGain


@dataclass(frozen=True)
class Stability:
    """Hold what the data name when model error is admitted.

    leader: the hypothesis that leads then. error: the model error that it leaves. support: effect -> share of subsets
    of the runs in which it is chosen. competitors: sets of names within reach of the leader. held_out: gain per
    left-out run over the base, in chi2. ahead: by how much its extended BIC is below that of the base. reasons: why it
    is not named, where it is not. alternatives: hypotheses chosen in some subsets of the runs each, where no more is
    wrong.
    """

    leader: FittedHypothesis
    error: ModelError
    support: dict[str, float]
    competitors: tuple[Names, ...]
    held_out: HeldOutGain
    ahead: float
    reasons: tuple[str, ...] = ()
    alternatives: tuple[FittedHypothesis, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """kind; best: the leading hypothesis; credible: all that stand beside it, best first; runner_up: the next name.

    forms: what stands beside the best under its own name: the same effects by another rule, or on another body.
    stability: the comparison with model error admitted, where it was made.
    """

    kind: Kind
    best: FittedHypothesis | None
    credible: tuple[FittedHypothesis, ...] = ()
    runner_up: RunnerUp | None = None
    forms: tuple[FittedHypothesis, ...] = ()
    stability: Stability | None = field(default=None, repr=False)


def decide(
    gated: Verdict,
    base: FittedHypothesis,
    pool: Sequence[FittedHypothesis],
    motions: int,
    settings: DecisionSettings = DEFAULT,
    seed: int = 0,
) -> Verdict:
    """Return the verdict, with model error admitted where it has a say.

    gated: the verdict on hypotheses that leave only noise. base: the world without effects. pool: fitted hypotheses,
    all under one noise. motions: distinct motions among the runs, as which repeated ones count.
    """
    best = gated.best
    if gated.kind == "unexplained" and pool:
        found = compare(base, pool, motions, settings, seed)
        if not found.reasons:
            return _named(gated, found)
        if found.alternatives:
            return _side_by_side(gated, found, found.alternatives)
        return replace(gated, stability=found)
    standing = gated.credible or (() if best is None else (best,))
    if gated.kind in ("identified", "ambiguous") and all(_may_imitate(t, base, pool, settings) for t in standing):
        others = [t for t in pool if all(t is not s for s in standing)]
        found = compare(base, [*others, *standing], motions, settings, seed)
        if not far_fetched(found.leader) and found.leader.hypothesis.names:
            if not found.reasons and not {names_of(t) for t in standing} & set(found.competitors):
                return _named(gated, found)
            return _side_by_side(gated, found, (found.leader, *standing, *found.alternatives))
    return gated


def _named(gated: Verdict, found: Stability) -> Verdict:
    best = found.leader
    kind: Kind = "identified" if best.passes and not found.competitors else "identified_with_remainder"
    return replace(gated, kind=kind, best=best, credible=(best,), stability=found)


def _side_by_side(gated: Verdict, found: Stability, several: tuple[FittedHypothesis, ...]) -> Verdict:
    credible = tuple(one_of_each_name(several))
    return replace(gated, kind="ambiguous", best=credible[0], credible=credible, stability=found)


def _may_imitate(
    best: FittedHypothesis, base: FittedHypothesis, pool: Sequence[FittedHypothesis], settings: DecisionSettings
) -> bool:
    """Return whether a far-fetched hypothesis may owe its fit to plain laws that close most of the gap themselves."""
    if not far_fetched(best):
        return False
    plain = [t for t in pool if t.hypothesis.names and not far_fetched(t)]
    return any(closed(base, t) >= settings.closed for t in plain)


def compare(
    base: FittedHypothesis,
    trials: Sequence[FittedHypothesis],
    motions: int,
    settings: DecisionSettings = DEFAULT,
    seed: int = 0,
) -> Stability:
    """Compare hypotheses with model error admitted, over all runs and over subsets of them."""
    pool = [base, *trials]
    same = equivalents(trials, settings.chance)
    index, error = leader_and_error(pool, settings)
    leader = pool[index]
    found = contest(pool, error)
    scores = found.scores()
    by_subset = np.array([found.scores(w) for w in found.subsets(settings.subsets, seed)])
    chosen = chosen_in_subsets(by_subset, index, settings)
    support = support_of(pool, index, chosen, by_subset, same)
    competing = ebic.within(scores, scores[index], settings.decisive)
    within = [t for t, near in zip(pool, competing, strict=True) if near]
    competitors = tuple(dict.fromkeys(names_of(t) for t in within if names_of(t) and not contains(t, leader, same)))
    held_out = found.held_out()
    gain = held_out_gain(held_out[index], held_out[0])
    ahead = float(scores[0] - scores[index])

    reasons = []
    if motions < settings.fewest_runs:
        plural = "" if motions == 1 else "s"
        reasons.append(
            f"the runs follow {motions} distinct course{plural}: stability over runs needs {settings.fewest_runs}"
        )
    if not leader.hypothesis.names:
        reasons.append("with model error admitted, no effect is decisive")
        return Stability(leader, error, support, competitors, gain, ahead, tuple(reasons))
    if competing[0]:
        reasons.append(
            f"with model error admitted, the base is only {ahead:.1f} behind in the extended BIC "
            f"(decisive: {settings.decisive:g})"
        )
    share = closed(base, leader)
    if far_fetched(leader) and share < settings.closed:
        reasons.append(f"only {100.0 * share:.0f}% of the gap is closed (at least {100.0 * settings.closed:.0f}%)")
    if not gain.exceeds(settings.clearly):
        reasons.append(
            f"runs left out are not predicted better: chi2 falls by {gain.gain:.3g} +- {gain.error:.2g} per run"
        )
    for other, chi2, score in zip(pool[1:], held_out[1:], scores[1:], strict=True):
        competitor = not far_fetched(other) and not contains(other, leader, same)
        if competitor and score < scores[index] and held_out_gain(chi2, held_out[index]).exceeds(settings.clearly):
            reasons.append(f"runs left out are predicted better by {' + '.join(names_of(other))}")
            break
    stable = {name for name, value in support.items() if value >= settings.stable}
    unstable = [n for n in leader.hypothesis.names if not same[n] & stable]
    alternatives: list[FittedHypothesis] = []
    if unstable:
        if not reasons:  # each subset of the runs names its own, and what the evidence leaves open is named, too
            picks = {index, *chosen.tolist()}
            for name in unstable:
                without = np.where(has_effect(pool, name, same), np.inf, by_subset)
                best = np.argmin(without, axis=1)
                picks.update(best[without.min(axis=1) <= by_subset[:, index]].tolist())
            alternatives = [pool[i] for i in sorted(picks, key=lambda i: (i != index, scores[i]))]
            named = {frozenset(t.hypothesis.names) for t in alternatives}
            alternatives += [t for t in within if t.hypothesis.names and not far_fetched(t)]
            alternatives = one_of_each_name(alternatives)
            if frozenset() in named or len(alternatives) < 2:
                alternatives = []
        least = min(support[n] for n in unstable)
        reasons.append(
            f"{' and '.join(unstable)} {'is' if len(unstable) == 1 else 'are'} not chosen whichever runs are left "
            f"out (in {100.0 * least:.0f}% of the subsets)"
        )
    return Stability(leader, error, support, competitors, gain, ahead, tuple(reasons), tuple(alternatives))


def leave_noise(trials: Sequence[FittedHypothesis], credible: float, settings: DecisionSettings = DEFAULT) -> Verdict:
    """Return the verdict on hypotheses of equally many effects, none of which is the base, without model error.

    Hypotheses stand beside the best where they pass the gate and their extended BIC is within `credible` of the least,
    or where the data prefer them by more than their further unknowns would by chance, whatever Occam's share of the
    criterion says, or where they are not far behind and predict data left out clearly better. A richer law that
    predicts the same as a simpler one, to what its further unknowns fit of the noise, contains it and is left out.
    """
    ranked = ebic.ranked_by_title(t for t in trials if np.isfinite(t.ebic))
    best = next((t for t in ranked if _could_pass(t, ranked) and t.passes), None)
    if best is None:
        first = ranked[0] if ranked else None
        return Verdict("unexplained", first, (), _runner_up(first, ranked) if first else None)
    near = [
        t
        for t in ranked
        if t is best
        or ebic.competes(t, best, credible)
        or _preferred(t, best, settings.chance)
        or (ebic.competes(t, best, settings.asked) and _predicts_better(t, best, settings.doubly))
    ]
    beside = [t for t in near if t.passes]
    beside = [t for t in beside if not any(_richer(t, other, settings.chance) for other in beside if other is not t)]
    if best not in beside:
        best = beside[0]
    forms = tuple(t for t in beside if t is not best and names_of(t) == names_of(best))
    beside = one_of_each_name(beside)
    return Verdict(
        "identified" if len(beside) == 1 else "ambiguous", best, tuple(beside), _runner_up(best, ranked), forms
    )


def beside_fewer(verdict: Verdict, fewer: Sequence[FittedHypothesis], credible: float) -> Verdict:
    """Return the verdict with hypotheses of fewer effects beside a best one that is ahead of them by less than decides.

    That they fail the gate, and it does not, is no evidence for a further effect by that very name.
    """
    best = verdict.best
    near = [] if best is None else [t for t in fewer if ebic.competes(t, best, credible)]
    if not near:
        return verdict
    return replace(verdict, kind="ambiguous", credible=(*verdict.credible, *one_of_each_name(near)))


def one_of_each_name(trials: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """Return the first hypothesis of every set of names: labels say on whom an effect acts, not what it is."""
    chosen: dict[Names, FittedHypothesis] = {}
    for trial in trials:
        chosen.setdefault(names_of(trial), trial)
    return list(chosen.values())


def _could_pass(trial: FittedHypothesis, ranked: Sequence[FittedHypothesis]) -> bool:
    """Return whether chi2 is near enough to the least, within what noise does, for the gate to be worth asking."""
    least = min(t.chi2 for t in ranked)
    return trial.chi2 < least + 5.0 * float(np.sqrt(2.0 * max(least, trial.context.observations)))


def _predicts_better(trial: FittedHypothesis, best: FittedHypothesis, errors: float) -> bool:
    return held_out_gain(trial.held_out, best.held_out).exceeds(errors)


def _preferred(trial: FittedHypothesis, best: FittedHypothesis, chance: float) -> bool:
    more = trial.hypothesis.extra - best.hypothesis.extra
    gain = best.chi2 + best.implausibility - trial.chi2 - trial.implausibility
    return more > 0 and gain > float(chdtri(more, chance))


def _richer(one: FittedHypothesis, other: FittedHypothesis, chance: float) -> bool:
    """Return whether a law with more unknowns predicts what a simpler one does, noise aside."""
    more = one.hypothesis.extra - other.hypothesis.extra
    return more > 0 and separation(one, other) < float(chdtri(more, chance))


def _runner_up(best: FittedHypothesis, ranked: Sequence[FittedHypothesis]) -> RunnerUp | None:
    other = next((t for t in ranked if names_of(t) != names_of(best)), None)
    if other is None:
        return None
    return RunnerUp(other, ebic.behind(other, best), held_out_gain(best.held_out, other.held_out))
