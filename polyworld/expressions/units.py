"""Units of measurement: dimensions of SI quantities, read from text and written as text."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from fractions import Fraction

_ORDER = ("kg", "m", "s")


@dataclass(frozen=True)
class Dimension:
    """Exponents of kilogram, metre and second. Angles have none, so rad is 1."""

    kg: Fraction = Fraction(0)
    m: Fraction = Fraction(0)
    s: Fraction = Fraction(0)

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(self.kg + other.kg, self.m + other.m, self.s + other.s)

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other.power(Fraction(-1))

    def power(self, exponent: Fraction) -> Dimension:
        """The dimension of a quantity raised to a power."""
        return Dimension(self.kg * exponent, self.m * exponent, self.s * exponent)

    def __str__(self) -> str:
        above = [_factor(n, getattr(self, n)) for n in _ORDER if getattr(self, n) > 0]
        below = [_factor(n, -getattr(self, n)) for n in _ORDER if getattr(self, n) < 0]
        text = " ".join(above) or "1"
        if len(below) > 1:
            return f"{text}/({' '.join(below)})"
        return f"{text}/{below[0]}" if below else text


ONE = Dimension()
METRE = Dimension(m=Fraction(1))
SECOND = Dimension(s=Fraction(1))
KILOGRAM = Dimension(kg=Fraction(1))
SPEED = METRE / SECOND
RATE = ONE / SECOND
ACCELERATION = SPEED / SECOND
FORCE = KILOGRAM * ACCELERATION

_UNITS: dict[str, Dimension] = {
    "kg": KILOGRAM,
    "m": METRE,
    "s": SECOND,
    "rad": ONE,
    "Hz": RATE,
    "N": FORCE,
    "J": FORCE * METRE,
    "W": FORCE * SPEED,
    "Pa": FORCE / METRE / METRE,
}


LONGEST_UNIT = 100  # characters


def parse_unit(text: str) -> Dimension:
    """The dimension of a unit such as `m/s^2`, `1/s`, `kg m`, `m^-0.5 s^-0.5` or `N/(m s)`.

    Raises ValueError for anything else; prefixes such as `mm` are not taken, for they would scale the value.
    """
    if len(text) > LONGEST_UNIT:
        raise ValueError(f"a unit has at most {LONGEST_UNIT} characters, got {len(text)}")
    joined = re.sub(r"(?<=[\w)])\s+(?=[A-Za-z(])", "*", text.strip()).replace("^", "**")
    try:
        tree = ast.parse(joined, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"{text!r} is no unit; write for example 'm/s^2', '1/s' or 'kg/(m s)'") from None
    return unit_of_tree(tree.body, text)


def unit_of_tree(node: ast.expr, text: str) -> Dimension:
    """The dimension of a unit that Python's grammar has read; `text` is what errors show."""
    match node:
        case ast.Constant(value=1):
            return ONE
        case ast.Name(id=name):
            if name not in _UNITS:
                raise ValueError(f"unknown unit {name!r} in {text!r}; units: {', '.join(_UNITS)}, without prefixes")
            return _UNITS[name]
        case ast.BinOp(left=ast.BinOp(op=ast.Div()), op=ast.Mult()):
            raise ValueError(f"{text!r} can be read in two ways; put what is below the line in brackets")
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return unit_of_tree(left, text) * unit_of_tree(right, text)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return unit_of_tree(left, text) / unit_of_tree(right, text)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return unit_of_tree(left, text).power(_exponent(right, text))
    raise ValueError(f"{text!r} is no unit; write for example 'm/s^2', '1/s' or 'kg/(m s)'")


def rational(value: float) -> Fraction:
    """A number as the fraction of small denominator that it was meant to be: 1.5, 0.3333333."""
    return Fraction(value).limit_denominator(1000)


def _exponent(node: ast.expr, text: str) -> Fraction:
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float() as value) if abs(value) <= 100.0:
            return rational(float(value))
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_exponent(operand, text)
        case ast.BinOp(left=left, op=ast.Div(), right=right) if _exponent(right, text) != 0:
            return _exponent(left, text) / _exponent(right, text)
    raise ValueError(f"an exponent in the unit {text!r} is no number up to 100")


def _factor(name: str, exponent: Fraction) -> str:
    if exponent == 1:
        return name
    exact = float(exponent)
    return f"{name}^{exponent.numerator}" if exponent.denominator == 1 else f"{name}^{exact:.6g}"
