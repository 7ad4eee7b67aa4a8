"""Units of measured quantities, and numbers written with their unit such as `40mm`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

Dimension = Literal["length", "time", "angle", "angular velocity", "velocity", "mass", "pixels"]


@dataclass(frozen=True)
class Unit:
    """A unit of measurement: one of it is `factor` of the SI unit (of pixels: of one pixel)."""

    name: str
    dimension: Dimension
    factor: float


_TURN = 2.0 * math.pi
# Dimension -> factor and names of each unit; the first name is the one that is printed.
_TABLE: dict[Dimension, tuple[tuple[float, str], ...]] = {
    "length": (
        (1.0, "m metre metres meter meters"),
        (1e-2, "cm centimetre centimetres centimeter centimeters"),
        (1e-3, "mm millimetre millimetres millimeter millimeters"),
        (1e-6, "um micron microns micrometre micrometres micrometer micrometers"),
        (1e3, "km kilometre kilometres kilometer kilometers"),
        (0.0254, "in inch inches"),
        (0.3048, "ft foot feet"),
        (0.9144, "yd yard yards"),
    ),
    "time": (
        (1.0, "s sec secs second seconds"),
        (1e-3, "ms msec millisecond milliseconds"),
        (1e-6, "us usec microsecond microseconds"),
        (1e-9, "ns nsec nanosecond nanoseconds"),
        (60.0, "min minute minutes"),
    ),
    "angle": (
        (1.0, "rad radian radians"),
        (_TURN / 360.0, "deg degree degrees °"),
        (1e-3, "mrad"),
        (_TURN, "rev revs revolution revolutions turn turns"),
    ),
    "angular velocity": (
        (1.0, "1/s"),
        (_TURN / 60.0, "rpm r/min"),
        (_TURN / 360.0, "dps"),
        (_TURN, "rps r/s hz"),
    ),
    "velocity": (),  # a length per time
    "mass": (
        (1.0, "kg kilogram kilograms"),
        (1e-3, "g gram grams"),
        (1e-6, "mg"),
        (0.45359237, "lb lbs pound pounds"),
        (0.028349523125, "oz ounce ounces"),
    ),
    "pixels": ((1.0, "px pixel pixels pix"),),
}
_UNITS = {
    name: Unit(names.split()[0], dimension, factor)
    for dimension, rows in _TABLE.items()
    for factor, names in rows
    for name in names.split()
}
_RATIOS: dict[Dimension, Dimension] = {"angle": "angular velocity", "length": "velocity"}


def find_unit(text: str) -> Unit | None:
    """Return the unit that a text names, None where it names none; ratios such as `deg/s` and `rad_s` included,
    and multiples such as `0.002 m`."""
    multiple = re.fullmatch(r"\s*([+-]?\d*\.?\d+(?:e[+-]?\d+)?)\s*([a-zµμ°].*)", text.lower())
    if multiple is not None:
        unit = find_unit(multiple[2])
        factor = float(multiple[1])
        return None if unit is None or factor == 0.0 else Unit(text.strip(), unit.dimension, factor * unit.factor)
    plain = text.strip().lower().replace("µ", "u").replace("μ", "u")
    plain = re.sub(r"[\s_·*.]*\bs\s*(\^\s*)?[-−]\s*1$|[\s·*.]*s⁻¹$", "/s", plain)
    plain = re.sub(r"[\s_/]+per[\s_/]+", "/", plain)
    plain = re.sub(r"[\s_]+", "/", plain)
    if plain in _UNITS:
        return _UNITS[plain]
    above, slash, below = plain.partition("/")
    if not slash or above not in _UNITS or below not in _UNITS:
        return None
    measure, interval = _UNITS[above], _UNITS[below]
    if measure.dimension not in _RATIOS or interval.dimension != "time":
        return None
    return Unit(f"{measure.name}/{interval.name}", _RATIOS[measure.dimension], measure.factor / interval.factor)


def unit_names(dimension: Dimension) -> str:
    """Return the names of the units of a dimension, for messages."""
    ratios = [f"{names.split()[0]}/s" for above, of in _RATIOS.items() if of == dimension for _, names in _TABLE[above]]
    return ", ".join([*ratios[:2], *(names.split()[0] for _, names in _TABLE[dimension])])


def read_quantity(text: str, dimension: Dimension) -> float:
    """Return a number with its unit, such as `40mm`, in SI; a number without a unit is in SI already.

    Raises ValueError that names the units to choose from.
    """
    match = re.fullmatch(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", text)
    if match is None:
        raise ValueError(f"{text!r} is not a number with a unit of {dimension} ({unit_names(dimension)})")
    if not match[2]:
        return float(match[1])
    unit = find_unit(match[2])
    if unit is None or unit.dimension != dimension:
        raise ValueError(f"{text!r}: {match[2]!r} is no unit of {dimension}; choose from {unit_names(dimension)}")
    return float(match[1]) * unit.factor
