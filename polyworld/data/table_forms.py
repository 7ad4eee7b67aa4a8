"""Tables as trackers and loggers write them, rewritten with one header line and a row an object or run and instant."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from polyworld.data.recording_columns import quantity_of
from polyworld.world.units import find_unit

_LABELLED = (  # a header that names a series beside its quantity, as `NAME` or `RUN`: Logger Pro, PASCO Capstone
    re.compile(r"(?P<label>[^:]+):\s+(?P<name>\S.*)"),
    re.compile(r"(?P<name>\S.*?)\s+(?P<label>Run\s*#?\s*\d+)"),
)
_TRACKMATE = {"POSITION_X": "x", "POSITION_Y": "y", "POSITION_Z": "z", "POSITION_T": "t", "FRAME": "frame"}


@dataclass(frozen=True)
class Line:
    """A line of the table. number: in the file, from 1."""

    number: int
    cells: list[str]


@dataclass(frozen=True)
class Table:
    """A header and the rows below it; rows of empty cells alone are left out."""

    header: Line
    rows: tuple[Line, ...]


def has_number(cell: str) -> bool:
    """Return whether a cell holds a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def plain_form(lines: Sequence[Line]) -> Table:
    """Return the table in lines of which the first is a header or belongs to one.

    Known are: DeepLabCut (rows scorer, bodyparts, coords), TrackMate (rows of labels and units below POSITION_X),
    trackpy (particle, in pixels), Tracker (a line of names of masses above t, x, y), Logger Pro (`Latest: X (m)`) and
    PASCO Capstone (`Position (m) Run #1`). Series side by side become rows with a column object or run.
    """
    header = lines[0].cells
    if header[0].lower() == "scorer":
        return _deeplabcut(lines)
    if "POSITION_X" in header:
        return _trackmate(lines)
    if "particle" in header and "frame" in header:
        return _trackpy(lines)
    if len(lines) > 1 and _names_masses(header, lines[1].cells):
        return _tracker(lines)
    return _labelled(Table(lines[0], tuple(lines[1:])))


def _deeplabcut(lines: Sequence[Line]) -> Table:
    names = [next((i for i, line in enumerate(lines) if line.cells[0].lower() == n), None)
             for n in ("individuals", "bodyparts", "coords")]  # fmt: skip
    if names[1] is None or names[2] is None:
        raise ValueError(f"line {lines[0].number}: a table of DeepLabCut needs the rows scorer, bodyparts and coords")
    coords, parts = lines[names[2]], lines[names[1]].cells
    whose = [""] * len(parts) if names[0] is None else lines[names[0]].cells
    groups = ["", *(_name(f"{a} {b}") for a, b in zip(whose[1:], parts[1:], strict=True))]
    plain = {"x": "x [px]", "y": "y [px]", "likelihood": "confidence"}
    header = Line(coords.number, ["frame", *(plain.get(c, c) for c in coords.cells[1:])])
    return _stacked(Table(header, tuple(lines[names[2] + 1 :])), groups, "object")


def _trackmate(lines: Sequence[Line]) -> Table:
    rows = list(lines[1:])
    units = [""] * len(lines[0].cells)
    while rows and not any(has_number(c) for c in rows[0].cells):
        units = [c.strip("()") if c.startswith("(") else "" for c in rows.pop(0).cells]
    header = [f"{_TRACKMATE.get(h, h)} [{u}]" if find_unit(u) is not None else _TRACKMATE.get(h, h)
              for h, u in zip(lines[0].cells, units, strict=False)]  # fmt: skip
    header = [f"{h} of the spot" if h in ("LABEL", "ID") else h for h in header]
    return _numbered(Table(Line(lines[0].number, header), tuple(rows)), "TRACK_ID", "track")


def _trackpy(lines: Sequence[Line]) -> Table:
    header = [f"{h} [px]" if h in ("x", "y", "z") else h for h in lines[0].cells]
    return _numbered(Table(Line(lines[0].number, header), tuple(lines[1:])), "particle", "particle")


def _numbered(table: Table, column: str, name: str) -> Table:
    """Call a column of numbers `object`, and what it numbers by a name before the number."""
    if column not in table.header.cells:
        return table
    at = table.header.cells.index(column)

    def called(cells: list[str], text: str) -> list[str]:
        return [*cells[:at], text, *cells[at + 1 :]]

    rows = [
        Line(r.number, called(r.cells, f"{name}_{r.cells[at]}")) if r.cells[at:] and r.cells[at] else r
        for r in table.rows
    ]
    return Table(Line(table.header.number, called(table.header.cells, "object")), tuple(rows))


def _names_masses(above: Sequence[str], header: Sequence[str]) -> bool:
    """Return whether a line names masses above a header of Tracker, whose lines are padded to one width."""
    filled = [c for c in above if c]
    if len(above) < 2 or not 0 < len(filled) < sum(bool(c) for c in header) or any(map(has_number, header)):
        return False
    return "t" in map(quantity_of, header) and not any(map(quantity_of, filled))


def _tracker(lines: Sequence[Line]) -> Table:
    header = list(lines[1].cells)
    while header and not header[-1]:
        header.pop()
    groups, name = [], ""
    for column, quantity in enumerate(header):
        name = lines[0].cells[column] if lines[0].cells[column : column + 1] not in ([], [""]) else name
        groups.append("" if quantity_of(quantity) in ("t", "frame") else _name(name))
    return _stacked(Table(Line(lines[1].number, header), tuple(lines[2:])), groups, "object")


def _labelled(table: Table) -> Table:
    """Return the series of a header of Logger Pro or PASCO Capstone as runs."""
    for form in _LABELLED:
        found = [form.fullmatch(h) for h in table.header.cells]
        if any(f is not None and quantity_of(f["name"]) == "t" for f in found):
            names = [h if f is None else f["name"] for h, f in zip(table.header.cells, found, strict=True)]
            groups = ["" if f is None else f["label"] for f in found]
            return _stacked(Table(Line(table.header.number, names), table.rows), groups, "run")
    return table


def _stacked(table: Table, groups: Sequence[str], label: str) -> Table:
    """Return series side by side as rows below one another; groups: of each column, "" for those common to all."""
    header = table.header.cells
    common = [i for i, g in enumerate(groups) if not g]
    names = list(dict.fromkeys(h for h, g in zip(header, groups, strict=False) if g))
    rows = []
    for group in dict.fromkeys(g for g in groups if g):
        own = {h: i for i, (h, g) in enumerate(zip(header, groups, strict=False)) if g == group}
        for row in table.rows:
            cells = [row.cells[own[n]] if n in own and own[n] < len(row.cells) else "" for n in names]
            if any(cells):
                rows.append(Line(row.number, [group, *(row.cells[i] for i in common if i < len(row.cells)), *cells]))
    return Table(Line(table.header.number, [label, *(header[i] for i in common), *names]), tuple(rows))


def _name(text: str) -> str:
    """Return a name as worlds have it: without blanks."""
    return re.sub(r"[^\w-]+", "_", text.strip())
