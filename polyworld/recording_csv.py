"""Measured motion in and out of CSV files: a row for every run, object and instant."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polyworld.recording import Recording, Run

Array = NDArray[np.float64]

PLACE = ("x", "y", "z")
TURN = ("qw", "qx", "qy", "qz")
COLUMNS = ("run", "object", "t", *PLACE, *TURN)
ONE_RUN = "run"  # name of the only run of a file without such a column

_MISSING = frozenset({"", "nan", "na", "null", "none", "-"})
_SAME_INSTANT = 1e-9  # [s]
_LONGEST_FIELD = 200


@dataclass(frozen=True)
class _Row:
    line: int
    time: float
    place: tuple[float, ...]
    turn: tuple[float, ...]


def read_recording(path: Path, objects: Sequence[str] = ()) -> Recording:
    """The recording in a CSV file; see `parse_recording`. Raises ValueError naming file and line."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path.name}: not a text file in UTF-8 (byte {error.start})") from error
    try:
        return parse_recording(text, objects)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error


def parse_recording(text: str, objects: Sequence[str] = ()) -> Recording:
    """The recording that CSV text holds.

    Columns, in any order: run, object, t [s], any of x, y, z [m], and all of qw, qx, qy, qz or none; other columns are
    ignored with a warning. Cells are separated by commas; an empty cell, or nan, was not measured; lines that begin
    with # are comments. Rows may come in any order. Every run has its own times and so may every object in it. Without
    a column `run` there is one run, without a column `object` the only one of `objects` (names of the world's). Runs
    and objects keep the order in which they first appear. Quaternions are normalised. What a CSV does not tell (noise,
    symmetry, lead) is left as `Run` has it. Raises ValueError that names the line and what was expected.
    """
    lines = _lines(text)
    header_line, header = next(lines, (0, []))
    if not header_line:
        raise ValueError(f"no rows; expected a header line with some of the columns {', '.join(COLUMNS)}")
    where = _columns(header_line, header)
    default = _default_object(where, objects)
    rows: dict[str, dict[str, list[_Row]]] = {}
    for line, cells in lines:
        if len(cells) != len(header):
            raise ValueError(f"line {line}: {len(cells)} cells, expected {len(header)} as in the header")
        run = _label(line, cells, where, "run", ONE_RUN)
        name = _label(line, cells, where, "object", default)
        rows.setdefault(run, {}).setdefault(name, []).append(_row(line, cells, where))
    if not rows:
        raise ValueError(f"line {header_line} is a header, but no rows of data follow it")
    return Recording(tuple(_run(name, content) for name, content in rows.items()))


def recording_to_csv(recording: Recording) -> str:
    """The recording as CSV text that `parse_recording` reads back exactly.

    Rows in which nothing was measured are left out, and so are sigma, symmetry and lead, which the format has not.
    """
    turned = any(np.isfinite(run.orientations).any() for run in recording.runs)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS if turned else COLUMNS[:6])
    for run in recording.runs:
        for column, name in enumerate(run.names):
            for row, time in enumerate(run.times):
                place, turn = run.positions[row, column], run.orientations[row, column]
                whole = bool(np.all(np.isfinite(turn)))
                if not (np.isfinite(place).any() or whole):
                    continue
                cells = [_text(v) for v in place]
                if turned:
                    cells += [_text(v) if whole else "" for v in turn]
                writer.writerow([run.name, name, repr(float(time)), *cells])
    return out.getvalue()


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line that is neither empty nor a comment."""
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            cells = next(csv.reader([line], strict=True))
        except csv.Error as error:
            raise ValueError(f"line {number}: {error}") from error
        yield number, [c.strip() for c in cells]


def _columns(line: int, header: list[str]) -> dict[str, int]:
    names = [h.lower() for h in header]
    repeated = sorted({n for n in names if n and names.count(n) > 1})
    if repeated:
        raise ValueError(f"line {line}: columns repeat: {', '.join(repeated)}")
    where = {name: i for i, name in enumerate(names) if name in COLUMNS}
    if not where and len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise ValueError(f"line {line}: cells must be separated by commas")
    if not where:
        raise ValueError(f"line {line} has none of the columns {', '.join(COLUMNS)}: {_short(', '.join(header))}")
    if "t" not in where:
        raise ValueError(f"line {line}: column t (time in seconds) is missing; columns: {_short(', '.join(header))}")
    turn = [c for c in TURN if c in where]
    if turn and len(turn) < 4:
        raise ValueError(f"line {line}: an orientation needs all of {', '.join(TURN)}; there is only {', '.join(turn)}")
    if not turn and not any(c in where for c in PLACE):
        raise ValueError(f"line {line}: nothing measured; expected some of {', '.join(PLACE + TURN)}")
    ignored = [h for h, n in zip(header, names, strict=True) if n not in COLUMNS]
    if ignored:
        warnings.warn(f"columns not used: {', '.join(ignored)}; known are {', '.join(COLUMNS)}", stacklevel=3)
    return where


def _default_object(where: dict[str, int], objects: Sequence[str]) -> str:
    if "object" in where:
        return ""
    if len(objects) != 1:
        told = f"the world has {len(objects)}: {', '.join(objects)}" if objects else "no world tells which it is"
        raise ValueError(f"column object is missing, and there is not just one object that it could be: {told}")
    return objects[0]


def _label(line: int, cells: list[str], where: dict[str, int], column: str, default: str) -> str:
    if column not in where:
        return default
    label = cells[where[column]]
    if not label:
        raise ValueError(f"line {line}: {column} is empty")
    return label


def _row(line: int, cells: list[str], where: dict[str, int]) -> _Row:
    time = _number(line, "t", cells[where["t"]])
    if not np.isfinite(time):
        raise ValueError(f"line {line}: t is empty; every row needs its time in seconds")
    place = tuple(_number(line, c, cells[where[c]]) if c in where else np.nan for c in PLACE)
    turn = tuple(_number(line, c, cells[where[c]]) if c in where else np.nan for c in TURN)
    known = [c for c, v in zip(TURN, turn, strict=True) if np.isfinite(v)]
    if known and len(known) < 4:
        raise ValueError(f"line {line}: an orientation needs all of {', '.join(TURN)}; measured are {', '.join(known)}")
    if known:
        size = float(np.linalg.norm(turn))
        if not 0.9 < size < 1.1:
            raise ValueError(f"line {line}: the quaternion {turn} has norm {size:.4g}, expected 1")
        # A norm that is right but for rounding stays, so that what is written is read back exactly.
        turn = turn if abs(size - 1.0) < 1e-12 else tuple(v / size for v in turn)
    return _Row(line, time, place, turn)


def _number(line: int, column: str, text: str) -> float:
    if text.lower() in _MISSING:
        return float("nan")
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"line {line}: {column} is not a number: {_short(text)!r}") from None
    if not np.isfinite(value):
        raise ValueError(f"line {line}: {column} is not finite: {_short(text)!r}")
    return value


def _run(name: str, content: dict[str, list[_Row]]) -> Run:
    times = np.unique([r.time for rows in content.values() for r in rows])
    times = times[np.concatenate([[True], np.diff(times) > _SAME_INSTANT])]
    positions = np.full((len(times), len(content), 3), np.nan)
    orientations = np.full((len(times), len(content), 4), np.nan)
    for column, (item, rows) in enumerate(content.items()):
        taken: dict[int, int] = {}
        for row in rows:
            at = int(np.searchsorted(times, row.time + _SAME_INSTANT, side="right")) - 1
            if at in taken:
                raise ValueError(
                    f"line {row.line}: run {name!r} has object {item!r} at t = {row.time!r} in line {taken[at]} already"
                )
            taken[at] = row.line
            positions[at, column], orientations[at, column] = row.place, row.turn
    return Run(name, tuple(content), times, positions, orientations)


def _text(value: float) -> str:
    return repr(float(value)) if np.isfinite(value) else ""


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_FIELD else text[:_LONGEST_FIELD] + "..."
