"""Tracks made by other programs: CSV, JSON, npz, and CLEVRER annotation files."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.perception.import_files import ImportDataError, existing_table, read_arrays, read_json, read_measured_table
from atw_mcp.perception.naming import unique
from polyworld.data.tracks import ObservedTracks
from polyworld.world.description import Appearance

Floats = NDArray[np.float64]


DEFAULT_SIGMA = 0.01  # m; stated in the result's tracks where a file gives no accuracy
CLEVRER_SECONDS_PER_FRAME = 0.028  # displacement per frame over annotated velocity
CLEVRER_SIGMA = 0.001  # m; annotations are rounded to 1e-4
_NUMBERS = ("frame", "t", "x", "y", "z", "qw", "qx", "qy", "qz", "yaw", "confidence", "sigma")
_FORMATS = ".csv (columns frame or t, object, x, y[, z, qw, qx, qy, qz, yaw, confidence, sigma]), .json, .npz"


def import_tracks(
    path: str | Path, *, seconds_per_frame: float | None = None, position_sigma: float | None = None
) -> ObservedTracks:
    """Tracks of objects in the world [m] from a file.

    CSV: columns frame (whole number) or t [s], object, x, y, and optionally z, a quaternion qw, qx, qy, qz or
    yaw [rad], confidence, sigma [m]. JSON: what `ObservedTracks.to_dict` gives, or a CLEVRER annotation. npz:
    arrays names, positions (T, n, 3) and optionally frames, orientations, confidence, position_sigma.
    seconds_per_frame is needed where the file has frames but no times (CLEVRER: 0.028). position_sigma [m] is
    used where the file gives none (default 0.01). Units are never guessed: convert to metres and seconds
    before. Raises ImportDataError.
    """
    file = existing_table(path)
    suffix = file.suffix.lower()
    if suffix == ".csv":
        return _from_csv(file, seconds_per_frame, position_sigma)
    if suffix == ".npz":
        return _from_npz(file, seconds_per_frame, position_sigma)
    if suffix == ".json":
        data = read_json(file)
        if isinstance(data, dict) and {"object_property", "motion_trajectory"} <= data.keys():
            return clevrer_tracks(data, file.name)
        if isinstance(data, dict) and {"names", "frames", "positions"} <= data.keys():
            return _from_dict(data, file, seconds_per_frame)
        raise ImportDataError(
            f"{file.name}: neither tracks (names, frames, positions, ...) nor a CLEVRER annotation "
            f"(object_property, motion_trajectory)"
        )
    raise ImportDataError(f"{file.name}: unknown kind {suffix or 'without suffix'}; tracks come as {_FORMATS}")


def clevrer_tracks(data: dict[str, Any], source: str = "annotation") -> ObservedTracks:
    """Tracks of a CLEVRER annotation; objects are named colour_material_shape, made unique.

    Positions are those of the centres; objects out of view have confidence 0.5, since the simulator went on
    without the camera. The dataset's cylinders have their axis along body y: it is turned to body z here.
    """
    properties, motion = data["object_property"], data["motion_trajectory"]
    try:
        ids = [int(p["object_id"]) for p in properties]
        plain = ["_".join((p["color"], p["material"], p["shape"])) for p in properties]
        shapes = [str(p["shape"]) for p in properties]
        frames = np.array([int(f["frame_id"]) for f in motion], dtype=np.int64)
        n, count = len(ids), len(frames)
        positions, angles = np.full((count, n, 3), np.nan), np.full((count, n, 3), np.nan)
        seen = np.zeros((count, n), dtype=bool)
        for t, entry in enumerate(motion):
            for record in entry["objects"]:
                k = ids.index(int(record["object_id"]))
                positions[t, k], angles[t, k] = record["location"], record["orientation"]
                seen[t, k] = bool(record["inside_camera_view"])
    except (KeyError, TypeError, ValueError) as error:
        raise ImportDataError(f"{source}: not a complete CLEVRER annotation: {error!r}") from error
    known = np.isfinite(positions).all(axis=2)
    orientations = np.full((count, n, 4), np.nan)
    for k in range(n):
        rows = known[:, k] & np.isfinite(angles[:, k]).all(axis=1)
        turned = Rotation.from_euler("xyz", angles[rows, k])
        if shapes[k] == "cylinder":
            turned = turned * Rotation.from_euler("x", -np.pi / 2)
        orientations[rows, k] = continuous(turned.as_quat()[:, [3, 0, 1, 2]])
    confidence = np.where(known, np.where(seen, 1.0, 0.5), 0.0)
    return ObservedTracks(
        names=tuple(unique(plain)),
        frames=frames,
        seconds_per_frame=CLEVRER_SECONDS_PER_FRAME,
        positions=positions,
        position_sigma=np.where(known, CLEVRER_SIGMA, np.nan),
        orientations=orientations,
        confidence=confidence,
        orientation_confidence=np.where(np.isfinite(orientations).all(axis=2), confidence, 0.0),
        symmetry=tuple(4 if s == "cube" else 0 for s in shapes),
    )


def clevrer_appearances(path: str | Path) -> dict[str, tuple[Appearance, str]]:
    """Colour and material, and shape (sphere, cube, cylinder), of a CLEVRER annotation's objects by track name."""
    data = read_json(existing_table(path))
    if not isinstance(data, dict) or "object_property" not in data:
        raise ImportDataError(f"{Path(path).name}: not a CLEVRER annotation: no object_property")
    properties = data["object_property"]
    names = unique(["_".join((p["color"], p["material"], p["shape"])) for p in properties])
    return {
        n: (Appearance(color=p["color"], material=p["material"]), str(p["shape"]))
        for n, p in zip(names, properties, strict=True)
    }


def continuous(quaternions: Floats) -> Floats:
    """Quaternions (T, 4) with signs chosen so that neighbours are close."""
    result = quaternions.copy()
    for t in range(1, len(result)):
        if result[t] @ result[t - 1] < 0:
            result[t] = -result[t]
    return result


# --- formats -----------------------------------------------------------------------------------------


def _from_csv(file: Path, seconds_per_frame: float | None, position_sigma: float | None) -> ObservedTracks:
    table = read_measured_table(file, ("object", "x", "y"))
    columns = list(table.columns)
    quaternion = [c for c in ("qw", "qx", "qy", "qz") if c in columns]
    if quaternion and len(quaternion) < 4:
        raise ImportDataError(f"{file.name}: a quaternion needs qw, qx, qy, qz; it has only {quaternion}")
    if quaternion and "yaw" in columns:
        raise ImportDataError(f"{file.name}: give a quaternion or yaw, not both")
    by_object: dict[str, list[dict[str, float]]] = defaultdict(list)
    for row in table.rows:
        name = table.text(row, "object")
        if not name:
            raise ImportDataError(f"{file.name}: line {row.number}: the object has no name")
        by_object[name].append({c: table.number(row, c) for c in columns if c in _NUMBERS})
    table.check()
    key = table.clock
    for name, records in by_object.items():
        moments = [r[key] for r in records]
        if not np.all(np.isfinite(moments)):
            raise ImportDataError(f"{file.name}: object {name!r}: a row without {key}")
        if np.any(np.diff(moments) <= 0):
            at = int(np.argmax(np.diff(moments) <= 0))
            raise ImportDataError(
                f"{file.name}: object {name!r}: {key} does not increase after {moments[at]:g} "
                f"(next is {moments[at + 1]:g})"
            )
    moments_all = np.unique([r[key] for records in by_object.values() for r in records])
    frames, step = time_base(file, columns, by_object, moments_all, seconds_per_frame)
    names = tuple(by_object)
    shape = (len(moments_all), len(names))
    positions, orientations = np.full((*shape, 3), np.nan), np.full((*shape, 4), np.nan)
    confidence, sigma = np.zeros(shape), np.full(shape, DEFAULT_SIGMA if position_sigma is None else position_sigma)
    for k, name in enumerate(names):
        for record in by_object[name]:
            t = int(np.searchsorted(moments_all, record[key]))
            place = np.array([record["x"], record["y"], record.get("z", 0.0)])
            if not np.all(np.isfinite(place)):
                continue  # an empty cell: not seen
            positions[t, k] = place
            confidence[t, k] = confidence_in(record.get("confidence", 1.0), file, name)
            if np.isfinite(record.get("sigma", np.nan)):
                sigma[t, k] = record["sigma"]
            if quaternion:
                orientations[t, k] = [record[c] for c in ("qw", "qx", "qy", "qz")]
            elif np.isfinite(record.get("yaw", np.nan)):
                orientations[t, k] = np.cos(record["yaw"] / 2), 0.0, 0.0, np.sin(record["yaw"] / 2)
    return _build(file, names, frames, step, positions, sigma, orientations, confidence)


def time_base(
    file: Path,
    columns: list[str],
    by_object: dict[str, list[dict[str, float]]],
    moments: Floats,
    seconds_per_frame: float | None,
) -> tuple[NDArray[np.int64], float]:
    """Frame numbers of the moments, and seconds per frame."""
    if "frame" in columns:
        if not np.allclose(moments, np.round(moments)):
            raise ImportDataError(f"{file.name}: frame must be whole numbers, got {moments[0]:g}, {moments[1]:g}, ...")
        frames = np.round(moments).astype(np.int64)
        step = seconds_per_frame
        if step is None and "t" in columns:
            pairs = np.array([(r["frame"], r["t"]) for records in by_object.values() for r in records])
            if np.ptp(pairs[:, 0]) > 0:
                step = float(np.polyfit(pairs[:, 0], pairs[:, 1], 1)[0])
        if step is None:
            raise ImportDataError(f"{file.name}: frames but no times: give seconds_per_frame (or a column t)")
        return frames, step
    if len(moments) == 1:
        return np.zeros(1, dtype=np.int64), seconds_per_frame or 1.0
    gaps = np.diff(moments)
    step = seconds_per_frame or float(np.median(gaps))
    number = (moments - 0.0) / step
    if np.abs(number - np.round(number)).max() > 0.25 or np.any(np.diff(np.round(number)) < 1):
        # Uneven sampling: count in steps fine enough to separate every two moments.
        step = float(gaps.min()) / 4
        number = moments / step
        if np.abs(number).max() > 1e9:
            raise ImportDataError(
                f"{file.name}: times {gaps.min():g} s apart cannot share a time base with {gaps.max():g} s"
            )
    return np.round(number).astype(np.int64), step


def _from_dict(data: dict[str, Any], file: Path, seconds_per_frame: float | None) -> ObservedTracks:
    wanted = [
        "names",
        "frames",
        "seconds_per_frame",
        "positions",
        "position_sigma",
        "orientations",
        "confidence",
        "orientation_confidence",
        "symmetry",
    ]
    record = dict(data)
    if seconds_per_frame is not None:
        record["seconds_per_frame"] = seconds_per_frame
    missing = [k for k in wanted if k not in record]
    if missing:
        raise ImportDataError(f"{file.name}: tracks without {missing}")
    try:
        return ObservedTracks.from_dict(record)
    except (ValueError, TypeError) as error:
        raise ImportDataError(f"{file.name}: {error}") from error


def _from_npz(file: Path, seconds_per_frame: float | None, position_sigma: float | None) -> ObservedTracks:
    arrays = read_arrays(file)
    if "positions" not in arrays:
        raise ImportDataError(f"{file.name}: no array positions (T, n, 3); it holds {sorted(arrays)}")
    positions = np.asarray(arrays["positions"], dtype=float)
    if positions.ndim == 2 and positions.shape[1] in (2, 3):
        positions = positions[:, None, :]
    if positions.ndim != 3 or positions.shape[2] not in (2, 3):
        raise ImportDataError(f"{file.name}: positions must have shape (T, n, 3) or (T, n, 2), got {positions.shape}")
    if positions.shape[2] == 2:
        positions = np.concatenate([positions, np.zeros_like(positions[..., :1])], axis=2)
    count, n = positions.shape[:2]
    names = tuple(str(s) for s in arrays["names"]) if "names" in arrays else tuple(f"object_{k + 1}" for k in range(n))
    if len(names) != n:
        raise ImportDataError(f"{file.name}: {len(names)} names for {n} objects")
    step = seconds_per_frame
    if step is None and "seconds_per_frame" in arrays:
        step = float(arrays["seconds_per_frame"])
    if step is None:
        raise ImportDataError(f"{file.name}: no seconds_per_frame in it: give one")
    frames = np.asarray(arrays.get("frames", np.arange(count))).astype(np.int64)
    known = np.isfinite(positions).all(axis=2)

    def series(key: str, shape: tuple[int, ...], default: Floats) -> Floats:
        values = np.asarray(arrays.get(key, default), dtype=float)
        if values.shape != shape:
            raise ImportDataError(f"{file.name}: {key} must have shape {shape}, got {values.shape}")
        return values

    sigma = DEFAULT_SIGMA if position_sigma is None else position_sigma
    return _build(
        file,
        names,
        frames,
        step,
        positions,
        series("position_sigma", (count, n), np.full((count, n), sigma)),
        series("orientations", (count, n, 4), np.full((count, n, 4), np.nan)),
        np.where(known, series("confidence", (count, n), np.ones((count, n))), 0.0),
    )


def _build(
    file: Path,
    names: tuple[str, ...],
    frames: NDArray[np.int64],
    seconds_per_frame: float,
    positions: Floats,
    sigma: Floats,
    orientations: Floats,
    confidence: Floats,
) -> ObservedTracks:
    length = np.linalg.norm(orientations, axis=2)
    turned = np.isfinite(length)
    if np.any(np.abs(length[turned] - 1) > 0.05):
        raise ImportDataError(f"{file.name}: quaternions must have length 1, found {length[turned].min():.3g}")
    orientations = orientations / np.where(turned, length, 1.0)[..., None]
    try:
        return ObservedTracks(
            names=names,
            frames=frames,
            seconds_per_frame=seconds_per_frame,
            positions=positions,
            position_sigma=np.where(confidence > 0, sigma, np.nan),
            orientations=orientations,
            confidence=confidence,
            orientation_confidence=np.where(turned, confidence, 0.0),
            symmetry=tuple(1 if turned[:, k].any() else 0 for k in range(len(names))),
        )
    except ValueError as error:
        raise ImportDataError(f"{file.name}: {error}") from error


def confidence_in(value: float, file: Path, name: str) -> float:
    """Return a confidence in 0..1, 1 where a cell is empty; raises ImportDataError."""
    if not np.isfinite(value):
        return 1.0
    if not 0 <= value <= 1:
        raise ImportDataError(f"{file.name}: object {name!r}: confidence must lie in 0..1, got {value:g}")
    return value
