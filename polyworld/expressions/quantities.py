"""Quantities of an expression: numbers or vectors with a dimension, and the operations on them.

Vectors are taken apart here, so that the program that comes out knows numbers only. Every operation checks units and
says which term has which.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from polyworld.expressions import program as ops
from polyworld.expressions.units import ACCELERATION, KILOGRAM, METRE, ONE, RATE, SECOND, SPEED, Dimension, rational

WHOLE_POWERS = range(2, 5)  # powers that are multiplied out


@dataclass(frozen=True)
class Quantity:
    """A value of the program being built. parts: one register number, or three of a vector.

    dimension: None for the number zero, which may stand for nothing of any unit. number: its value where it is a
    constant. text: how it was written.
    """

    parts: tuple[int, ...]
    dimension: Dimension | None
    text: str
    number: float | None = None

    @property
    def vector(self) -> bool:
        return len(self.parts) == 3

    def described(self) -> str:
        """The term with its unit, for errors."""
        unit = "any unit" if self.dimension is None else f"{self.dimension}"
        return f"{self.text!r} ({'vector, ' if self.vector else ''}{unit})"


class Operations:
    """Operations that an expression may use, each on quantities, emitting into one builder."""

    def __init__(self, builder: ops.Builder) -> None:
        self.builder = builder
        self._emit = builder.emit

    # --- what there is -------------------------------------------------------------------------

    def constant(self, value: float, dimension: Dimension | None, text: str) -> Quantity:
        """A number; plain zero has no unit of its own."""
        kept = None if value == 0.0 and dimension == ONE else dimension
        return Quantity((self._emit(ops.CONSTANT, value),), kept, text, value)

    def known(self, name: str) -> Quantity | None:
        """A word of the vocabulary; None where it is none."""
        slot = ops.INPUT_SLOTS
        if name in _VECTORS:
            parts, dimension = _VECTORS[name]
            return Quantity(tuple(slot[p] for p in parts), dimension, name)
        if name in _SCALARS:
            return Quantity((slot[name],), _SCALARS[name], name)
        if name in ("speed", "spin"):
            of = self.known("v" if name == "speed" else "omega")
            assert of is not None
            return self.norm(of, name)
        if name in ("ex", "ey", "ez"):
            axis = "xyz".index(name[1])
            return Quantity(tuple(self._emit(ops.CONSTANT, float(i == axis)) for i in range(3)), ONE, name)
        return None

    # --- arithmetic ----------------------------------------------------------------------------

    def add(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        return self._both(ops.ADD, a, b, text, "add")

    def subtract(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        return self._both(ops.SUB, a, b, text, "subtract")

    def negative(self, a: Quantity, text: str) -> Quantity:
        number = None if a.number is None else -a.number
        return Quantity(tuple(self._emit(ops.NEG, p) for p in a.parts), a.dimension, text, number)

    def multiply(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        if a.vector and b.vector:
            raise ValueError(f"{text!r} multiplies two vectors; write dot(a, b) or cross(a, b)")
        if b.vector:
            a, b = b, a
        dimension = None if a.dimension is None or b.dimension is None else a.dimension * b.dimension
        number = None if a.number is None or b.number is None else a.number * b.number
        return Quantity(tuple(self._emit(ops.MUL, p, b.parts[0]) for p in a.parts), dimension, text, number)

    def divide(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        if b.vector:
            raise ValueError(f"{text!r} divides by the vector {b.text!r}; divide by norm({b.text}) or a component")
        if b.dimension is None:
            raise ValueError(f"{text!r} divides by zero")
        dimension = None if a.dimension is None else a.dimension / b.dimension
        number = a.number / b.number if a.number is not None and b.number else None
        return Quantity(tuple(self._emit(ops.DIV, p, b.parts[0]) for p in a.parts), dimension, text, number)

    def power(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        if a.vector or b.vector:
            raise ValueError(f"{text!r} raises a vector to a power; write dot(a, a) or norm(a)^p")
        if b.dimension not in (None, ONE):
            raise ValueError(f"the exponent {b.described()} must be a number without unit, in {text!r}")
        if b.number is not None:
            dimension = None if a.dimension is None else a.dimension.power(rational(b.number))
            return Quantity((self._fixed_power(a.parts[0], b.number),), dimension, text)
        if a.dimension not in (None, ONE):
            raise ValueError(
                f"in {text!r} the exponent can change, so what is raised must have no unit, but {a.described()}; "
                f"divide it by one of its unit: ({a.text}/1[{str(a.dimension).replace(' ', '*')}])^{b.text}"
            )
        return Quantity((self._emit(ops.POW, a.parts[0], b.parts[0]),), a.dimension, text)

    def _fixed_power(self, base: int, exponent: float) -> int:
        if exponent in WHOLE_POWERS:
            value = base
            for _ in range(int(exponent) - 1):
                value = self._emit(ops.MUL, value, base)
            return value
        if exponent == 0.5:
            return self._emit(ops.SQRT, base)
        return base if exponent == 1.0 else self._emit(ops.POW, base, self._emit(ops.CONSTANT, exponent))

    def component(self, a: Quantity, axis: int, text: str) -> Quantity:
        if not a.vector:
            raise ValueError(f"{a.text!r} is no vector and has no component, in {text!r}")
        return Quantity((a.parts[axis],), a.dimension, text)

    # --- functions -----------------------------------------------------------------------------

    def norm(self, a: Quantity, text: str) -> Quantity:
        self._must_be_vector(a, text)
        return Quantity((self._emit(ops.SQRT, self._dot(a, a)),), a.dimension, text)

    def dot(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        self._must_be_vector(a, text)
        self._must_be_vector(b, text)
        dimension = None if a.dimension is None or b.dimension is None else a.dimension * b.dimension
        return Quantity((self._dot(a, b),), dimension, text)

    def cross(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        self._must_be_vector(a, text)
        self._must_be_vector(b, text)
        dimension = None if a.dimension is None or b.dimension is None else a.dimension * b.dimension
        parts = []
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            one = self._emit(ops.MUL, a.parts[j], b.parts[k])
            parts.append(self._emit(ops.SUB, one, self._emit(ops.MUL, a.parts[k], b.parts[j])))
        return Quantity(tuple(parts), dimension, text)

    def unit(self, a: Quantity, text: str) -> Quantity:
        """The direction of a vector; zero for the zero vector, which has none."""
        length = self.norm(a, text).parts[0]
        return Quantity(tuple(self._emit(ops.RATIO, p, length) for p in a.parts), ONE, text)

    def sqrt(self, a: Quantity, text: str) -> Quantity:
        self._must_be_number(a, text)
        return self.power(a, self.constant(0.5, ONE, "0.5"), text)

    def abs(self, a: Quantity, text: str) -> Quantity:
        self._must_be_number(a, text)
        return Quantity((self._emit(ops.ABS, a.parts[0]),), a.dimension, text)

    def step(self, a: Quantity, text: str) -> Quantity:
        """1 where the argument is above zero, else 0."""
        self._must_be_number(a, text)
        return Quantity((self._emit(ops.STEP, a.parts[0]),), ONE, text)

    def min(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        return self._extreme(ops.MIN, a, b, text)

    def max(self, a: Quantity, b: Quantity, text: str) -> Quantity:
        return self._extreme(ops.MAX, a, b, text)

    def plain(self, operation: int) -> Callable[[Quantity, str], Quantity]:
        """A function of a number without unit that gives such a number: sin, exp, ..."""

        def apply(a: Quantity, text: str) -> Quantity:
            self._must_be_number(a, text)
            if a.dimension not in (None, ONE):
                raise ValueError(f"the argument of {text!r} must have no unit, but {a.described()}")
            return Quantity((self._emit(operation, a.parts[0]),), ONE, text)

        return apply

    def functions(self) -> dict[str, tuple[int, Callable[..., Quantity]]]:
        """Name -> (number of arguments, function of them and the text)."""
        found: dict[str, tuple[int, Callable[..., Quantity]]] = {
            name: (1, self.plain(code))
            for name, code in {
                "sin": ops.SIN,
                "cos": ops.COS,
                "exp": ops.EXP,
                "log": ops.LOG,
                "tanh": ops.TANH,
            }.items()
        }
        found |= {name: (1, getattr(self, name)) for name in ("sqrt", "abs", "step", "norm", "unit")}
        found |= {name: (2, getattr(self, name)) for name in ("min", "max", "dot", "cross")}
        return found

    # --- checks --------------------------------------------------------------------------------

    def _dot(self, a: Quantity, b: Quantity) -> int:
        total = self._emit(ops.MUL, a.parts[0], b.parts[0])
        for p, q in zip(a.parts[1:], b.parts[1:], strict=True):
            total = self._emit(ops.ADD, total, self._emit(ops.MUL, p, q))
        return total

    def _extreme(self, operation: int, a: Quantity, b: Quantity, text: str) -> Quantity:
        self._must_be_number(a, text)
        self._must_be_number(b, text)
        return self._both(operation, a, b, text, "compare")

    def _both(self, operation: int, a: Quantity, b: Quantity, text: str, verb: str) -> Quantity:
        if a.vector != b.vector:
            raise ValueError(f"cannot {verb} a vector and a number: {a.described()} and {b.described()} in {text!r}")
        if a.dimension != b.dimension and None not in (a.dimension, b.dimension):
            raise ValueError(f"cannot {verb} {a.described()} and {b.described()}, in {text!r}: the units differ")
        parts = tuple(self._emit(operation, p, q) for p, q in zip(a.parts, b.parts, strict=True))
        number = None
        if a.number is not None and b.number is not None and operation in (ops.ADD, ops.SUB):
            number = a.number + (b.number if operation == ops.ADD else -b.number)
        return Quantity(parts, b.dimension if a.dimension is None else a.dimension, text, number)

    def _must_be_vector(self, a: Quantity, text: str) -> None:
        if not a.vector:
            raise ValueError(f"{text!r} needs a vector, but {a.described()} is a number")

    def _must_be_number(self, a: Quantity, text: str) -> None:
        if a.vector:
            raise ValueError(f"{text!r} needs a number, but {a.described()} is a vector; write norm({a.text})")


_VECTORS: dict[str, tuple[tuple[str, str, str], Dimension]] = {
    "x": (("x", "y", "z"), METRE),
    "v": (("vx", "vy", "vz"), SPEED),
    "omega": (("omega_x", "omega_y", "omega_z"), RATE),
    "g": (("gx", "gy", "gz"), ACCELERATION),
}
_SCALARS: dict[str, Dimension] = {
    "vx": SPEED,
    "vy": SPEED,
    "vz": SPEED,
    "t": SECOND,
    "contact": ONE,
    "mass": KILOGRAM,
    "radius": METRE,
}
VOCABULARY: dict[str, str] = {
    "x": "position, vector [m]; its components x.x, x.y, x.z",
    "v": "velocity, vector [m/s]; its components vx, vy, vz",
    "omega": "angular velocity, vector [rad/s]; 0 for nodes of deformable objects",
    "g": "gravitational acceleration, vector [m/s^2]",
    "ex": "unit vector along world x",
    "ey": "unit vector along world y",
    "ez": "unit vector along world z, which is up",
    "vx": "component of velocity [m/s]",
    "vy": "component of velocity [m/s]",
    "vz": "component of velocity [m/s]",
    "speed": "length of v [m/s]",
    "spin": "length of omega [rad/s]",
    "t": "time [s]",
    "contact": "1 while the body touches something, else 0",
    "mass": "mass of the body, or of the node of a deformable object [kg]",
    "radius": "radius of the ball with the body's volume, 0 for a node [m]",
}
FUNCTIONS = tuple(Operations(ops.Builder()).functions())
