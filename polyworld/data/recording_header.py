"""The header of a table of measured motion: which columns are used, for which quantity, and by which clock."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.pixel_scale import PixelScale
from polyworld.data.recording_columns import (
    FRAME,
    LABELS,
    MEASURED,
    MOTION,
    PIXELS,
    PLACE,
    SIGMA,
    SPIN,
    THETA,
    TURN,
    YAW,
    Column,
    Units,
    name_columns,
    quantity_of,
    renamed,
)
from polyworld.data.table import short
from polyworld.data.table_forms import Line, Table, has_number
from polyworld.world.units import find_unit

Array = NDArray[np.float64]

_ACCELERATION = re.compile(r"\b(linear_)?acc(el(eration|erometer)?)?(_?[xyz])?\b|\ba[xyz]\b")
FARTHEST = 500.0  # extent of positions [m] beyond which they are hardly metres
SLOWEST = 2.0  # time between rows [s] beyond which times are hardly seconds: milliseconds, at up to 500 a second
MOST_TURNS = 4  # turns beyond which an angle is hardly in radians
_ALONG_NOTHING = ("position", "pos", "distance", "displacement")  # of which axis?


@dataclass(frozen=True)
class RecordingForm:
    """Reading options of a table, for what its header does not state.

    columns: other headers for columns, by those in the file, such as {"y": "z [mm]"}; columns of a table without a
    header are called "1", "2", ... units: of columns that state none, as `mm,ms` or `x=mm,t=ms`. seconds_per_frame [s]:
    times are taken from the column frame. pixels: the scale of columns u, v (or of x, y without a unit).
    theta_described [rad]: the reading of theta in the pose that the world describes; theta_hanging [rad]: instead
    of it, the reading where the body hangs.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: str = ""
    seconds_per_frame: float | None = None
    pixels: PixelScale | None = None
    theta_described: float = 0.0
    theta_hanging: float | None = None


@dataclass(frozen=True)
class Clock:
    """The column that times come from. frames: whether it counts frames; its factor is then the seconds of one."""

    column: Column
    frames: bool

    @property
    def header(self) -> str:
        """The column's name as written."""
        return self.column.header

    @property
    def factor(self) -> float:
        """Seconds in one of the column's unit."""
        return self.column.factor


@dataclass(frozen=True)
class Header:
    """The columns that are used, by quantity, without the clock's; and the names of those that are not."""

    line: int
    columns: Mapping[str, Column]
    clock: Clock
    unused: tuple[str, ...]


def read_header(header: Line, form: RecordingForm, *, upright: bool) -> Header:
    """Return the columns that a header names; raises ValueError where they do not determine a motion.

    upright: whether it is known that z is up. Where it is not, columns x and y without a z have to be stated.
    """
    line, listed = header.number, short(", ".join(header.cells))
    cells = renamed(line, header.cells, form.columns)
    columns, unused = name_columns(line, cells, Units.of(form.units))
    columns = {q: replace(c, header=header.cells[c.index]) for q, c in columns.items()}  # as messages name them
    if not columns:
        _refuse_nameless(header)
    clock = _choose_clock(line, columns, unused, form.seconds_per_frame, listed)
    turn = [c for c in TURN if c in columns]
    if turn and len(turn) < 4:
        raise ValueError(f"line {line}: an orientation needs all of {', '.join(TURN)}; there is only {', '.join(turn)}")
    if turn and YAW in columns:
        raise ValueError(f"line {line}: an orientation is {', '.join(TURN)} or {YAW}; leave out one of them")
    if (form.theta_described or form.theta_hanging is not None) and THETA not in columns:
        given = "theta_described" if form.theta_hanging is None else "theta_hanging"
        raise ValueError(f"line {line}: {given} is given, but column {THETA} is missing; columns: {listed}")
    _choose_places(line, columns, unused, form.pixels is not None)
    if not any(c in columns for c in MOTION):
        _refuse_motionless(line, unused, listed)
    stated = [quantity_of(meaning) for meaning in form.columns.values()]
    if not upright and {c for c in PLACE if c in columns} == {"x", "y"} and "y" not in stated:
        y = columns["y"].header
        raise ValueError(
            f"line {line}: columns {columns['x'].header} and {y} without z: state whether {y} is height, as "
            f"columns={{{y!r}: 'z'}}, or runs along the floor, as columns={{{y!r}: 'y'}}"
        )
    scaled = next((columns[c] for c in PLACE if c in columns and columns[c].factor != 1.0), None)
    if scaled is not None and SIGMA in columns and not columns[SIGMA].has_unit:
        own = columns[SIGMA].header
        raise ValueError(
            f"line {line}: column {own!r} states no unit, but {scaled.header!r} does; state it, as "
            f"columns={{{own!r}: 'sigma [mm]'}}"
        )
    unused.sort(key=lambda name: header.cells.index(name) if name in header.cells else len(header.cells))
    return Header(line, columns, clock, tuple(unused))


def check_units(header: Header, times: Sequence[Array], values: Sequence[Array]) -> None:
    """Raise ValueError for columns without a stated unit whose numbers are hardly seconds, metres or radians."""
    clock = header.clock
    steps = np.concatenate([np.diff(t) for t in times])
    if len(steps) and np.median(steps) > SLOWEST and not (clock.column.has_unit or clock.frames):
        raise ValueError(
            f"line {header.line}: column {clock.header!r} states no unit, and rows are {np.median(steps):.4g} apart in "
            f"it: state it, as columns={{{clock.header!r}: 't [ms]'}}, or 't [s]' if these are seconds"
        )
    for quantity, most, units in (*((p, FARTHEST, "mm m metres") for p in PLACE), (THETA, 0.0, "deg rad radians")):
        column = header.columns.get(quantity)
        if column is None or column.has_unit:
            continue
        found = np.concatenate([v[..., MEASURED.index(quantity)].ravel() for v in values])
        known = found[np.isfinite(found)]
        extent = float(np.ptp(known)) if len(known) else 0.0
        if extent > (most or 2.0 * np.pi * MOST_TURNS):
            likely, si, name = units.split()
            raise ValueError(
                f"line {header.line}: column {column.header!r} states no unit, and its numbers extend over "
                f"{extent:.4g}: state it, as columns={{{column.header!r}: '{quantity} [{likely}]'}}, or "
                f"'{quantity} [{si}]' if these are {name}"
            )


def without_units_row(table: Table) -> Table:
    """Return the table with the units of a line below the header, if there is one, written into the header."""
    units = [c.strip("[]() ") for c in table.rows[0].cells]
    known = [find_unit(u) is not None for u in units]
    foreign = any(u not in ("", "-") and not k for u, k in zip(units, known, strict=True))
    if foreign or not any(known) or len(table.rows) == 1:
        return table
    header = [f"{h} [{u}]" if k else h for h, u, k in zip(table.header.cells, units, known, strict=False)]
    return Table(replace(table.header, cells=header), table.rows[1:])


def _refuse_nameless(header: Line) -> None:
    """Raise ValueError for a header of which nothing is known; nor is it shown: the file may be no table at all."""
    names = ", ".join((*LABELS, "t", *PLACE, *TURN, *SPIN, THETA, *PIXELS))
    why = "it holds numbers" if all(map(has_number, header.cells)) else "the first line that is no comment names them"
    raise ValueError(
        f"line {header.number} has none of the columns {names}: {why}; state what they are by their places, as "
        "columns={'1': 't [s]', '2': 'x [m]', ...}"
    )


def _refuse_motionless(line: int, unused: list[str], listed: str) -> None:
    plain = {name: re.sub(r"\W+", "_", name.partition("(")[0].strip().lower()).strip("_") for name in unused}
    felt = [name for name, text in plain.items() if _ACCELERATION.search(text)]
    if felt:
        raise ValueError(
            f"line {line}: {short(', '.join(felt))} are readings of an accelerometer, in axes that turn with it and "
            "with gravity in them: they give no places. Track the body in a video, or log its position"
        )
    along = next((name for name, text in plain.items() if text in _ALONG_NOTHING), None)
    if along is not None:
        raise ValueError(
            f"line {line}: column {along!r} does not state its axis: state it, as columns={{{along!r}: 'x [m]'}}, or "
            "'z [m]' for a height"
        )
    raise ValueError(f"line {line}: nothing measured; expected some of {', '.join(MOTION)}; columns: {listed}")


def _choose_clock(
    line: int, columns: dict[str, Column], unused: list[str], seconds_per_frame: float | None, listed: str
) -> Clock:
    """Return the column that gives the times, of t and frame; t is taken out of the columns."""
    frame, time = columns.get(FRAME), columns.pop("t", None)
    if seconds_per_frame is not None and frame is None:
        raise ValueError(
            f"line {line}: seconds_per_frame (or fps) is given, but column frame is missing; columns: {listed}"
        )
    if seconds_per_frame is not None and frame is not None:
        unused += [time.header] if time is not None else []
        return Clock(replace(frame, factor=seconds_per_frame), frames=True)
    if time is None:
        cure = "" if frame is None else "; for frame numbers give seconds_per_frame (or fps)"
        raise ValueError(f"line {line}: column t (time in seconds) is missing; columns: {listed}{cure}")
    return Clock(time, frames=False)


def _choose_places(line: int, columns: dict[str, Column], unused: list[str], scaled: bool) -> None:
    """Leave either positions or pixels in the columns; scaled: whether the scale of pixels is given."""
    pixels, places = [c for c in PIXELS if c in columns], [c for c in PLACE if c in columns]
    if scaled and not pixels and places and set(places) <= {"x", "y"}:
        for pixel, place in zip(PIXELS, ("x", "y"), strict=True):
            if place not in columns:
                continue
            if columns[place].has_unit:
                raise ValueError(
                    f"line {line}: column {columns[place].header!r} states a unit of length; pixels_per_metre is for "
                    "columns in pixels"
                )
            columns[pixel] = columns.pop(place)
    elif scaled and (places or not pixels):
        have = ", ".join(columns[c].header for c in (*places, *pixels)) or "neither"
        raise ValueError(f"line {line}: pixels_per_metre is for columns u, v (or x_px, y_px) alone; there are {have}")
    elif pixels and not scaled:
        if not any(c in columns for c in (*PLACE, *TURN, *SPIN, THETA)):
            both = " and ".join(columns[c].header for c in pixels)
            axes = {"u": "x [0.002 m]", "v": "z [-0.002 m]"}
            meant = ", ".join(f"{columns[c].header!r}: {axes[c]!r}" for c in pixels)
            raise ValueError(
                f"line {line}: columns {both} are pixels: state the length of one, as columns={{{meant}}} (negative "
                "where they count downwards), or give pixels_per_metre"
            )
        unused += [columns.pop(c).header for c in pixels]
