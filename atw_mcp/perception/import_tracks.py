"""Tracks made by other programs: tables, JSON, and CLEVRER annotation files."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.perception.import_files import ImportDataError, existing_table, read_json
from atw_mcp.perception.naming import unique
from polyworld.data.recording_csv import parse_reading
from polyworld.data.recording_header import RecordingForm
from polyworld.data.table_files import file_text, in_file
from polyworld.data.tracks import ObservedTracks, continuous, frame_grid
from polyworld.world.description import Appearance

Floats = NDArray[np.float64]


DEFAULT_SIGMA = 0.01  # m; of positions in a file that gives no accuracy
CLEVRER_SECONDS_PER_FRAME = 0.028  # displacement per frame over annotated velocity
UNUSUAL = 20.0  # m; places that extend farther are stated: most that is filmed or tracked lies within a room
_PLAIN = RecordingForm()
CLEVRER_SIGMA = 0.001  # m; annotations are rounded to 1e-4


@dataclass(frozen=True)
class ImportedTracks:
    """Tracks of a file. remarks: what was not used or not measured; unmeasured: axes without a measured place."""

    tracks: ObservedTracks
    remarks: tuple[str, ...] = ()
    unmeasured: str = ""


def import_tracks(
    path: str | Path, form: RecordingForm = _PLAIN, *, position_sigma: float | None = None
) -> ImportedTracks:
    """Tracks of objects in the world [m] from a file.

    A table as `parse_reading` reads it, of one run, with measured times or frames and the form's seconds_per_frame;
    JSON: what `ObservedTracks.to_dict` gives, or a CLEVRER annotation. Axes along which nothing was measured are 0.
    position_sigma [m] is used where the file gives none (default 0.01). Raises ImportDataError.
    """
    file = existing_table(path)
    if file.suffix.lower() != ".json":
        return _from_table(file, form, DEFAULT_SIGMA if position_sigma is None else position_sigma)
    data = read_json(file)
    if isinstance(data, dict) and {"object_property", "motion_trajectory"} <= data.keys():
        return ImportedTracks(clevrer_tracks(data, file.name))
    if isinstance(data, dict) and {"names", "frames", "positions"} <= data.keys():
        return ImportedTracks(_from_dict(data, file, form.seconds_per_frame))
    raise ImportDataError(
        f"{file.name}: neither tracks (names, frames, positions, ...) nor a CLEVRER annotation "
        f"(object_property, motion_trajectory)"
    )


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


# --- formats -----------------------------------------------------------------------------------------


def _from_table(file: Path, form: RecordingForm, position_sigma: float) -> ImportedTracks:
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            reading = parse_reading(file_text(file), form=form, default="object")
    except ValueError as error:
        raise ImportDataError(in_file(file, error)) from error
    remarks = list(dict.fromkeys(str(w.message) for w in caught))
    if len(reading.recording.runs) > 1:
        names = ", ".join(r.name for r in reading.recording.runs)
        raise ImportDataError(f"{file.name}: tracks are of one run, the table has {names}: it is a kind='recording'")
    run, numbers, sigma = reading.recording.runs[0], reading.frames[0], reading.sigma[0]
    known: NDArray[np.bool_] = np.isfinite(run.positions)
    measured: NDArray[np.bool_] = np.any(known, axis=(0, 1))
    if not measured.any():
        raise ImportDataError(f"{file.name}: tracks need places x, y, z; it holds none: it is a kind='recording'")
    unmeasured = "".join(axis for axis, any_ in zip("xyz", measured, strict=True) if not any_)
    if unmeasured:
        remarks.append(f"not measured and taken as 0: {', '.join(unmeasured)}")
    found = run.positions[..., measured]
    extent = float((np.nanmax(found, axis=(0, 1)) - np.nanmin(found, axis=(0, 1))).max())
    if extent > UNUSUAL:
        cure = "where they are in millimetres, state it, as columns={'x': 'x [mm]'}"
        remarks.append(f"places extend over {extent:.4g} m; {cure}")
    seen = np.all(known | ~measured, axis=2)
    times = run.times
    if times[0] < 0.0:
        remarks.append(f"times are counted from the first one, {times[0]:.15g} s")
        times = times - times[0]
    frames, step, clock = _frames(times, numbers, form.seconds_per_frame)
    turned: NDArray[np.bool_] = np.all(np.isfinite(run.orientations), axis=2)
    confidence = reading.confidence[0]
    confidence = np.where(seen, np.where(np.isfinite(confidence), confidence, 1.0), 0.0)
    tracks = ObservedTracks(
        names=run.names,
        frames=frames,
        seconds_per_frame=step,
        positions=np.where(seen[..., None], np.nan_to_num(run.positions), np.nan),
        position_sigma=np.where(confidence > 0, np.where(np.isfinite(sigma), sigma, position_sigma), np.nan),
        orientations=np.stack([continuous(q) for q in run.orientations.swapaxes(0, 1)], axis=1),
        confidence=confidence,
        orientation_confidence=np.where(turned, confidence, 0.0),
        symmetry=tuple(1 if turned[:, k].any() else 0 for k in range(len(run.names))),
        clock=clock,
    )
    return ImportedTracks(tracks, tuple(remarks), unmeasured)


def _frames(
    times: Floats, numbers: Floats, seconds_per_frame: float | None
) -> tuple[NDArray[np.int64], float, Floats | None]:
    """Return frame numbers, seconds per frame, and the clock of times that are not at their frames."""
    labelled = bool(np.isfinite(numbers).all() and np.all(np.diff(numbers) > 0) and numbers[0] >= 0)
    if seconds_per_frame is not None:
        return numbers.astype(np.int64), seconds_per_frame, None
    frames, step, clock = frame_grid(times)
    if labelled and len(times) > 1:
        frames, step = numbers.astype(np.int64), float(np.ptp(times) / np.ptp(numbers))
        clock = times / step
    return frames, step, None if np.array_equal(frames, clock) else clock


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
