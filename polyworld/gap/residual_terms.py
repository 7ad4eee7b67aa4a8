"""Terms from which the law of an unexplained force is put together, each an expression with numbers to be fitted.

A term is a direction times a magnitude: along the velocity, along an axis, away from a point or across the spin; with
a power of the speed, a polynomial of the position, a course in time, or the spin. Every strength is an acceleration
[m/s^2] at a reference speed, length or spin, so that strengths of all terms have the same scale and are nearly
independent of the exponents.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

Factor = Literal["speed", "position", "time", "spin", "contact"]

STRENGTH = 100.0  # bound of a strength [m/s^2]
EXPONENTS = (0.5, 1.0, 1.5, 2.0, 3.0)  # tried first; fits then move freely
EXPONENT_BOUNDS = (0.0, 6.0)


@dataclass(frozen=True)
class Scales:
    """What is ordinary in the motion: speed [m/s], extent, centre (3,) [m], duration, sampling [s], spin [rad/s].

    axes: letters of the world axes along which anything moves. spin is 0 where nothing turns.
    """

    speed: float
    length: float
    centre: tuple[float, float, float]
    duration: float
    interval: float
    spin: float
    axes: str


@dataclass(frozen=True)
class Shape:
    """A number on which a term depends otherwise than in proportion: unit, bounds, and values from which fits begin."""

    name: str
    unit: str
    lower: float
    upper: float
    typical: float
    starts: tuple[float, ...]


@dataclass(frozen=True)
class Term:
    """One summand of a law of force.

    text: expression, with the names of strengths and shapes in braces. strengths: numbers [m/s^2] it is proportional
    to. shapes: other numbers. factors: what it depends on. direction: for readers.
    """

    name: str
    text: str
    direction: str
    factors: frozenset[Factor]
    strengths: tuple[str, ...] = ("k",)
    shapes: tuple[Shape, ...] = ()

    def starts(self) -> tuple[dict[str, float], ...]:
        """All combinations of the values from which the shapes begin."""
        names = [s.name for s in self.shapes]
        return tuple(dict(zip(names, v, strict=True)) for v in itertools.product(*(s.starts for s in self.shapes)))

    def written(self, names: Mapping[str, str]) -> str:
        """The expression with its numbers named, or replaced, as told."""
        return self.text.format(**names)


def library(scales: Scales) -> tuple[Term, ...]:
    """All terms that make sense for a motion, in a fixed order."""
    return (
        *_along_velocity(scales),
        *_by_axis(scales),
        *_of_position(scales),
        *_of_time(scales),
        *_across(scales),
        *(_of_spin(scales) if scales.spin > 0.0 else ()),
    )


def _number(value: float, unit: str) -> str:
    return f"{value:.3g}[{unit}]"


def _exponent(name: str = "p", starts: tuple[float, ...] = EXPONENTS) -> Shape:
    return Shape(name, "1", *EXPONENT_BOUNDS, 0.5, starts)


def _term(name: str, text: str, direction: str, *factors: Factor, shapes: tuple[Shape, ...] = ()) -> Term:
    return Term(name, text, direction, frozenset(factors), shapes=shapes)


def _in_fixed_direction(
    name: str, course: str, scales: Scales, *factors: Factor, shapes: tuple[Shape, ...] = ()
) -> Term:
    """A force whose direction is fixed and unknown: a strength an axis, all with one course."""
    vector = " + ".join(f"{{k{a}}}*e{a}" for a in scales.axes)
    strengths = tuple(f"k{a}" for a in scales.axes)
    return Term(name, f"{course}({vector})", "in a fixed direction", frozenset(factors), strengths, shapes)


def _along_velocity(scales: Scales) -> Iterator[Term]:
    v = _number(scales.speed, "m/s")
    p = (_exponent(),)
    along = "along the velocity"
    drag = f"(speed/{v})^{{p}}*unit(v)"
    yield _term("drag", f"-{{k}}*{drag}", along, "speed", shapes=p)
    if scales.axes == "xyz":
        flat = "(v - vz*ez)"
        text = f"-{{k}}*(norm{flat}/{v})^{{p}}*unit{flat}"
        yield _term("horizontal drag", text, "along the horizontal velocity", "speed", shapes=p)
    yield _term("drag in contact", f"-{{k}}*contact*{drag}", along, "speed", "contact", shapes=p)
    yield _term("drag out of contact", f"-{{k}}*(1 - contact)*{drag}", along, "speed", "contact", shapes=p)
    decay = (_exponent(starts=(0.0, 1.0, 2.0)), _decay(scales))
    yield _term("drag that decays", f"-{{k}}*exp(-t/{{tau}})*{drag}", along, "speed", "time", shapes=decay)
    yield _term("drag that grows", f"-{{k}}*t/{_number(scales.duration, 's')}*{drag}", along, "speed", "time", shapes=p)
    for a in scales.axes:
        place = f"x.{a}/{_number(scales.length, 'm')}"
        yield _term(f"drag with {a}", f"-{{k}}*{place}*{drag}", along, "speed", "position", shapes=p)
    wind = "v" + "".join(f" - {{u{a}}}*e{a}" for a in scales.axes)
    speeds = tuple(
        Shape(
            f"u{a}",
            "m/s",
            -5.0 * scales.speed,
            5.0 * scales.speed,
            0.3 * scales.speed,
            (-0.5 * scales.speed, 0.5 * scales.speed),
        )
        for a in scales.axes
    )
    text = f"-{{k}}*(norm({wind})/{v})^{{p}}*unit({wind})"
    shapes = (_exponent(starts=(1.0, 2.0)), *speeds)
    yield _term("drag in moving air", text, "along the velocity relative to moving air", "speed", shapes=shapes)


def _by_axis(scales: Scales) -> Iterator[Term]:
    v = _number(scales.speed, "m/s")
    p = (_exponent(),)

    def one(axis: str, strength: str) -> str:
        way = f"(step(v{axis}) - step(-v{axis}))"
        return f"-{{{strength}}}*(abs(v{axis})/{v})^{{p}}*{way}*e{axis}"

    for a in scales.axes:
        yield _term(f"drag along {a}", one(a, "k"), f"along {a}, against that component", "speed", shapes=p)
    if len(scales.axes) > 1:
        text = "".join(one(a, "k") for a in scales.axes).replace("-{", " - {").strip()
        yield _term("drag of each component", text, "against each component by itself", "speed", shapes=p)
        strengths = tuple(f"k{a}" for a in scales.axes)
        text = "".join(one(a, f"k{a}") for a in scales.axes).replace("-{", " - {").strip()
        factors: frozenset[Factor] = frozenset({"speed"})
        direction = "against each component by itself"
        yield Term("unequal drag of the components", text, direction, factors, strengths, p)
        # By the direction of the velocity, so that p is the exponent of the force.
        straight = " ".join(f"- {{k{a}}}*(speed/{v})^{{p}}*dot(unit(v), e{a})*e{a}" for a in scales.axes)
        shapes = (_exponent(starts=(1.0, 2.0)),)
        direction = "against the velocity, by axes"
        yield Term("anisotropic drag", straight, direction, factors, strengths, shapes)
    for a, b in itertools.permutations(scales.axes, 2):
        yield _term(f"force along {a} with v{b}", f"{{k}}*v{b}/{v}*e{a}", f"along {a}", "speed")
    for a in scales.axes:
        shapes = (_exponent(starts=(1.0, 2.0)),)
        yield _term(
            f"force along {a} with speed", f"{{k}}*(speed/{v})^{{p}}*e{a}", f"along {a}", "speed", shapes=shapes
        )


def _of_position(scales: Scales) -> Iterator[Term]:
    length = _number(scales.length, "m")
    products = {
        "*".join(places): "*".join(f"x.{b}/{length}" for b in places)
        for degree in (1, 2)
        for places in itertools.combinations_with_replacement(scales.axes, degree)
    }
    for a in scales.axes:
        yield _term(f"constant force along {a}", f"{{k}}*e{a}", f"along {a}")
        for name, product in products.items():
            yield _term(f"force along {a} with {name}", f"{{k}}*{product}*e{a}", f"along {a}", "position")
    if len(scales.axes) > 1:
        yield _in_fixed_direction("constant force", "", scales)
        for name, product in products.items():
            yield _in_fixed_direction(f"force with {name}", f"{product}*", scales, "position")
    strengths = ("k", *(f"a{a}" for a in scales.axes))
    constant = "".join(f" + {{a{a}}}*e{a}" for a in scales.axes)
    towards: frozenset[Factor] = frozenset({"position"})
    yield Term("linear attraction", f"-{{k}}*x/{length}{constant}", "towards a point", towards, strengths)
    point = "(x" + "".join(f" - {{c{a}}}*e{a}" for a in scales.axes) + ")"
    middle = dict(zip("xyz", scales.centre, strict=True))
    reach = scales.length
    at = tuple(
        Shape(f"c{a}", "m", middle[a] - 5 * reach, middle[a] + 5 * reach, 0.3 * reach, _around(middle[a], reach))
        for a in scales.axes
    )
    radial = (Shape("q", "1", -4.0, 4.0, 0.5, (-2.0, 1.0)), *at)
    yield _term(
        "central force",
        f"-{{k}}*(norm{point}/{length})^{{q}}*unit{point}",
        "towards a point",
        "position",
        shapes=radial,
    )


def _of_time(scales: Scales) -> Iterator[Term]:
    slow = 0.5 / scales.duration
    fast = min(0.25 / scales.interval, 40.0 * slow)
    rates = tuple(slow * (fast / slow) ** (i / 15.0) for i in range(16)) if fast > slow else (slow,)
    f = (Shape("f", "Hz", 0.2 * slow, max(fast, slow) * 2.0, 0.1 / scales.duration, rates),)
    tau = (_decay(scales),)
    wave = (*f, Shape("h", "1", -1.0, 1.0, 0.1, (0.0, 0.25)))
    for a in scales.axes:
        along = f"along {a}"
        yield _term(f"decaying force along {a}", f"{{k}}*exp(-t/{{tau}})*e{a}", along, "time", shapes=tau)
        yield _term(f"growing force along {a}", f"{{k}}*t/{_number(scales.duration, 's')}*e{a}", along, "time")
        text = f"({{k}}*sin(6.283185307179586*{{f}}*t) + {{c}}*cos(6.283185307179586*{{f}}*t))*e{a}"
        yield Term(f"periodic force along {a}", text, along, frozenset({"time"}), ("k", "c"), f)
    if len(scales.axes) > 1:
        yield _in_fixed_direction("decaying force", "exp(-t/{tau})*", scales, "time", shapes=tau)
        yield _in_fixed_direction("growing force", f"t/{_number(scales.duration, 's')}*", scales, "time")
        yield _in_fixed_direction(
            "periodic force", "sin(6.283185307179586*({f}*t + {h}))*", scales, "time", shapes=wave
        )


def _across(scales: Scales) -> Iterator[Term]:
    v = _number(scales.speed, "m/s")
    for a in "xyz" if scales.axes == "xyz" else [c for c in "xyz" if c not in scales.axes]:
        shapes = (_exponent(starts=(1.0, 2.0)),)
        text = f"{{k}}*(speed/{v})^{{p}}*cross(e{a}, unit(v))"
        yield _term(f"deflection about {a}", text, f"across the velocity and {a}", "speed", shapes=shapes)


def _of_spin(scales: Scales) -> Iterator[Term]:
    v, w = _number(scales.speed, "m/s"), _number(scales.spin, "rad/s")
    both = (_exponent(starts=(1.0, 2.0)), _exponent("q", (1.0, 2.0)))
    across = "across spin and velocity"
    yield _term("lift", f"{{k}}*cross(omega, v)/{w}/{v}", across, "speed", "spin")
    text = f"{{k}}*(spin/{w})^{{q}}*(speed/{v})^{{p}}*cross(unit(omega), unit(v))"
    yield _term("lift by powers", text, across, "speed", "spin", shapes=both)
    text = f"-{{k}}*(spin/{w})^{{q}}*(speed/{v})^{{p}}*unit(v)"
    yield _term("drag with spin", text, "along the velocity", "speed", "spin", shapes=both)
    yield _term("force along the spin", f"{{k}}*omega/{w}", "along the spin", "spin")


def _decay(scales: Scales) -> Shape:
    t = scales.duration
    return Shape("tau", "s", 0.02 * t, 20.0 * t, 0.2 * t, (0.1 * t, 0.2 * t, 0.4 * t, t))


def _around(middle: float, reach: float) -> tuple[float, ...]:
    return (middle - reach, middle, middle + reach)
