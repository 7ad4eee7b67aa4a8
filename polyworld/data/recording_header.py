"""The header of a table of measured motion: which columns are used, for which quantity, and by which clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from polyworld.data.pixel_scale import PixelScale
from polyworld.data.recording_columns import (
    LABELS,
    MEASURED,
    PIXELS,
    PLACE,
    SPIN,
    THETA,
    TURN,
    Column,
    Units,
    name_columns,
)
from polyworld.data.table import Line, Table, short
from polyworld.world.units import find_unit


@dataclass(frozen=True)
class RecordingForm:
    """Reading options of a table, for what its header does not state.

    units: of columns that state none, as `mm,ms` or `x=mm,t=ms`. seconds_per_frame [s]: times are taken from the column
    frame. pixels: the scale of columns u, v (or of x, y without a unit). theta_described [rad]: the reading of theta in
    the pose that the world describes; theta_hanging [rad]: instead of it, the reading where the body hangs.
    """

    units: str = ""
    seconds_per_frame: float | None = None
    pixels: PixelScale | None = None
    theta_described: float = 0.0
    theta_hanging: float | None = None


@dataclass(frozen=True)
class Clock:
    """The column that times come from. factor: seconds in one of its unit; frames: whether it counts frames."""

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


def read_header(header: Line, form: RecordingForm) -> Header:
    """Return the columns that a header names; raises ValueError where they do not determine a motion."""
    line, listed = header.number, short(", ".join(header.cells))
    columns, unused = name_columns(line, header.cells, Units.of(form.units))
    if not columns:
        names = ", ".join((*LABELS, "t", *PLACE, *TURN, *SPIN, THETA, *PIXELS))
        raise ValueError(
            f"line {line} has none of the columns {names}; the first line that does not begin with # must "
            "name the columns"
        )
    clock = _choose_clock(line, columns, unused, form.seconds_per_frame, listed)
    turn = [c for c in TURN if c in columns]
    if turn and len(turn) < 4:
        raise ValueError(f"line {line}: an orientation needs all of {', '.join(TURN)}; there is only {', '.join(turn)}")
    if (form.theta_described or form.theta_hanging is not None) and THETA not in columns:
        given = "theta_described" if form.theta_hanging is None else "theta_hanging"
        raise ValueError(f"line {line}: {given} is given, but column {THETA} is missing; columns: {listed}")
    _choose_places(line, columns, unused, form.pixels is not None)
    if not any(c in columns for c in MEASURED):
        raise ValueError(f"line {line}: nothing measured; expected some of {', '.join(MEASURED)}; columns: {listed}")
    unused.sort(key=lambda name: header.cells.index(name) if name in header.cells else len(header.cells))
    return Header(line, columns, clock, tuple(unused))


def without_units_row(table: Table) -> Table:
    """Return the table with the units of a line below the header, if there is one, written into the header."""
    units = [c.strip("[]() ") for c in table.rows[0].cells]
    known = [find_unit(u) is not None for u in units]
    foreign = any(u not in ("", "-") and not k for u, k in zip(units, known, strict=True))
    if foreign or not any(known) or len(table.rows) == 1:
        return table
    header = [f"{h} [{u}]" if k else h for h, u, k in zip(table.header.cells, units, known, strict=False)]
    return Table(replace(table.header, cells=header), table.rows[1:])


def _choose_clock(
    line: int, columns: dict[str, Column], unused: list[str], seconds_per_frame: float | None, listed: str
) -> Clock:
    """Take t and frame out of the columns and return the one that gives the times."""
    frame, time = columns.pop("frame", None), columns.pop("t", None)
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
    unused += [frame.header] if frame is not None else []
    return Clock(time, frames=False)


def _choose_places(line: int, columns: dict[str, Column], unused: list[str], scaled: bool) -> None:
    """Leave either positions or pixels in the columns; scaled: whether the scale of pixels is given."""
    pixels, places = [c for c in PIXELS if c in columns], [c for c in PLACE if c in columns]
    if scaled and not pixels and places == ["x", "y"]:
        for pixel, place in zip(PIXELS, places, strict=True):
            if columns[place].has_unit:
                raise ValueError(
                    f"line {line}: column {columns[place].header!r} states a unit of length; pixels_per_metre is for "
                    "columns in pixels"
                )
            columns[pixel] = columns.pop(place)
    elif scaled and (places or len(pixels) < 2):
        have = ", ".join(columns[c].header for c in (*places, *pixels)) or "neither"
        raise ValueError(
            f"line {line}: pixels_per_metre is for two columns u, v (or x_px, y_px) alone; there are {have}"
        )
    elif pixels and not scaled:
        if len(pixels) == 2 and not any(c in columns for c in (*PLACE, *TURN, *SPIN, THETA)):
            both = " and ".join(columns[c].header for c in pixels)
            raise ValueError(f"line {line}: columns {both} are pixels: give pixels_per_metre, their scale")
        unused += [columns.pop(c).header for c in pixels]
