"""List the terms that a law of an unexplained force may be made of, as candidates of the search.

A term is a direction times a magnitude: along the velocity, along fixed axes, towards a point or across the velocity;
with a power of the speed, a polynomial of the position, a course in time, or the spin. Its strengths are accelerations
[m/s^2] at the speed, length and spin of the motion, so that they have one scale and depend little on exponents.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from polyworld.data.recording import Recording
from polyworld.effects.conditions import Conditions
from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Candidate, Variant, free_name, with_parts
from polyworld.gap.conditions import conditions
from polyworld.world import Effect, World

EFFECT = "unexplained"  # name of the effect in the world, numbered where the world has one already
FLAT = 0.01  # share of the extent below which nothing moves along an axis
WIDEST, ORDINARY = 1e3, 0.1  # bound and ordinary change of strengths, in those that stop the motion in its duration
FREQUENCIES = 16  # from which the fit of a periodic force begins
SPEED, POSITION, TIME, SPIN = "speed", "position", "time", "spin"  # what a term depends on


@dataclass(frozen=True)
class Number:
    """A number of a term: unit, bounds, ordinary change, and the values where fits begin."""

    name: str
    unit: str
    lower: float
    upper: float
    typical: float
    starts: tuple[float, ...]


@dataclass(frozen=True)
class Term:
    """One summand of a law of force.

    text: expression, an acceleration. direction: for readers. factors: what it depends on. strengths: numbers [m/s^2]
    that it is proportional to. shapes: its other numbers.
    """

    name: str
    text: str
    direction: str
    factors: tuple[str, ...]
    strengths: tuple[Number, ...]
    shapes: tuple[Number, ...]

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All numbers, strengths first."""
        return (*self.strengths, *self.shapes)

    def written(self, shown: Mapping[str, str]) -> str:
        """Return the expression with other texts in the place of its numbers."""
        return re.sub(r"\b[a-z]+\b", lambda word: shown.get(word[0], word[0]), self.text)

    def candidate(self) -> Candidate:
        """Return the candidate that adds the term as an effect of its own."""
        return Candidate(self.name, "force", self.text, partial(_variants, self))


def _variants(term: Term, world: World, _: Recording) -> tuple[Variant]:
    """Return the one way to add a term: at strengths of zero, from every start of its shapes."""
    name = free_name(EFFECT, [e.name for e in world.effects])
    effect = Effect(
        name=name,
        kind="expression",
        expression=term.text,
        parameters={n.name: n.starts[0] for n in term.numbers},
        parameter_units={n.name: n.unit for n in term.numbers if n.unit != "1"},
        parameter_bounds={n.name: (n.lower, n.upper) for n in term.numbers},
    )
    unknowns = tuple(
        Unknown(n.name, (f"effects.{name}.{n.name}",), n.unit, n.starts[0], n.lower, n.upper, n.typical)
        for n in term.numbers
    )
    idle = tuple(n.name for n in term.shapes)
    starts = tuple(dict(zip(idle, v, strict=True)) for v in itertools.product(*(n.starts for n in term.shapes)))
    return (Variant(with_parts(world, effects=(*world.effects, effect)), unknowns, starts, idle=idle),)


def names_in_sum(terms: Sequence[Term]) -> list[dict[str, str]]:
    """Return by term the names that its numbers have in the sum: numbered where there are several terms."""
    return [{n.name: f"{n.name}{i + 1 if len(terms) > 1 else ''}" for n in t.numbers} for i, t in enumerate(terms)]


def sum_text(terms: Sequence[Term], values: Mapping[str, str] | None = None) -> str:
    """Return the sum of terms as one expression, with values by name in the place of its numbers."""
    shown = values or {}
    named = zip(terms, names_in_sum(terms), strict=True)
    return _sum(*(t.written({own: shown.get(name, name) for own, name in names.items()}) for t, names in named))


def library(world: World, recording: Recording) -> tuple[Term, ...]:
    """Return the terms that make sense for the motion of a recording, in a fixed order."""
    found = conditions(world, recording)
    moving = [a for a in found.axes if found.planar or found.upper[a] - found.lower[a] > FLAT * found.size]
    axes = "".join("xyz"[a] for a in moving)
    return (*_drag(found, axes), *_fixed(found, axes), *_towards_and_across(found, axes)) if axes else ()


def _drag(found: Conditions, axes: str) -> Iterator[Term]:
    """Yield forces against the velocity, its components, or that relative to moving air."""
    speed, t, term = f"{found.speed:.3g}[m/s]", found.duration, partial(_term, found)
    power, along = f"(speed/{speed})^p", "along the velocity"
    yield term("drag", f"-k*{power}*unit(v)", along, (SPEED,), _exponent(0.5, 1.0, 1.5, 2.0, 3.0))
    text = f"-k*exp(-t/tau)*{power}*unit(v)"
    yield term("drag that decays", text, along, (SPEED, TIME), _exponent(1.0, 2.0), _decay(t))
    yield term("drag that grows", f"-k*t/{t:.3g}[s]*{power}*unit(v)", along, (SPEED, TIME), _exponent(1.0, 2.0))
    for a in axes:
        text = f"-k*x.{a}/{_length(found)}*{power}*unit(v)"
        yield term(f"drag with {a}", text, along, (SPEED, POSITION), _exponent(1.0, 2.0))
    air, u = _sum("v", *(f"-u{a}*e{a}" for a in axes)), found.speed
    winds = [Number(f"u{a}", "m/s", -5.0 * u, 5.0 * u, 0.3 * u, (-0.5 * u, 0.5 * u)) for a in axes]
    text, moving = f"-k*(norm({air})/{speed})^p*unit({air})", "along the velocity relative to moving air"
    yield term("drag in moving air", text, moving, (SPEED,), _exponent(1.0, 2.0), *winds)
    parts = {a: f"-k*(abs(v{a})/{speed})^p*(step(v{a}) - step(-v{a}))*e{a}" for a in axes}
    for a, text in parts.items():
        yield term(f"drag along {a}", text, f"along {a}, against that component", (SPEED,), _exponent(1.0, 2.0))
    if len(axes) > 1:
        each = "against each component by itself"
        yield term("drag of each component", _sum(*parts.values()), each, (SPEED,), _exponent(0.5, 1.0, 2.0, 3.0))
        text = _sum(*(f"-k{a}*{power}*dot(unit(v), e{a})*e{a}" for a in axes))
        by_axes = "against the velocity, by axes"
        yield term("anisotropic drag", text, by_axes, (SPEED,), _exponent(1.0, 2.0), strengths=_each("k", axes))


def _fixed(found: Conditions, axes: str) -> Iterator[Term]:
    """Yield forces in a fixed direction that is unknown, with a magnitude that varies."""
    t, slow = found.duration, 0.5 / found.duration
    fast = max(min(0.25 / found.frame, 40.0 * slow), slow)
    grid = tuple(np.geomspace(slow, fast, FREQUENCIES).tolist())
    wave = (Number("f", "Hz", 0.2 * slow, 2.0 * fast, 0.1 / t, grid), Number("h", "1", -1.0, 1.0, 0.1, (0.0, 0.25)))
    magnitudes: list[tuple[str, str, tuple[str, ...], tuple[Number, ...]]] = [
        ("constant force", "", (), ()),
        ("decaying force", "exp(-t/tau)*", (TIME,), (_decay(t),)),
        ("growing force", f"t/{t:.3g}[s]*", (TIME,), ()),
        ("periodic force", "sin(6.283185307179586*(f*t + h))*", (TIME,), wave),
    ]
    for b in (*axes, *itertools.combinations_with_replacement(axes, 2)):
        place = "".join(f"x.{c}/{_length(found)}*" for c in b)
        magnitudes.append((f"force with {'*'.join(b)}", place, (POSITION,), ()))
    direction = "in a fixed direction" if len(axes) > 1 else f"along {axes}"
    for name, magnitude, factors, shapes in magnitudes:
        text = f"{magnitude}({_sum(*(f'k{a}*e{a}' for a in axes))})"
        yield _term(found, name, text, direction, factors, *shapes, strengths=_each("k", axes))


def _towards_and_across(found: Conditions, axes: str) -> Iterator[Term]:
    """Yield forces towards a point, and across the velocity."""
    term, reach, power = partial(_term, found), 0.5 * found.size, f"(speed/{found.speed:.3g}[m/s])^p"
    text, towards = _sum(f"-k*x/{_length(found)}", *(f"a{a}*e{a}" for a in axes)), "towards a point"
    yield term("linear attraction", text, towards, (POSITION,), strengths=("k", *_each("a", axes)))
    places = []
    for a, c in ((a, float(found.middle["xyz".index(a)])) for a in axes):
        starts = (c - 0.5 * reach, c + 0.5 * reach) if len(axes) == 3 else (c - 0.8 * reach, c, c + 0.8 * reach)
        places.append(Number(f"c{a}", "m", c - 5.0 * reach, c + 5.0 * reach, 0.3 * reach, starts))
    point = _sum("x", *(f"-c{a}*e{a}" for a in axes))
    text, q = f"-k*(norm({point})/{_length(found)})^q*unit({point})", Number("q", "1", -4.0, 4.0, 0.5, (-2.0, 1.0))
    yield term("central force", text, towards, (POSITION,), q, *places)
    for a in "xyz" if len(axes) == 3 else sorted(set("xyz") - set(axes)):
        text, across = f"k*{power}*cross(e{a}, unit(v))", f"across the velocity and {a}"
        yield term(f"deflection about {a}", text, across, (SPEED,), _exponent(1.0, 2.0))
    if found.spin > 0.0:
        both, shapes = f"(spin/{found.spin:.3g}[rad/s])^q*{power}", (_exponent(1.0, 2.0, name="q"), _exponent(1.0, 2.0))
        text, across = f"k*{both}*cross(unit(omega), unit(v))", "across spin and velocity"
        yield term("lift", text, across, (SPEED, SPIN), *shapes)
        yield term("drag with spin", f"-k*{both}*unit(v)", "along the velocity", (SPEED, SPIN), *shapes)


def _term(
    found: Conditions,
    name: str,
    text: str,
    direction: str,
    factors: tuple[str, ...],
    *shapes: Number,
    strengths: tuple[str, ...] = ("k",),
) -> Term:
    size = found.speed / found.duration
    own = [Number(k, "m/s^2", -WIDEST * size, WIDEST * size, ORDINARY * size, (0.0,)) for k in strengths]
    return Term(name, text, direction, factors, tuple(own), shapes)


def _exponent(*starts: float, name: str = "p") -> Number:
    return Number(name, "1", 0.0, 6.0, 0.5, starts)


def _decay(t: float) -> Number:
    return Number("tau", "s", 0.02 * t, 20.0 * t, 0.2 * t, (0.1 * t, 0.2 * t, 0.4 * t, t))


def _length(found: Conditions) -> str:
    return f"{0.5 * found.size:.3g}[m]"


def _each(prefix: str, axes: str) -> tuple[str, ...]:
    return tuple(f"{prefix}{a}" for a in axes)


def _sum(*texts: str) -> str:
    """Return a sum with signs that follow each other drawn together."""
    text = " + ".join(texts)
    for twice, once in (("--", ""), ("+ -", "- "), ("- -", "+ ")):
        text = text.replace(twice, once)
    return text
