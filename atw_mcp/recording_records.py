"""Recordings of a case: measured motion in several runs, and which part of it is sealed."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.app import App
from atw_mcp.cases import path_hash
from atw_mcp.track_records import read_record
from evidence_store import Case
from polyworld.discrepancy.holdback import HeldBack, hold_back
from polyworld.recording import Recording, Run
from polyworld.recording_csv import read_recording
from polyworld.world import World

KIND = "recording"


@dataclass(frozen=True)
class CaseRecording:
    """What the gap of a case is measured on. id: of the observation; parts: what may be fitted and what is sealed."""

    id: str
    parts: HeldBack


@dataclass(frozen=True)
class Imported:
    """A recording as it was taken in. remarks: what the reader had to say about the file."""

    id: str
    recording: Recording
    parts: HeldBack
    remarks: tuple[str, ...]


def keep_recording(app: App, case: Case, path: Path, sealed: Sequence[str] | None) -> Imported:
    """A CSV of runs becomes the case's latest recording.

    sealed: names of the runs that are sealed; default: as `hold_back` chooses. A file without a column `object` shows
    the only moving object of the case's latest world. Raises ValueError or KeyError for files that cannot be read.
    """
    drafts = [world for world, _ in app.store.cases.worlds(case.id)]
    names = app.world(case, drafts[-1]).moving_names if drafts else ()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recording = read_recording(path, names)
    parts = hold_back(recording, sealed)
    listed = None if sealed is None else list(sealed)
    inputs = {
        "file": path_hash(path),
        "sealed": listed,
        "objects": sorted({name for run in recording.runs for name in run.names}),
    }
    document = {"source": {"file": path.name, "sha256": inputs["file"]}, "sealed": listed, **_plain(recording)}
    with app.store.transaction():
        content = app.store.observations.put(KIND, inputs, document)
        app.store.cases.add_observation(case.id, KIND, content.id)
    return Imported(content.id, recording, parts, tuple(str(item.message) for item in caught))


def case_recording(app: App, case: Case, world: World) -> CaseRecording:
    """The case's latest recording of runs, else its latest tracks as one run whose last quarter is sealed.

    Objects that the world has not are left out. Raises ValueError where the case has neither.
    """
    known = [identifier for _, identifier in app.store.cases.observations(case.id, KIND)]
    if known:
        document = app.store.observations.get(known[0]).document
        recording = _known_objects(_recording(document), world)
        return CaseRecording(known[0], hold_back(recording, document["sealed"]))
    record = read_record(app.store, case)
    if record is None:
        raise ValueError(
            f"case {case.id!r} has no measured motion. Next: ImportObservation(case={case.id!r}, kind='recording', "
            "path=CSV), or ObserveObjects and BuildWorld for a video"
        )
    recording = _known_objects(Recording((Run.of_tracks("video", record.tracks),)), world)
    return CaseRecording(record.id, hold_back(recording))


def _known_objects(recording: Recording, world: World) -> Recording:
    runs = []
    for run in recording.runs:
        columns = [i for i, name in enumerate(run.names) if name.split("#", 1)[0] in world.moving_names]
        if not columns:
            continue
        seen = np.any(np.isfinite(run.positions[:, columns]), axis=(1, 2))
        seen |= np.any(np.all(np.isfinite(run.orientations[:, columns]), axis=2), axis=1)
        runs.append(
            Run(
                run.name,
                tuple(run.names[i] for i in columns),
                run.times[seen],
                run.positions[seen][:, columns],
                run.orientations[seen][:, columns],
                run.sigma,
                tuple(run.symmetry[i] for i in columns),
                run.lead,
            )
        )
    if not runs:
        named = sorted({name for run in recording.runs for name in run.names})
        raise ValueError(f"the recording shows {named}, the world has {list(world.moving_names)}: nothing in common")
    return Recording(tuple(runs))


def _plain(recording: Recording) -> dict[str, Any]:
    return {
        "runs": [
            {
                "name": run.name,
                "names": list(run.names),
                "times": run.times.tolist(),
                "positions": _listed(run.positions),
                "orientations": _listed(run.orientations),
                "sigma": run.sigma,
                "symmetry": list(run.symmetry),
                "lead": run.lead,
            }
            for run in recording.runs
        ]
    }


def _recording(document: dict[str, Any]) -> Recording:
    return Recording(
        tuple(
            Run(
                item["name"],
                tuple(item["names"]),
                np.asarray(item["times"], dtype=float),
                np.asarray(item["positions"], dtype=float).reshape(-1, len(item["names"]), 3),
                np.asarray(item["orientations"], dtype=float).reshape(-1, len(item["names"]), 4),
                item["sigma"],
                tuple(item["symmetry"]),
                item["lead"],
            )
            for item in document["runs"]
        )
    )


def _listed(values: NDArray[np.float64]) -> list[Any]:
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    listed: list[Any] = plain.tolist()
    return listed
