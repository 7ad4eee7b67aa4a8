"""Shapes measured by other programs: points of deformable objects over time, and scalar series, as CSV."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.import_files import ImportDataError, MeasuredTable, read_measured_table
from atw_mcp.perception.import_tracks import DEFAULT_SIGMA
from polyworld.data.shape_series import ShapeSeries
from polyworld.data.table_forms import Line
from polyworld.probing.readouts import Amount, Centreline, Curve, Front, Markers, Readout, Tension
from polyworld.probing.readouts.centreline import resampled

Floats = NDArray[np.float64]
PointsAre = Literal["markers", "centreline"]

QUANTITIES = {
    "amount": "in a container, given in a column container [m^3; planar m^2]",
    "height": "of the highest point [m]",
    "front_x, front_y, front_z": "coordinate below which a share lies, given in a column share (default 1) [m]",
    "tension": "of a rope [N]; at a share of its length, given in a column at (default: the largest)",
}
_UP = (0.0, 0.0, 1.0)
_FRONTS = {"front_x": (1.0, 0.0, 0.0), "front_y": (0.0, 1.0, 0.0), "front_z": _UP, "height": _UP}


@dataclass(frozen=True)
class ImportedShapes:
    """Series over frames (T,) at clock (T,) [frames], with what was left out and why."""

    frames: NDArray[np.int64]
    clock: Floats
    seconds_per_frame: float
    series: tuple[ShapeSeries, ...]
    left_out: tuple[str, ...]


def import_points(
    path: str | Path,
    *,
    points_are: PointsAre,
    columns: Mapping[str, str] = MappingProxyType({}),
    seconds_per_frame: float | None = None,
    position_sigma: float | None = None,
) -> ImportedShapes:
    """Points of deformable objects from a table: columns t or frame, object, point (a number or name), x, y, z and
    optionally confidence, sigma [m]; other headers by `columns`.

    markers: each point is a mark on the material, identified by its position in the first frame of the file; a
    mark not seen then is left out. centreline: an object's points are numbered along it, from end to end; in frames
    where one is missing the others are taken for a part of the curve. Raises ImportDataError.
    """
    table = read_measured_table(path, ("object", "point", "x", "y", "z"), ("confidence", "sigma"), columns)
    file, key = table.file, table.clock(seconds_per_frame)
    by_object: dict[str, dict[str, list[dict[str, float]]]] = defaultdict(lambda: defaultdict(list))
    keys = [k for k in (key, "x", "y", "z", "confidence", "sigma") if k in table.columns]
    for row in table.rows:
        name, point = table.text(row, "object"), table.text(row, "point")
        if not name or not point:
            raise ImportDataError(f"{file.name}: line {row.number}: the {'point' if name else 'object'} has no name")
        by_object[name][point].append({k: table.number(row, k) for k in keys})
    table.check()
    records = {f"{name}.{point}": r for name, points in by_object.items() for point, r in points.items()}
    frames, step, clock, moments = table.grid(_moments(file, records, key), seconds_per_frame)
    default = DEFAULT_SIGMA if position_sigma is None else position_sigma
    series: list[ShapeSeries] = []
    left_out: list[str] = []
    for name, points in by_object.items():
        order = sorted(points, key=_natural)
        shape = (len(frames), len(order))
        values, sigma, confidence = np.full((*shape, 3), np.nan), np.full(shape, default), np.zeros(shape)
        for k, point in enumerate(order):
            for record in points[point]:
                t = int(np.searchsorted(moments, record[key]))
                place = [record["x"], record["y"], record["z"]]
                if not np.all(np.isfinite(place)):
                    continue
                values[t, k] = place
                confidence[t, k] = confidence_in(record.get("confidence", 1.0), file, name)
                if np.isfinite(record.get("sigma", np.nan)):
                    sigma[t, k] = record["sigma"]
        if points_are == "markers":
            seen = confidence[0] > 0.0
            left_out += [f"{name}: mark {order[k]!r} is not seen in the first frame" for k in np.flatnonzero(~seen)]
            if seen.any():
                at = tuple((float(x), float(y), float(z)) for x, y, z in values[0, seen])
                series.append(
                    ShapeSeries(Markers(object=name, at=at), values[:, seen], sigma[:, seen], confidence[:, seen])
                )
        elif len(order) < 2:
            raise ImportDataError(f"{file.name}: object {name!r}: a centreline needs at least two points")
        else:
            series += _centrelines(name, values, sigma, confidence)
    return ImportedShapes(frames, clock, step, tuple(series), tuple(left_out))


def import_series(
    path: str | Path,
    *,
    columns: Mapping[str, str] = MappingProxyType({}),
    seconds_per_frame: float | None = None,
    sigma: float | None = None,
) -> ImportedShapes:
    """Scalar time series from a table: columns t or frame, object, quantity, value and optionally sigma, confidence,
    container, at, share; other headers by `columns`.

    quantity: `QUANTITIES`. sigma is the accuracy of values that state none, in their own unit. Raises ImportDataError,
    also where no accuracy is given: a fit weighs by it.
    """
    more = ("sigma", "confidence", "container", "at", "share")
    table = read_measured_table(path, ("object", "quantity", "value"), more, columns)
    file, key = table.file, table.clock(seconds_per_frame)
    found: dict[Readout, list[dict[str, float]]] = defaultdict(list)
    keys = [k for k in (key, "value", "sigma", "confidence") if k in table.columns]
    for row in table.rows:
        found[_quantity(table, row)].append({k: table.number(row, k) for k in keys})
    table.check()
    records = {f"{r.kind} of {r.object}": rows for r, rows in found.items()}
    if len(records) < len(found):
        records = {f"{i}. {r.kind} of {r.object}": rows for i, (r, rows) in enumerate(found.items())}
    frames, step, clock, moments = table.grid(_moments(file, records, key), seconds_per_frame)
    series = []
    for readout, entries in found.items():
        values, sigmas = np.full((len(frames), 1, 1), np.nan), np.full((len(frames), 1), np.nan)
        confidence = np.zeros((len(frames), 1))
        for record in entries:
            t = int(np.searchsorted(moments, record[key]))
            if not np.isfinite(record["value"]):
                continue
            own = record.get("sigma", np.nan)
            sigmas[t] = own if np.isfinite(own) else np.nan if sigma is None else sigma
            if not sigmas[t, 0] > 0.0:
                raise ImportDataError(
                    f"{file.name}: {readout.kind} of {readout.object!r}: no accuracy; give a column sigma above 0, or "
                    "value_sigma for all"
                )
            values[t], confidence[t] = (
                record["value"],
                confidence_in(record.get("confidence", 1.0), file, readout.object),
            )
        series.append(ShapeSeries(readout, values, sigmas, confidence))
    return ImportedShapes(frames, clock, step, tuple(series), ())


def _moments(file: Path, records: dict[str, list[dict[str, float]]], key: str) -> set[float]:
    for name, entries in records.items():
        moments = [r[key] for r in entries]
        if not np.all(np.isfinite(moments)):
            raise ImportDataError(f"{file.name}: {name}: a row without {key}")
        if np.any(np.diff(moments) <= 0):
            at = int(np.argmax(np.diff(moments) <= 0))
            raise ImportDataError(f"{file.name}: {name}: {key} does not increase after {moments[at]:g}")
    return {r[key] for entries in records.values() for r in entries}


def _natural(point: str) -> tuple[int, float, str]:
    """Numbers in their order, before names in theirs."""
    try:
        return 0, float(point), ""
    except ValueError:
        return 1, 0.0, point


def _centrelines(name: str, values: Floats, sigma: Floats, confidence: Floats) -> list[ShapeSeries]:
    whole = np.asarray(np.all(confidence > 0.0, axis=1))
    count = values.shape[1]
    made: list[ShapeSeries] = []
    if whole.any():
        even = np.full_like(values, np.nan)
        even[whole] = resampled(values[whole], count)  # points may have been marked at uneven distances
        kept = np.where(whole[:, None], confidence, 0.0)
        made.append(ShapeSeries(Centreline(object=name, count=count), even, sigma, kept))
    part = np.where(whole[:, None], 0.0, confidence)
    if (part > 0.0).any():
        made.append(ShapeSeries(Curve(object=name, count=count), values, sigma, part))
    return made


def _quantity(table: MeasuredTable, row: Line) -> Readout:
    where = f"{table.file.name}: line {row.number}"

    def text(column: str) -> str | None:
        return table.text(row, column) or None

    def share(column: str) -> float | None:
        value = table.number(row, column)
        if np.isfinite(value) and not 0.0 <= value <= 1.0:
            raise ImportDataError(f"{where}: {column} must lie in 0..1, got {value:g}")
        return value if np.isfinite(value) else None

    name, quantity = text("object"), text("quantity")
    if name is None:
        raise ImportDataError(f"{where}: the object has no name")
    if quantity == "amount":
        container = text("container")
        if container is None:
            raise ImportDataError(f"{where}: an amount needs a column container with its name")
        return Amount(object=name, container=container)
    if quantity in _FRONTS:
        most = share("share")
        return Front(object=name, direction=_FRONTS[quantity], share=1.0 if most is None else most)
    if quantity == "tension":
        return Tension(object=name, at=share("at"))
    choices = "; ".join(f"{k}: {v}" for k, v in QUANTITIES.items())
    raise ImportDataError(f"{where}: unknown quantity {quantity!r}; quantities: {choices}")


def confidence_in(value: float, file: Path, name: str) -> float:
    """Return a confidence in 0..1, 1 where a cell is empty; raises ImportDataError."""
    if not np.isfinite(value):
        return 1.0
    if not 0 <= value <= 1:
        raise ImportDataError(f"{file.name}: object {name!r}: confidence must lie in 0..1, got {value:g}")
    return value
