"""Which name the evidence allows: one, several, none of the catalogue, or none needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import chdtri

from polyworld.estimation.criteria import HeldOutGain, held_out_gain
from polyworld.estimation.trial import FittedHypothesis

Kind = Literal["identified", "ambiguous", "unexplained", "nothing_missing"]

SAME = 1e-3  # probability, under the simpler of two nested laws, that they differ by more than what counts as the same
FAR_BEHIND = 30.0  # difference of EBIC beyond which forecasts of left-out data are not asked
CLEARLY = 2.0  # standard errors by which such forecasts must be better


@dataclass(frozen=True)
class RunnerUp:
    """The best hypothesis with another name: how far behind it is."""

    trial: FittedHypothesis
    ebic_behind: float
    held_out: HeldOutGain


@dataclass(frozen=True)
class Verdict:
    """kind; best: the leading hypothesis; credible: all that stand beside it, best first; runner_up: the next name.

    forms: what stands beside the best under its own name: the same effects by another rule, or on another body.
    """

    kind: Kind
    best: FittedHypothesis | None
    credible: tuple[FittedHypothesis, ...] = ()
    runner_up: RunnerUp | None = None
    forms: tuple[FittedHypothesis, ...] = ()


def decide(trials: Sequence[FittedHypothesis], credible: float) -> Verdict:
    """The verdict on trials of equally many effects, none of which is the base.

    Hypotheses stand beside the best where they pass the gate and their EBIC is within `credible` of the least, or
    where the data prefer them by more than their further unknowns would by chance, whatever Occam's share of EBIC
    says, or where they are not far behind and foretell data left out clearly better. A richer law that foretells the
    same as a simpler one, to what its further unknowns fit of the noise, contains it and is left out.
    """
    ranked = sorted((t for t in trials if np.isfinite(t.ebic)), key=lambda t: (t.ebic, t.hypothesis.title))
    best = next((t for t in ranked if _could_pass(t, ranked) and t.passes), None)
    if best is None:
        first = ranked[0] if ranked else None
        return Verdict("unexplained", first, (), _runner_up(first, ranked) if first else None)
    near = [
        t for t in ranked if t is best or t.ebic - best.ebic <= credible or _preferred(t, best) or _foretells(t, best)
    ]
    beside = [t for t in near if t.passes]
    beside = [t for t in beside if not any(_contains(t, other) for other in beside if other is not t)]
    if best not in beside:
        best = beside[0]
    names = sorted(best.hypothesis.names)
    forms = tuple(t for t in beside if t is not best and sorted(t.hypothesis.names) == names)
    beside = one_of_each_name(beside)
    kind: Kind = "identified" if len(beside) == 1 else "ambiguous"
    return Verdict(kind, best, tuple(beside), _runner_up(best, ranked), forms)


def beside_fewer(verdict: Verdict, fewer: Sequence[FittedHypothesis], credible: float) -> Verdict:
    """The verdict with trials of fewer effects beside a best one that betters their EBIC by less than would decide.

    That they fail the gate, and it does not, is no evidence for a further effect by that very name.
    """
    best = verdict.best
    near = [] if best is None else [t for t in fewer if t.ebic - best.ebic <= credible]
    if not near:
        return verdict
    return replace(verdict, kind="ambiguous", credible=(*verdict.credible, *one_of_each_name(near)))


def _could_pass(trial: FittedHypothesis, ranked: Sequence[FittedHypothesis]) -> bool:
    """Whether chi2 is near enough to the least, within what noise does, for the gate to be worth asking."""
    least = min(t.chi2 for t in ranked)
    return trial.chi2 < least + 5.0 * float(np.sqrt(2.0 * max(least, trial.bench.observations)))


def one_of_each_name(trials: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """The first trial of every set of names: labels tell whom it acts on, not what it is."""
    chosen: dict[tuple[str, ...], FittedHypothesis] = {}
    for trial in trials:
        chosen.setdefault(tuple(sorted(trial.hypothesis.names)), trial)
    return list(chosen.values())


def _preferred(trial: FittedHypothesis, best: FittedHypothesis) -> bool:
    more = trial.hypothesis.extra - best.hypothesis.extra
    return more > 0 and best.chi2 - trial.chi2 > float(chdtri(more, SAME))


def _foretells(trial: FittedHypothesis, best: FittedHypothesis) -> bool:
    if trial.ebic - best.ebic > FAR_BEHIND:
        return False
    gain = held_out_gain(trial.held_out, best.held_out)
    return gain.gain > CLEARLY * gain.error


def _contains(richer: FittedHypothesis, simpler: FittedHypothesis) -> bool:
    """Whether a law with more unknowns foretells what a simpler one does, noise aside."""
    more = richer.hypothesis.extra - simpler.hypothesis.extra
    if more <= 0:
        return False
    apart = sum(float(np.sum((a - b) ** 2)) for a, b in zip(richer.fit.linear.r, simpler.fit.linear.r, strict=True))
    return apart < float(chdtri(more, SAME))


def _runner_up(best: FittedHypothesis, ranked: Sequence[FittedHypothesis]) -> RunnerUp | None:
    names = sorted(best.hypothesis.names)
    other = next((t for t in ranked if sorted(t.hypothesis.names) != names), None)
    if other is None:
        return None
    return RunnerUp(other, other.ebic - best.ebic, held_out_gain(best.held_out, other.held_out))
