"""A law of force put together from terms: its effect in the world, its fit, and the score of further terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.criteria import extended_bic
from polyworld.estimation.descent import Linearised
from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise, refined_noise
from polyworld.estimation.profile import Fit, fit, project_out
from polyworld.estimation.unknown import Unknown
from polyworld.expressions.parse import MAX_LENGTH
from polyworld.gap.adding import free_name
from polyworld.gap.residual_terms import STRENGTH, Factor, Term
from polyworld.world import World

Array = NDArray[np.float64]

EFFECT = "unexplained"  # name of the effect in the world, numbered where the world has one already
MAX_PARAMETERS = 8
TYPICAL = 0.3  # an ordinary unexplained acceleration [m/s^2]
STEP = 1e-3  # of it, for derivatives at zero strength
FACTOR_COST = 0.5
REFITS = 3
SAME_NOISE = 0.02  # relative change of levels, or change of correlations
SEEN = 1.0  # a term that at an ordinary strength moves chi2 by less than this is not looked for


@dataclass(frozen=True)
class Problem:
    """What is to be explained: a design, its base unknowns and noise, and whom the force acts on (None: all).

    library: how many terms there are to choose from.
    """

    design: Design
    world: World
    base: tuple[Unknown, ...]
    noise: Noise
    library: int = 1
    objects: tuple[str, ...] | None = None
    cancelled: Callable[[], bool] | None = None


@dataclass(frozen=True)
class Law:
    """A sum of terms. With one term its numbers keep their names, with more they are numbered."""

    terms: tuple[Term, ...]

    def name(self, index: int, number: str) -> str:
        """Name in the law of a term's number."""
        return number if len(self.terms) == 1 else f"{number}{index + 1}"

    @cached_property
    def numbers(self) -> tuple[tuple[str, str, float, float, float], ...]:
        """Name, unit, bounds and ordinary change of all numbers: term by term, strengths first."""
        found = []
        for i, term in enumerate(self.terms):
            found += [(self.name(i, s), "m/s^2", -STRENGTH, STRENGTH, TYPICAL) for s in term.strengths]
            found += [(self.name(i, s.name), s.unit, s.lower, s.upper, s.typical) for s in term.shapes]
        return tuple(found)

    @property
    def text(self) -> str:
        """The expression."""
        return self.written({})

    def written(self, values: Mapping[str, str]) -> str:
        """The expression with some of its numbers replaced by text."""
        parts = []
        for i, term in enumerate(self.terms):
            names = [*term.strengths, *(s.name for s in term.shapes)]
            parts.append(term.written({n: values.get(self.name(i, n), self.name(i, n)) for n in names}))
        return _tidy(" + ".join("-" + p[2:] if p.startswith("- ") else p for p in parts))

    def literal(self, values: Mapping[str, float]) -> str:
        """The expression with numbers in the place of names."""
        units = {name: unit for name, unit, *_ in self.numbers}
        return self.written({n: f"{v:.10g}" + ("" if units[n] == "1" else f"[{units[n]}]") for n, v in values.items()})

    def depends_on(self, factor: Factor) -> bool:
        """Whether any of its terms does."""
        return any(factor in term.factors for term in self.terms)

    def unknowns(self, world: World) -> tuple[Unknown, ...]:
        """What is fitted of it when it is added to a world; strengths begin at zero."""
        effect = _effect_name(world)
        return tuple(
            Unknown(name, (f"effects.{effect}.{name}",), unit, float(np.clip(0.0, low, high)), low, high, typical)
            for name, unit, low, high, typical in self.numbers
        )

    def in_world(self, world: World, objects: tuple[str, ...] | None, values: Mapping[str, float]) -> World:
        """The world with the law as an effect; numbers that are not given are at their neutral values."""
        if not self.terms:
            return world
        starts = {u.name: u.start for u in self.unknowns(world)}
        effect = {
            "name": _effect_name(world),
            "kind": "expression",
            "expression": self.text,
            "parameters": {n: values.get(n, s) for n, s in starts.items()},
            "parameter_units": {n: unit for n, unit, *_ in self.numbers if unit != "1"},
            "parameter_bounds": {n: (low, high) for n, _, low, high, _ in self.numbers},
            "objects": objects,
        }
        content = world.model_dump()
        return World.model_validate({**content, "effects": (*content["effects"], effect)})


@dataclass(frozen=True)
class FittedLaw:
    """A law with its fit. values (S,) of the fit begin with the base unknowns. ebic: the criterion."""

    law: Law
    fit: Fit
    ebic: float

    def numbers(self, base: int) -> dict[str, float]:
        """Fitted numbers of the law by name; base: count of base unknowns."""
        return {n: float(v) for (n, *_), v in zip(self.law.numbers, self.fit.values[base:], strict=True)}


@dataclass(frozen=True)
class Score:
    """What a further term promises. gain: fall of chi2 if the model were linear. values: the term's numbers there."""

    term: Term
    gain: float
    values: tuple[float, ...]


def _effect_name(world: World) -> str:
    return free_name(EFFECT, [e.name for e in world.effects])


def _tidy(text: str) -> str:
    """Signs that follow each other drawn together."""
    text = text.replace("+ -", "- ").replace("- -", "+ ").replace("(--", "(")
    return text[2:].lstrip() if text.startswith(("--", "+ ")) else text


def criterion(problem: Problem, law: Law, chi2: float) -> float:
    """Extended BIC of a law.

    Each factor costs a little, so that of laws which the data cannot tell apart the one that depends on less wins.
    """
    factors = sum(len(t.factors) for t in law.terms)
    count = problem.noise.count
    return extended_bic(chi2, len(law.numbers), count, len(law.terms), problem.library) + FACTOR_COST * factors


def room_for(law: Law, term: Term) -> bool:
    """Whether a term can be added: an effect has but so many parameters, an expression so many characters."""
    longer = Law((*law.terms, term))
    return len(longer.numbers) <= MAX_PARAMETERS and len(longer.text) <= MAX_LENGTH


def fit_law(problem: Problem, law: Law, start: Fit, numbers: Sequence[float]) -> FittedLaw:
    """Fit a law together with base unknowns and initial states; base and states begin at those of `start`."""
    forward = Forward(
        problem.design,
        law.in_world(problem.world, problem.objects, {}),
        (*problem.base, *law.unknowns(problem.world)),
        problem.cancelled,
    )
    values = np.concatenate([start.values[: len(problem.base)], np.asarray(numbers, dtype=float)])
    fitted = fit(forward, problem.noise, values, start.states)
    for _ in range(REFITS):  # long valleys, as of an exponent and a strength that pull together, take more than one
        if fitted.converged:
            break
        fitted = fit(forward, problem.noise, fitted.values, fitted.states)
    return FittedLaw(law, fitted, criterion(problem, law, fitted.chi2))


def refitted(problem: Problem, known: FittedLaw) -> FittedLaw:
    """A law fitted on from where it stands, under the problem's noise."""
    return fit_law(problem, known.law, known.fit, known.fit.values[len(problem.base) :].tolist())


def with_refined_noise(problem: Problem, known: FittedLaw) -> Problem:
    """The problem under the noise that a law's residuals tell; the very same where that changes next to nothing."""
    world = known.law.in_world(problem.world, problem.objects, {})
    forward = Forward(problem.design, world, (*problem.base, *known.law.unknowns(problem.world)), problem.cancelled)
    settings = [Settings(r.index, known.fit.values[None], known.fit.states[r.index][None]) for r in problem.design.runs]
    noise = refined_noise(problem.design, problem.noise, [raw[0] for raw in forward.residuals(settings)])
    levels = max(float(np.max(np.abs(a / b - 1.0))) for a, b in zip(noise.sigma, problem.noise.sigma, strict=True))
    linked = max(float(np.max(np.abs(a - b))) for a, b in zip(noise.rho, problem.noise.rho, strict=True))
    kept = all(bool(np.all(a == b)) for a, b in zip(noise.kept, problem.noise.kept, strict=True))
    return problem if kept and max(levels, linked) <= SAME_NOISE else replace(problem, noise=noise)


def score_term(problem: Problem, known: FittedLaw, term: Term) -> Score | None:
    """What a term adds to a fitted law, by Rao's score at zero strength, over all starts of its shapes.

    None where the motion would not show it at an ordinary strength.
    """
    law = Law((*known.law.terms, term))
    base = len(problem.base)
    starts = np.array([tuple(s.values()) for s in term.starts()]).reshape(len(term.starts()), len(term.shapes))
    settled = known.fit.values
    strengths = len(term.strengths)
    rows = [np.concatenate([settled, np.zeros(strengths), starts[0]])]
    for shape in starts:
        for s in range(strengths):
            step = np.zeros(strengths)
            step[s] = STEP * TYPICAL
            rows.append(np.concatenate([settled, step, shape]))
    world = law.in_world(problem.world, problem.objects, {})
    forward = Forward(problem.design, world, (*problem.base, *law.unknowns(problem.world)), problem.cancelled)
    assert len(rows[0]) == base + len(law.numbers)
    directions = _slopes(problem, forward, np.array(rows), STEP * TYPICAL, known.fit)
    information, gradient = project_out(known.fit, directions)
    best: Score | None = None
    for j, shape in enumerate(starts):
        own = slice(j * strengths, (j + 1) * strengths)
        matrix, vector = information[own, own], gradient[own]
        if np.diag(matrix).max(initial=0.0) * TYPICAL**2 < SEEN:
            continue
        strength = -np.linalg.pinv(matrix, rcond=1e-8, hermitian=True) @ vector
        gain = float(-vector @ strength)
        if best is None or gain > best.gain:
            best = Score(term, gain, (*np.clip(strength, -STRENGTH, STRENGTH).tolist(), *shape.tolist()))
    return best


def _slopes(problem: Problem, forward: Forward, rows: Array, step: float, known: Fit) -> Linearised:
    """Derivatives of the whitened residuals: of all rows but the first against the first, with initial states kept."""
    settings = [
        Settings(r.index, rows, np.repeat(known.states[r.index][None], len(rows), axis=0)) for r in problem.design.runs
    ]
    slopes = []
    for r, raw in zip(problem.design.runs, forward.residuals(settings), strict=True):
        white = problem.noise.whiten(r.index, raw)
        slope = (white[1:] - white[0]).T / step
        slopes.append(np.where(np.isfinite(slope), slope, 0.0))
    return Linearised(known.linear.r, tuple(slopes), known.linear.b)
