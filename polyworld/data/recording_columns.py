"""Columns of a table of measured motion: which quantity a header names, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from polyworld.world.units import Dimension, Unit, find_unit, unit_names

PLACE = ("x", "y", "z")
TURN = ("qw", "qx", "qy", "qz")
SPIN = ("wx", "wy", "wz")
THETA = "theta"
PIXELS = ("u", "v")
YAW, FRAME, CONFIDENCE, SIGMA = "yaw", "frame", "confidence", "sigma"
MOTION = (*PLACE, *TURN, *SPIN, THETA, YAW, *PIXELS)
MEASURED = (*MOTION, CONFIDENCE, SIGMA, FRAME)  # the numbers of a row, in this order
LABELS = ("run", "object")
QUANTITIES = (*LABELS, "t", *MEASURED)

DIMENSIONS: Mapping[str, Dimension] = {
    "t": "time",
    **dict.fromkeys(PLACE, "length"),
    **dict.fromkeys(SPIN, "angular velocity"),
    THETA: "angle",
    YAW: "angle",
    SIGMA: "length",
    **dict.fromkeys(PIXELS, "pixels"),
}
_HAVING_UNITS = tuple(dict.fromkeys(DIMENSIONS.values()))
# Other names of a quantity, in lower case, with every run of other signs as one underscore.
_ALIASES: tuple[tuple[str, str], ...] = (
    ("t", "time timestamp time_stamp times elapsed elapsed_time"),
    ("frame", "frames frame_number frame_no frame_nr frame_index frame_id"),
    ("run", "runs trial take throw toss drop launch shot repetition run_id trial_id run_no trial_no"),
    ("object", "objects name id body label object_id object_name obj"),
    ("z", "height altitude elevation"),
    (CONFIDENCE, "likelihood"),
    (SIGMA, "position_sigma"),
    (THETA, "angle phi θ φ"),
    *((a, f"{a}_pos pos_{a} pos{a} {a}_position position_{a} {a}_coordinate {a}_coord") for a in PLACE),
    *((a, f"center_{a} centre_{a} {a}_center {a}_centre") for a in PLACE),
    *((f"q{a}", f"q_{a} quat_{a} quaternion_{a} orientation_{a}") for a in "wxyz"),
    *((f"w{a}", f"w_{a} omega_{a} omega{a} ω{a} ω_{a} angular_velocity_{a} spin_{a}") for a in "xyz"),
)
_QUANTITY_OF = {name: name for name in QUANTITIES}
_QUANTITY_OF |= {alias: quantity for quantity, names in _ALIASES for alias in names.split()}


def quantity_of(header: str) -> str | None:
    """Return the quantity that a header names, with or without a unit; None for another."""
    return _QUANTITY_OF.get(_plain(_bracketed(header)[0]))


@dataclass(frozen=True)
class Units:
    """Units of columns whose headers state none. by_dimension: unit of a dimension; by_column: unit of a quantity."""

    by_dimension: Mapping[Dimension, Unit] = field(default_factory=dict)
    by_column: Mapping[str, Unit] = field(default_factory=dict)

    @classmethod
    def of(cls, text: str) -> Units:
        """Return units written as `mm,ms` or `x=mm,t=ms`; raises ValueError that names the valid choices."""
        by_dimension: dict[Dimension, Unit] = {}
        by_column: dict[str, Unit] = {}
        for part in filter(None, (p.strip() for p in text.split(","))):
            left, equals, right = (p.strip() for p in part.rpartition("="))
            unit = find_unit(right)
            if unit is None:
                raise ValueError(
                    f"units {text!r}: {right!r} is no unit; known are {', '.join(map(unit_names, _HAVING_UNITS))}"
                )
            if not equals:
                if unit.dimension in by_dimension:
                    raise ValueError(f"units {text!r}: two units of {unit.dimension}; name the column, as in x={right}")
                by_dimension[unit.dimension] = unit
                continue
            quantity = _QUANTITY_OF.get(_plain(left))
            if quantity is None or quantity not in DIMENSIONS:
                raise ValueError(
                    f"units {text!r}: {left!r} is no column with a unit; those are {', '.join(DIMENSIONS)}"
                )
            if unit.dimension != DIMENSIONS[quantity]:
                raise ValueError(_mismatch(f"units {text!r}: ", quantity, unit))
            by_column[quantity] = unit
        return cls(by_dimension, by_column)


@dataclass(frozen=True)
class Column:
    """A column that is used. index: its place in a row; header: as written; factor: of its unit, to SI; has_unit:
    whether one is stated."""

    index: int
    header: str
    factor: float = 1.0
    has_unit: bool = False


def renamed(line: int, header: Sequence[str], meanings: Mapping[str, str]) -> list[str]:
    """Return a header with other names, by those in the file or by place (1, 2, ...).

    Units of the file's are kept where none is given. Raises ValueError for a column that is not there.
    """
    places = {str(i): name for i, name in enumerate(header, start=1)}
    given = {name if name in header else places.get(name, name): meant for name, meant in meanings.items()}

    def meaning(name: str) -> str:
        own, unit = given.get(name, name), _bracketed(name)[1]
        return f"{own} [{unit}]" if unit and name in given and _bracketed(own)[1] is None else own

    absent = [name for name in given if name not in header]
    if absent:
        known = ", ".join(name for name in header if quantity_of(name)) or "none is known"  # others may be secret
        raise ValueError(
            f"line {line}: no column is called {', '.join(map(repr, absent))}; columns: {known}; others by their "
            f"places, 1 to {len(header)}"
        )
    return [meaning(name) for name in header]


def name_columns(
    line: int, header: Sequence[str], units: Units, quantities: Collection[str] = QUANTITIES
) -> tuple[dict[str, Column], list[str]]:
    """Return the columns of a header by quantity, and the headers of columns that are not used.

    A header is the name of one of `quantities` or an alias, in any case, and may state a unit: `x [mm]`, `x (mm)`,
    `x/mm`, `x_mm`, or a length for one of its own, as in `x [0.002 m]`. Where several columns name one quantity, the
    one with its own name is used. line: of the header, for errors. Raises ValueError for units that do not fit and
    for columns that repeat.
    """
    found: dict[str, Column] = {}
    exact: set[str] = set()
    ignored = []
    for index, written in enumerate(header):
        name, unit = _named(line, written, quantities)
        quantity = name if name in quantities else _QUANTITY_OF.get(name)
        if quantity is None or quantity not in quantities:
            ignored.append(written or f"column {index + 1} without a name")
            continue
        own = name == quantity
        if quantity in found and own == (quantity in exact):
            first = found[quantity].header
            which = f"repeat: {written}" if own else f"{first!r} and {written!r} both give {quantity}; keep one of them"
            raise ValueError(f"line {line}: columns {which}")
        if quantity in found and not own:
            ignored.append(written)
            continue
        if quantity in found:
            ignored.append(found[quantity].header)
        unit = _unit(line, written, quantity, unit, units)
        found[quantity] = Column(index, written, 1.0 if unit is None else unit.factor, unit is not None)
        if own:
            exact.add(quantity)
    absent = [q for q in units.by_column if q not in found]
    if absent:
        raise ValueError(
            f"line {line}: a unit is given for {', '.join(absent)}, which no column holds; columns: {', '.join(header)}"
        )
    return found, ignored


def _named(line: int, written: str, quantities: Collection[str]) -> tuple[str, Unit | None]:
    """Return the name of a column in plain form, "" for one of no quantity, and the unit that its header states."""
    name, stated = _bracketed(written)
    plain = _plain(name)
    quantity = plain if plain in quantities else _QUANTITY_OF.get(plain)
    if quantity is None and stated is None:
        return _suffixed(plain)
    if quantity not in DIMENSIONS or stated in (None, "", "-", "1"):
        return plain, None
    assert quantity is not None
    assert stated is not None
    unit = find_unit(stated)
    if unit is not None and unit.dimension == "pixels" and quantity in PLACE:
        return _pixel(quantity), unit
    if quantity in PIXELS and (unit is None or unit.dimension != "pixels"):  # v [m/s] is a speed
        return "", None
    if unit is None:
        raise ValueError(
            f"line {line}: column {written!r} states an unknown unit; {quantity} is in one of "
            f"{unit_names(DIMENSIONS[quantity])}"
        )
    if unit.dimension != DIMENSIONS[quantity]:
        raise ValueError(_mismatch(f"line {line}: column {written!r}: ", quantity, unit))
    return plain, unit


def _bracketed(written: str) -> tuple[str, str | None]:
    """Return name and unit of a header such as `x [mm]`, `x (mm)` or `x/mm`."""
    match = re.fullmatch(r"\s*(.*?)\s*[\[(]\s*(.*?)\s*[\])]\s*", written)
    if match is None:
        match = re.fullmatch(r"\s*([^/]*?)\s*/\s*(.*?)\s*", written)
    return (written, None) if match is None else (match[1], match[2])


def _suffixed(plain: str) -> tuple[str, Unit | None]:
    """Return name and unit of a header such as `x_mm` or `wx_rad_s`; "" where it is not one."""
    words = plain.replace("_in_", "_").split("_")
    for count in range(1, len(words)):
        name, unit = "_".join(words[:count]), find_unit("_".join(words[count:]))
        quantity = _QUANTITY_OF.get(name)
        if quantity is None or unit is None:
            continue
        if unit.dimension == "pixels" and quantity in PLACE:
            return _pixel(quantity), unit
        if unit.dimension == DIMENSIONS.get(quantity):
            return name, unit
    if len(words) == 2 and words[0] in ("px", "pixel") and words[1] in PLACE:
        return _pixel(words[1]), None
    return "", None


def _pixel(axis: str) -> str:
    return {"x": "u", "y": "v"}.get(axis, "")


def _plain(name: str) -> str:
    return re.sub(r"[^\w°]+", "_", name.strip().lower()).strip("_")


def _unit(line: int, written: str, quantity: str, unit: Unit | None, units: Units) -> Unit | None:
    """Return the unit of a column, stated in its header or beside the file."""
    if quantity not in DIMENSIONS:
        return None
    given = units.by_column.get(quantity)
    if unit is not None and given is not None and unit.factor != given.factor:
        raise ValueError(f"line {line}: column {written!r} is in {unit.name}, but {given.name} is given for {quantity}")
    return unit or given or units.by_dimension.get(DIMENSIONS[quantity])


def _mismatch(where: str, quantity: str, unit: Unit) -> str:
    needed = DIMENSIONS[quantity]
    return f"{where}{unit.name} is a unit of {unit.dimension}; {quantity} is in one of {unit_names(needed)}"
