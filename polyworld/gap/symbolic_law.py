"""A law of force composed of terms of the library: its expression, and its effect in a world as a hypothesis."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.hypothesis import Hypothesis, Part
from polyworld.estimation.unknown import Unknown
from polyworld.expressions.parse import MAX_EXPRESSION_PARAMETERS, MAX_LENGTH
from polyworld.gap.adding import free_name, with_parts
from polyworld.gap.symbolic_terms import Shape, Term
from polyworld.world import Effect

EFFECT = "unexplained"  # name of the effect in the world, numbered where the world has one already
STRENGTH = Shape("", "m/s^2", -100.0, 100.0, 0.3, (0.0,))  # wider than any force that leaves a body in view


@dataclass(frozen=True)
class Law:
    """A sum of terms. The numbers of a single term keep their names, those of several are numbered."""

    terms: tuple[Term, ...] = ()

    @property
    def numbers(self) -> dict[str, Shape]:
        """Numbers by name, term by term, strengths first."""
        return {self._name(i, n): s for i, term in enumerate(self.terms) for n, s in _numbers(term).items()}

    @property
    def text(self) -> str:
        """The expression, an acceleration [m/s^2]."""
        return self._written({})

    def literal(self, values: Mapping[str, float]) -> str:
        """Write the expression with values and units in the place of names."""
        units = {n: "" if s.unit == "1" else f"[{s.unit}]" for n, s in self.numbers.items()}
        return self._written({n: f"{v:.10g}{units[n]}" for n, v in values.items()})

    @property
    def fits(self) -> bool:
        """Whether one expression can hold it."""
        return len(self.numbers) <= MAX_EXPRESSION_PARAMETERS and len(self.text) <= MAX_LENGTH

    def hypothesis(self, base: Hypothesis) -> Hypothesis:
        """Add the law to a hypothesis: one effect in the world, each term a part with all of its starts."""
        if not self.terms:
            return base
        name = free_name(EFFECT, [e.name for e in base.world.effects])
        unknowns = {}
        for n, s in self.numbers.items():
            start = min(max(0.0, s.lower), s.upper)
            unknowns[n] = Unknown(n, (f"effects.{name}.{n}",), s.unit, start, s.lower, s.upper, s.typical)
        effect = Effect(
            name=name,
            kind="expression",
            expression=self.text,
            parameters={n: u.start for n, u in unknowns.items()},
            parameter_units={n: u.unit for n, u in unknowns.items() if u.unit != "1"},
            parameter_bounds={n: (u.lower, u.upper) for n, u in unknowns.items()},
        )
        world = with_parts(base.world, effects=(*base.world.effects, effect))
        parts = []
        for i, term in enumerate(self.terms):
            own = tuple(unknowns[self._name(i, n)] for n in _numbers(term))
            shapes = tuple(self._name(i, s.name) for s in term.shapes)
            begins = itertools.product(*(s.starts for s in term.shapes))
            starts = tuple(dict(zip(shapes, values, strict=True)) for values in begins)
            law = Candidate(term.name, "force", term.text, "", "", lambda *_: ())
            parts.append(Part(law, Variant(world, own, starts, idle=shapes)))
        return Hypothesis(world, base.base, (*base.parts, *parts))

    def _name(self, index: int, number: str) -> str:
        return number if len(self.terms) == 1 else f"{number}{index + 1}"

    def _written(self, values: Mapping[str, str]) -> str:
        """Return the sum with some numbers replaced by text; signs that follow each other are drawn together."""
        names = [{n: self._name(i, n) for n in _numbers(term)} for i, term in enumerate(self.terms)]
        parts = [
            term.text.format(**{n: values.get(full, full) for n, full in own.items()})
            for term, own in zip(self.terms, names, strict=True)
        ]
        text = " + ".join("-" + p[2:] if p.startswith("- ") else p for p in parts)
        text = text.replace("+ -", "- ").replace("- -", "+ ").replace("(--", "(")
        return text[2:].lstrip() if text.startswith(("--", "+ ")) else text


def _numbers(term: Term) -> dict[str, Shape]:
    """Return numbers of a term by name, strengths first."""
    return dict.fromkeys(term.strengths, STRENGTH) | {s.name: s for s in term.shapes}
