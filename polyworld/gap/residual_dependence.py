"""On what a residual force depends: what each factor of its law buys, and what further factors would."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc

from polyworld.gap.residual_law import FittedLaw, Problem, Score, room_for, score_term
from polyworld.gap.residual_terms import Factor, Scales, Term

FACTORS: tuple[Factor, ...] = ("speed", "position", "time", "spin", "contact")


@dataclass(frozen=True)
class Dependence:
    """What a factor is worth.

    in_law: whether the law depends on it; chi2 is then what it bought: the best law tried without it less the law's.
    Else it is what the law, modulated by that factor, would buy (Rao's score; with no law, the best single term).
    numbers: how many numbers that takes. p: probability of such a gain without the dependence. chi2 is NaN where it
    could not be tested: nothing spins or touches, or the effect has no room for more parameters.
    """

    factor: str
    in_law: bool
    chi2: float
    numbers: int
    p: float

    def to_json(self) -> dict[str, Any]:
        tested = bool(np.isfinite(self.chi2))
        return {
            "in_law": self.in_law,
            "chi2": self.chi2 if tested else None,
            "numbers": self.numbers,
            "p": self.p if tested else None,
        }


def dependences(
    problem: Problem, best: FittedLaw, tried: Iterable[FittedLaw], scores: Iterable[Score], scales: Scales
) -> tuple[Dependence, ...]:
    """One test a factor, and one of the direction.

    tried: all laws fitted. scores: of single terms on top of the base alone.
    """
    fitted = list(tried)
    if not best.law.terms:
        return tuple(_single(factor, list(scores)) for factor in FACTORS)
    probes = _probes(problem, best, scales)
    found = []
    for factor in FACTORS:
        if best.law.depends_on(factor):
            found.append(_bought(factor, best, fitted))
        else:
            found.append(_probed(factor, problem, best, probes.get(factor)))
    found.append(_probed("direction", problem, best, probes["direction"]))
    return tuple(found)


def without_factor(factor: Factor, scores: Iterable[Score]) -> Score | None:
    """The most promising single term that does not depend on a factor."""
    return max((s for s in scores if factor not in s.term.factors), key=lambda s: s.gain, default=None)


def _single(factor: Factor, scores: list[Score]) -> Dependence:
    best = max((s for s in scores if factor in s.term.factors), key=lambda s: s.gain, default=None)
    if best is None:
        return Dependence(factor, False, np.nan, 0, np.nan)
    return _dependence(factor, False, best.gain, len(best.values))


def _bought(factor: Factor, best: FittedLaw, fitted: list[FittedLaw]) -> Dependence:
    other = min((f for f in fitted if not f.law.depends_on(factor)), key=lambda f: f.fit.chi2)
    numbers = max(1, len(best.law.numbers) - len(other.law.numbers))
    return _dependence(factor, True, other.fit.chi2 - best.fit.chi2, numbers)


def _probed(factor: str, problem: Problem, best: FittedLaw, probe: Term | None) -> Dependence:
    score = None if probe is None or not room_for(best.law, probe) else score_term(problem, best, probe)
    if score is None:
        return Dependence(factor, False, np.nan, 0, np.nan)
    return _dependence(factor, False, score.gain, len(score.values))


def _dependence(factor: str, in_law: bool, chi2: float, numbers: int) -> Dependence:
    return Dependence(factor, in_law, chi2, numbers, float(chdtrc(numbers, max(chi2, 0.0))))


def _probes(problem: Problem, best: FittedLaw, scales: Scales) -> dict[str, Term]:
    """The law modulated by each factor, as a further term."""
    law = f"({best.law.literal(best.numbers(len(problem.base)))})/1[m/s^2]"
    v, length, t = f"{scales.speed:.3g}[m/s]", f"{scales.length:.3g}[m]", f"{scales.duration:.3g}[s]"
    axes = scales.axes
    places = " + ".join(f"{{k{a}}}*x.{a}/{length}" for a in axes)
    turns = [a for a in "xyz" if axes == "xyz" or a not in axes]
    made = {
        "speed": (f"{{k}}*log(max(speed/{v}, 0.001))*{law}", ("k",)),
        "position": (f"({places})*{law}", tuple(f"k{a}" for a in axes)),
        "time": (f"({{k}} + {{c}}*t/{t})*t/{t}*{law}", ("k", "c")),
        "contact": (f"{{k}}*contact*{law}", ("k",)),
        "direction": (
            f"cross({' + '.join(f'{{k{a}}}*e{a}' for a in turns)}, {law})",
            tuple(f"k{a}" for a in turns),
        ),
    }
    if scales.spin > 0.0:
        w = f"{scales.spin:.3g}[rad/s]"
        made["spin"] = (f"{{k}}*spin/{w}*{law} + {{c}}*cross(omega, v)/{w}/{v}", ("k", "c"))
    return {name: Term(name, text, "", frozenset(), strengths) for name, (text, strengths) in made.items()}
