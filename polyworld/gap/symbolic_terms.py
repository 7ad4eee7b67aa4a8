"""Library of terms that the law of an unexplained force is composed of, scaled to the motion that was recorded.

A term is a direction times a magnitude: along the velocity, along an axis, towards a point or across the spin; with a
power of the speed, a polynomial of the position, a course in time, or the spin. Every strength is an acceleration
[m/s^2] at a reference speed, length or spin, so that strengths of all terms have one scale and depend little on the
exponents.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.gap.conditions import conditions

Factor = Literal["speed", "position", "time", "spin", "contact"]

FLAT = 0.02  # share of half the extent, below which nothing moves along an axis


@dataclass(frozen=True)
class Scales:
    """Typical sizes of a motion: speed [m/s], half its extent, centre (3,) [m], duration, sampling [s], spin [rad/s].

    axes: letters of the world axes along which anything moves. spin is 0 where nothing turns.
    """

    speed: float
    length: float
    centre: Sequence[float]
    duration: float
    interval: float
    spin: float
    axes: str


@dataclass(frozen=True)
class Shape:
    """A number that a term is not proportional to: unit, bounds, ordinary change, and values where fits begin."""

    name: str
    unit: str
    lower: float
    upper: float
    typical: float
    starts: tuple[float, ...]


@dataclass(frozen=True)
class Term:
    """One summand of a law of force.

    text: expression, with the names of strengths and shapes in braces. direction: for readers. factors: what it depends
    on. strengths: numbers [m/s^2] it is proportional to. shapes: its other numbers.
    """

    name: str
    text: str
    direction: str
    factors: frozenset[Factor]
    strengths: tuple[str, ...] = ("k",)
    shapes: tuple[Shape, ...] = ()


def scales_of(trial: FittedHypothesis) -> Scales:
    """Measure the scales of the motion of all runs; the spin is that of the conditions and of fitted initial states."""
    plan = trial.context.design
    found = conditions(plan.world, plan.recording)
    extent = found.upper - found.lower
    length = max(float(extent.max()) / 2.0, 1e-6)
    spins = [
        np.linalg.norm(trial.fit.states[r.index][[".angular_velocity." in label for label in r.labels]])
        for r in plan.runs
    ]
    return Scales(
        speed=found.speed,
        length=length,
        centre=found.middle.tolist(),
        duration=found.duration,
        interval=min(float(np.median(np.diff(r.times))) for r in plan.runs),
        spin=max(found.spin, *map(float, spins)),
        axes="".join("xyz"[i] for i in found.axes if plan.world.planar or extent[i] > FLAT * length),
    )


def library(scales: Scales) -> tuple[Term, ...]:
    """List all terms that make sense for a motion, in a fixed order."""
    return (
        *_drag(scales),
        *_by_component(scales),
        *_in_one_direction(scales),
        *_towards_a_point(scales),
        *_across(scales),
        *(_of_spin(scales) if scales.spin > 0.0 else ()),
    )


def _number(value: float, unit: str) -> str:
    return f"{value:.3g}[{unit}]"


def _vector(axes: str, prefix: str) -> str:
    return " + ".join(f"{{{prefix}{a}}}*e{a}" for a in axes)


def _exponent(name: str = "p", starts: tuple[float, ...] = (0.5, 1.0, 1.5, 2.0, 3.0)) -> Shape:
    return Shape(name, "1", 0.0, 6.0, 0.5, starts)


def _decay(t: float) -> Shape:
    return Shape("tau", "s", 0.02 * t, 20.0 * t, 0.2 * t, (0.1 * t, 0.2 * t, 0.4 * t, t))


def _term(name: str, text: str, direction: str, *factors: Factor, shapes: tuple[Shape, ...] = ()) -> Term:
    return Term(name, text, direction, frozenset(factors), shapes=shapes)


def _drag(scales: Scales) -> Iterator[Term]:
    v, t = _number(scales.speed, "m/s"), _number(scales.duration, "s")
    drag, along, p = f"(speed/{v})^{{p}}*unit(v)", "along the velocity", (_exponent(),)
    yield _term("drag", f"-{{k}}*{drag}", along, "speed", shapes=p)
    if scales.axes == "xyz":
        flat = "(v - vz*ez)"
        text = f"-{{k}}*(norm{flat}/{v})^{{p}}*unit{flat}"
        yield _term("horizontal drag", text, "along the horizontal velocity", "speed", shapes=p)
    yield _term("drag in contact", f"-{{k}}*contact*{drag}", along, "speed", "contact", shapes=p)
    yield _term("drag out of contact", f"-{{k}}*(1 - contact)*{drag}", along, "speed", "contact", shapes=p)
    decay = (_exponent(starts=(0.0, 1.0, 2.0)), _decay(scales.duration))
    yield _term("drag that decays", f"-{{k}}*exp(-t/{{tau}})*{drag}", along, "speed", "time", shapes=decay)
    yield _term("drag that grows", f"-{{k}}*t/{t}*{drag}", along, "speed", "time", shapes=p)
    for a in scales.axes:
        place = f"x.{a}/{_number(scales.length, 'm')}"
        yield _term(f"drag with {a}", f"-{{k}}*{place}*{drag}", along, "speed", "position", shapes=p)
    wind = "v" + "".join(f" - {{u{a}}}*e{a}" for a in scales.axes)
    u = scales.speed
    speeds = (Shape(f"u{a}", "m/s", -5.0 * u, 5.0 * u, 0.3 * u, (-0.5 * u, 0.5 * u)) for a in scales.axes)
    text = f"-{{k}}*(norm({wind})/{v})^{{p}}*unit({wind})"
    shapes = (_exponent(starts=(1.0, 2.0)), *speeds)
    yield _term("drag in moving air", text, "along the velocity relative to moving air", "speed", shapes=shapes)


def _by_component(scales: Scales) -> Iterator[Term]:
    """Drag of each velocity component by itself, and forces in proportion to another component."""
    v, axes = _number(scales.speed, "m/s"), scales.axes
    p = (_exponent(),)

    def one(a: str, strength: str) -> str:
        return f"- {{{strength}}}*(abs(v{a})/{v})^{{p}}*(step(v{a}) - step(-v{a}))*e{a}"

    for a in axes:
        yield _term(f"drag along {a}", one(a, "k"), f"along {a}, against that component", "speed", shapes=p)
    if len(axes) > 1:
        each, speed = "against each component by itself", frozenset[Factor]({"speed"})
        strengths = tuple(f"k{a}" for a in axes)
        yield _term("drag of each component", " ".join(one(a, "k") for a in axes), each, "speed", shapes=p)
        unequal = " ".join(one(a, f"k{a}") for a in axes)
        yield Term("unequal drag of the components", unequal, each, speed, strengths, p)
        # By the direction of the velocity, so that p is the exponent of the force.
        by_axes = " ".join(f"- {{k{a}}}*(speed/{v})^{{p}}*dot(unit(v), e{a})*e{a}" for a in axes)
        shapes = (_exponent(starts=(1.0, 2.0)),)
        yield Term("anisotropic drag", by_axes, "against the velocity, by axes", speed, strengths, shapes)
    for a, b in itertools.permutations(axes, 2):
        yield _term(f"force along {a} with v{b}", f"{{k}}*v{b}/{v}*e{a}", f"along {a}", "speed")


def _in_one_direction(scales: Scales) -> Iterator[Term]:
    """Return forces along one axis, or in a fixed direction that is unknown, with a magnitude that varies."""
    axes, t = scales.axes, scales.duration
    slow = 0.5 / t
    fast = max(min(0.25 / scales.interval, 40.0 * slow), slow)
    frequency = Shape("f", "Hz", 0.2 * slow, 2.0 * fast, 0.1 / t, tuple(np.geomspace(slow, fast, 16).tolist()))
    wave = (frequency, Shape("h", "1", -1.0, 1.0, 0.1, (0.0, 0.25)))
    length, speed = _number(scales.length, "m"), f"(speed/{_number(scales.speed, 'm/s')})^{{p}}*"
    magnitudes: list[tuple[str, str, frozenset[Factor], tuple[Shape, ...]]] = [("constant force", "", frozenset(), ())]
    for b in [*axes, *itertools.combinations_with_replacement(axes, 2)]:
        product = "".join(f"x.{c}/{length}*" for c in b)
        magnitudes.append((f"force with {'*'.join(b)}", product, frozenset({"position"}), ()))
    magnitudes += [
        ("force with speed", speed, frozenset({"speed"}), (_exponent(starts=(1.0, 2.0)),)),
        ("decaying force", "exp(-t/{tau})*", frozenset({"time"}), (_decay(t),)),
        ("growing force", f"t/{_number(t, 's')}*", frozenset({"time"}), ()),
        ("periodic force", "sin(6.283185307179586*({f}*t + {h}))*", frozenset({"time"}), wave),
    ]
    for name, magnitude, factors, shapes in magnitudes:
        for a in axes:
            yield Term(f"{name} along {a}", f"{magnitude}{{k}}*e{a}", f"along {a}", factors, shapes=shapes)
        if len(axes) > 1:
            strengths = tuple(f"k{a}" for a in axes)
            text = f"{magnitude}({_vector(axes, 'k')})"
            yield Term(name, text, "in a fixed direction", factors, strengths, shapes)


def _towards_a_point(scales: Scales) -> Iterator[Term]:
    length, reach = _number(scales.length, "m"), scales.length
    spring, strengths = f"-{{k}}*x/{length} + {_vector(scales.axes, 'a')}", ("k", *(f"a{a}" for a in scales.axes))
    yield Term("linear attraction", spring, "towards a point", frozenset({"position"}), strengths)
    point = "(x" + "".join(f" - {{c{a}}}*e{a}" for a in scales.axes) + ")"
    shapes = [Shape("q", "1", -4.0, 4.0, 0.5, (-2.0, 1.0))]
    for a in scales.axes:
        c = scales.centre["xyz".index(a)]
        shapes.append(Shape(f"c{a}", "m", c - 5 * reach, c + 5 * reach, 0.3 * reach, (c - reach, c, c + reach)))
    text = f"-{{k}}*(norm{point}/{length})^{{q}}*unit{point}"
    yield _term("central force", text, "towards a point", "position", shapes=tuple(shapes))


def _across(scales: Scales) -> Iterator[Term]:
    v = _number(scales.speed, "m/s")
    shapes = (_exponent(starts=(1.0, 2.0)),)
    for a in "xyz" if scales.axes == "xyz" else [c for c in "xyz" if c not in scales.axes]:
        text = f"{{k}}*(speed/{v})^{{p}}*cross(e{a}, unit(v))"
        yield _term(f"deflection about {a}", text, f"across the velocity and {a}", "speed", shapes=shapes)


def _of_spin(scales: Scales) -> Iterator[Term]:
    v, w = _number(scales.speed, "m/s"), _number(scales.spin, "rad/s")
    both = (_exponent(starts=(1.0, 2.0)), _exponent("q", (1.0, 2.0)))
    across = "across spin and velocity"
    yield _term("lift", f"{{k}}*cross(omega, v)/{w}/{v}", across, "speed", "spin")
    powers = f"{{k}}*(spin/{w})^{{q}}*(speed/{v})^{{p}}"
    yield _term("lift by powers", f"{powers}*cross(unit(omega), unit(v))", across, "speed", "spin", shapes=both)
    yield _term("drag with spin", f"-{powers}*unit(v)", "along the velocity", "speed", "spin", shapes=both)
    yield _term("force along the spin", f"{{k}}*omega/{w}", "along the spin", "spin")
