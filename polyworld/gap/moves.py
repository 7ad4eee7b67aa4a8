"""Propose what may do as well as the best hypothesis, and where its fits begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FitContext, FittedHypothesis, Start
from polyworld.estimation.hypothesis import Hypothesis, Part, extended, without_part
from polyworld.estimation.score_test import score_test_starts
from polyworld.gap import ebic
from polyworld.gap.contest import identity

if TYPE_CHECKING:
    from polyworld.gap.search import Search

Array = NDArray[np.float64]

GREATER = (1.1, 2.0)  # times a friction from which it is fitted again: just past a sticking contact, and well past it


@dataclass(frozen=True)
class Move:
    """A hypothesis to be fitted to whole runs, and where from."""

    hypothesis: Hypothesis
    start: Start


def moves(search: Search, best: FittedHypothesis, effects: int) -> list[Move]:
    """Return what may do as well as the best: competitors, nested submodels, the best perturbed."""
    return [*_competitors(search, best, effects), *_simplified(search, best), *_perturbed(best)]


def _competitors(search: Search, best: FittedHypothesis, effects: int) -> list[Move]:
    """Return what segments hardly distinguish from the best, and what predicted the same as it did."""
    found: dict[tuple[str, ...], Move] = {}
    if search.used is not None:
        there = search.used.ranked(effects)
        for t in there:
            if ebic.competes(t, there[0], search.settings.close):
                found[identity(t.hypothesis)] = Move(t.hypothesis, Start(t.values, best.fit.states))
    for contest in (search.whole, search.used):
        own = None if contest is None else contest.predicted.get(identity(best.hypothesis))
        if contest is None or own is None or own.share <= 0.01:
            continue
        for key, other in contest.predicted.items():
            if len(other.hypothesis.parts) == effects and abs(other.share - own.share) < 0.01 * own.share:
                found.setdefault(key, Move(other.hypothesis, Start(other.starts[0].values, best.fit.states)))
    found.pop(identity(best.hypothesis), None)
    return list(found.values())


def _simplified(search: Search, best: FittedHypothesis) -> list[Move]:
    """Return nested submodels of each effect: those that it contains, from its values, and beside other effects
    those that are predicted to do as well, and what is known to be confused with it."""
    found = []
    substep = best.hypothesis.world.time.substep
    recording = search.context.design.recording
    for less, values in reduced(search.context, best):
        (part,) = [p for p in best.hypothesis.parts if p.candidate.name not in less.names]
        theirs = {(u.name, u.unit) for u in part.variant.unknowns}
        known = best.hypothesis.of_part(best.hypothesis.parts.index(part), best.values)
        ways = [h for c in search.candidates for h in extended(less.stepped(substep), c, recording)]
        fewer = [h for h in ways if len(h.parts[-1].variant.unknowns) < len(theirs) + _confusable(part, h.parts[-1])]
        for h in fewer:
            own = h.parts[-1].variant.unknowns
            if {(u.name, u.unit) for u in own} < theirs:
                start = np.concatenate([values, [known[u.name] for u in own]])
                found.append(Move(h, Start(start, best.fit.states)))
        if len(best.hypothesis.parts) > 1 and best.passes and fewer:
            off = search.context.fit(less.stepped(substep), values, best.fit.states, iterations=0)
            for tested in score_test_starts(search.context, off, fewer, 1)[: search.settings.few]:
                starts = [Start(tested.values, best.fit.states)]
                if tested.states is not None:
                    starts.append(Start(tested.values, tested.states))
                found.append(Move(tested.hypothesis, search.context.nearest(tested.hypothesis, starts)))
    return found


def _confusable(one: Part, other: Part) -> bool:
    """Return whether an effect is known to be confused with another."""
    return one.candidate.name in other.candidate.confused_with or other.candidate.name in one.candidate.confused_with


def _perturbed(best: FittedHypothesis) -> list[Move]:
    """Return the best with greater friction: where a grip suffices, more of it changes nothing, and a fit that stopped
    short of that finds no slope towards it."""
    names = [u.name for u in best.hypothesis.unknowns]
    if "friction" not in names:
        return []
    found = []
    place = names.index("friction")
    for times in GREATER:
        values = best.values.copy()
        values[place] = min(times * values[place], best.hypothesis.unknowns[place].upper)
        found.append(Move(best.hypothesis, Start(values, best.fit.states)))
    return found


def reduced(context: FitContext, trial: FittedHypothesis) -> list[tuple[Hypothesis, Array]]:
    """Return the hypotheses that one effect less makes of a fit, with the values that stay."""
    base = Hypothesis(context.design.world, trial.hypothesis.base)
    recording = context.design.recording
    found = (
        without_part(base, trial.hypothesis, i, trial.values, recording) for i in range(len(trial.hypothesis.parts))
    )
    return [less for less in found if less is not None]


def distinct(parents: Sequence[FittedHypothesis], alike: float) -> list[FittedHypothesis]:
    """Return the parents less those whose residuals are those of one before them but for a share `alike` of chi2."""
    kept: list[FittedHypothesis] = []
    for trial in parents:
        if all(_difference(trial, other) >= alike * min(trial.chi2, other.chi2) for other in kept):
            kept.append(trial)
    return kept


def _difference(one: FittedHypothesis, other: FittedHypothesis) -> float:
    return sum(float(np.sum((a - b) ** 2)) for a, b in zip(one.fit.linear.r, other.fit.linear.r, strict=True))
