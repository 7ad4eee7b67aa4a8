"""Measured motion in and out of CSV files: a row for every run, object and instant."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polyworld.data.hinge_angles import HingedBody
from polyworld.data.recording import Recording, Run
from polyworld.data.recording_columns import (
    CONFIDENCE,
    FRAME,
    LABELS,
    MEASURED,
    PIXELS,
    PLACE,
    SIGMA,
    SPIN,
    THETA,
    TURN,
    YAW,
    Column,
)
from polyworld.data.recording_header import Header, RecordingForm, check_units, read_header, without_units_row
from polyworld.data.recording_rows import Row, merge_rows
from polyworld.data.table import MISSING, Numbers, Problems, read_table
from polyworld.data.table_files import file_text, in_file
from polyworld.data.table_forms import Line
from polyworld.world import World
from polyworld.world.geometry import rotation_quaternion

Array = NDArray[np.float64]

ONE_RUN = "1"  # name of the only run of a file without such a column
LATEST = 1e5  # [s]; clocks beyond it count from a date and not from the experiment's start
_AT = {name: i for i, name in enumerate(MEASURED)}


_PLAIN = RecordingForm()


@dataclass(frozen=True)
class Reading:
    """All that a table holds. frames (T,), confidence (T, n) and sigma (T, n) [m] of each run, NaN where not stated."""

    recording: Recording
    frames: tuple[Array, ...]
    confidence: tuple[Array, ...]
    sigma: tuple[Array, ...]


def read_recording(
    path: str | Path, objects: Sequence[str] = (), *, form: RecordingForm = _PLAIN, world: World | None = None
) -> Recording:
    """Return the recording in a file; see `parse_recording`. Raises ValueError that names file and line."""
    path = Path(path)
    try:
        return parse_recording(file_text(path), objects, form=form, world=world)
    except ValueError as error:
        raise ValueError(in_file(path, error)) from error


def parse_recording(
    text: str, objects: Sequence[str] = (), *, form: RecordingForm = _PLAIN, world: World | None = None
) -> Recording:
    """Return the recording that the text of a table holds.

    Columns, in any order: run, object, t [s] or frame, any of x, y, z [m], all of qw, qx, qy, qz, or yaw [rad], or
    none, any of wx, wy, wz [rad/s], theta [rad] of a body on a hinge of `world`, or pixels u, v, and confidence (0
    where nothing was measured) and sigma [m]; other names and units as `name_columns` reads them, other layouts,
    separators and signs as `read_table` does. A line of units may follow the header. Rows may come in any order.
    Every run has its own times and so may every object in it. Without a column `run` there is one run, without a
    column `object` the only one of `objects` (default: the moving ones of `world`); names besides those of
    `objects`, where given, are errors. Runs and objects keep the order in which they first appear. Quaternions are
    normalised. What a table does not hold (noise, symmetry, lead) is left as `Run` has it. Raises ValueError with a
    sentence a kind of error, naming lines, column and cure.
    """
    return parse_reading(text, objects, form=form, world=world, frames=False).recording


def parse_reading(
    text: str,
    objects: Sequence[str] = (),
    *,
    form: RecordingForm = _PLAIN,
    world: World | None = None,
    default: str = "",
    frames: bool = True,
) -> Reading:
    """Return all that a table holds; see `parse_recording`.

    default: name of the object of a table without that column. frames: whether frame numbers beside times are of use.
    """
    table = without_units_row(read_table(text.removeprefix("\ufeff")))
    header = read_header(table.header, form, upright=world is not None)
    default = default or _default_object(header, objects or (() if world is None else world.moving_names))
    idle = [header.columns[FRAME].header] if FRAME in header.columns and not header.clock.frames and not frames else []
    if idle or header.unused:
        named = ", ".join((*idle, *header.unused))
        warnings.warn(f"columns not used: {named}", stacklevel=2)
    problems = Problems()
    rows = _rows(table.rows, header, default, problems)
    if objects:
        _check_objects(rows, header, objects)
    start = _clock_start(rows)
    runs = []
    for name, content in rows.items():
        times, values = merge_rows(name, content, header.clock, problems)
        runs.append((name, tuple(content), times - start, values))
    problems.check()
    check_units(header, [times for _, _, times, _ in runs], [values for *_, values in runs])
    columns = [[values[..., _AT[c]] for *_, values in runs] for c in (FRAME, CONFIDENCE, SIGMA)]
    recording = Recording(tuple(_run(*each, form, world, header) for each in runs))
    if len(table.rows) == 1:
        raise ValueError(f"line {table.rows[0].number} is the only row: motion needs rows of two instants or more")
    return Reading(
        recording,
        tuple(np.fmax.reduce(v, axis=1) for v in columns[0]),
        tuple(columns[1]),
        tuple(columns[2]),
    )


def _default_object(header: Header, objects: Sequence[str]) -> str:
    if "object" in header.columns:
        return ""
    if len(objects) != 1:
        known = f"the world has {len(objects)}: {', '.join(objects)}" if objects else "no world names it"
        raise ValueError(
            f"line {header.line}: column object is missing, and not just one object could be meant: {known}; "
            "add the column, with the object's name in every row, or build a world with the one object first"
        )
    return objects[0]


def _check_objects(rows: dict[str, dict[str, list[Row]]], header: Header, objects: Sequence[str]) -> None:
    """Raise ValueError for the first row of an object that is none of those known."""
    for content in rows.values():
        for name, own in content.items():
            if name.split("#", 1)[0] not in objects:
                like = next((o for o in objects if o.lower() == name.lower()), None)
                near = f" (did you mean {like!r}?)" if like else ""
                raise ValueError(
                    f"line {own[0].line}: {header.columns['object'].header} is {name!r}, but the world has only "
                    f"{', '.join(objects)}{near}; describe {name!r} in the world or leave its rows out"
                )


def _rows(lines: Sequence[Line], header: Header, default: str, problems: Problems) -> dict[str, dict[str, list[Row]]]:
    """Return the rows by run and object, in the order of the file; raises ValueError for those that are no rows."""
    numbers = Numbers(problems)
    found: dict[str, dict[str, list[Row]]] = {}
    for line in lines:
        run, name = (_label(line, header.columns, column, problems) for column in LABELS)
        row = _row(line, header, numbers, problems)
        if row is not None:
            found.setdefault(run or ONE_RUN, {}).setdefault(name or default, []).append(row)
    problems.check()
    numbers.check()
    return found


def _label(line: Line, columns: Mapping[str, Column], column: str, problems: Problems) -> str:
    if column not in columns:
        return ""
    label = line.cells[columns[column].index]
    if not label:
        problems.add(column, line.number, f"{columns[column].header} is empty", f"every row needs its {column}")
    return label


def _row(line: Line, header: Header, numbers: Numbers, problems: Problems) -> Row | None:
    """Return the row, None for one without a time; errors are noted."""
    clock = header.clock
    cell = line.cells[clock.column.index]
    stamp = numbers.read(line.number, clock.header, cell, "write times as numbers, in seconds or a stated unit")
    if cell.lower() in MISSING:
        cure = "every row needs its time" + ("" if clock.frames else " in seconds")
        problems.add("time", line.number, f"{clock.header} is empty", cure)
    values = np.full(len(MEASURED), np.nan)
    for i, quantity in enumerate(MEASURED):
        column = header.columns.get(quantity)
        if column is not None:
            values[i] = column.factor * numbers.read(line.number, column.header, line.cells[column.index])
    if not np.isfinite(stamp):
        return None
    for name in (CONFIDENCE, SIGMA, FRAME):
        problem = _unfit(name, values[_AT[name]])
        if problem:
            problems.add(name, line.number, f"{header.columns[name].header} {problem}, got {values[_AT[name]]:.6g}")
    turn = values[_AT[TURN[0]] : _AT[TURN[-1]] + 1]
    known = [c for c, v in zip(TURN, turn, strict=True) if np.isfinite(v)]
    size = float(np.linalg.norm(turn))
    if known and len(known) < 4:
        problems.add(
            "turn", line.number, f"an orientation needs all of {', '.join(TURN)}; measured are {', '.join(known)}"
        )
    elif known and not 0.9 < size < 1.1:
        shown = ", ".join(f"{v:.4g}" for v in turn)
        cure = "qw is the scalar part; leave the cells empty where the orientation is unknown"
        problems.add("norm", line.number, f"the quaternion ({shown}) has norm {size:.4g}, expected 1", cure)
    elif known and abs(size - 1.0) >= 1e-12:  # a norm that is right but for rounding is written back as it was
        turn /= size
    return Row(line.number, stamp, stamp * clock.factor, values)


def _unfit(quantity: str, value: float) -> str:
    """Return what a confidence, noise or frame number must be and is not; NaN is any of them."""
    if quantity == CONFIDENCE and not (np.isnan(value) or 0.0 <= value <= 1.0):
        return "must lie in 0..1"
    if quantity == SIGMA and value <= 0.0:
        return "must be above 0"
    return "must be a whole number" if quantity == FRAME and not (np.isnan(value) or value == round(value)) else ""


def _clock_start(rows: dict[str, dict[str, list[Row]]]) -> float:
    """Return what is taken off all times: nothing, or the first one where they count from a date."""
    times = [row.time for content in rows.values() for own in content.values() for row in own]
    if max(abs(t) for t in times) <= LATEST:
        return 0.0
    warnings.warn(f"times are counted from the first one, {min(times):.15g} s", stacklevel=3)
    return min(times)


def _run(
    name: str,
    names: tuple[str, ...],
    times: Array,
    values: Array,
    form: RecordingForm,
    world: World | None,
    header: Header,
) -> Run:
    seen = (values[..., _AT[CONFIDENCE]] != 0.0)[..., None]
    place, turn, spin = (np.where(seen, values[..., _AT[c[0]] : _AT[c[-1]] + 1], np.nan) for c in (PLACE, TURN, SPIN))
    yaw = np.where(seen, values[..., _AT[YAW], None], np.nan) * np.array([0.0, 0.0, 1.0])
    positions, orientations = place, np.where(np.isfinite(yaw[..., :1]), rotation_quaternion(np.nan_to_num(yaw)), turn)
    if form.pixels is not None:
        positions = form.pixels.positions(values[..., _AT[PIXELS[0]] : _AT[PIXELS[1]] + 1])
    arms = [np.nan] * len(names)
    for column, item in enumerate(names):
        angles = values[:, column, _AT[THETA]]
        if not np.isfinite(angles).any():
            continue
        if np.isfinite(positions[:, column]).any() or np.isfinite(orientations[:, column]).any():
            warnings.warn(
                f"{THETA} of object {item!r} is not used: it is for a body on a hinge of which nothing else was "
                "measured; an orientation is qw, qx, qy, qz",
                stacklevel=3,
            )
            continue
        where = f"line {header.line}: {header.columns[THETA].header} of object {item!r}"
        if world is None:
            raise ValueError(f"{where} needs a world with its hinge, or give positions x, y, z")
        try:
            body = HingedBody.of(world, item)
            zero = form.theta_described if form.theta_hanging is None else form.theta_hanging - body.hanging
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        positions[:, column], orientations[:, column] = body.measured(angles - zero)
        arms[column] = body.distance if body.off_axis else np.nan
    stated = values[..., _AT[SIGMA]]
    sigma = float(np.nanmedian(stated)) if np.isfinite(stated).any() else None
    return Run(name, names, times, positions, orientations, sigma, angular_velocities=spin, arms=tuple(arms))
