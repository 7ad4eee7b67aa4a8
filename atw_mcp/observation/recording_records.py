"""Recordings of a case: measured motion in several runs, and which part of it is sealed."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.cases.cases import path_hash
from atw_mcp.observation.track_records import at_rate, read_record
from atw_mcp.worlds.last_fit import last_fit
from evidence_store import Case
from polyworld.data.recording import Recording, Run
from polyworld.data.recording_csv import read_recording
from polyworld.data.recording_header import RecordingForm
from polyworld.gap.sealed import Split, hold_out
from polyworld.world import World

KIND = "recording"
READER = 3  # counts changes of what the reader makes of a file


@dataclass(frozen=True)
class CaseRecording:
    """Data that the gap of a case is measured on. id: of the observation; parts: those to fit and those sealed."""

    id: str
    parts: Split


@dataclass(frozen=True)
class Imported:
    """A recording as it was taken in. remarks: what the reader had to say about the file."""

    id: str
    recording: Recording
    parts: Split
    remarks: tuple[str, ...]


def keep_recording(app: App, case: Case, path: Path, sealed: Sequence[str] | None, form: RecordingForm) -> Imported:
    """Keep a table of runs as the case's latest recording.

    sealed: names of the runs that are sealed; default: as `hold_out` chooses. A file without a column `object` shows
    the only moving object of the case's latest world, and angles are of bodies on that world's hinges. Raises
    ValueError or KeyError for files that cannot be read.
    """
    drafts = [world for world, _ in app.store.cases.worlds(case.id)]
    world = app.world(case, drafts[-1]) if drafts else None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recording = read_recording(path, form=form, world=world)
    parts = hold_out(recording, sealed)
    listed = None if sealed is None else list(sealed)
    inputs: dict[str, Any] = {
        "file": path_hash(path),
        "sealed": listed,
        "objects": sorted({name for run in recording.runs for name in run.names}),
        "reader": READER,
    }
    if form.seconds_per_frame is not None:
        inputs["seconds_per_frame"] = form.seconds_per_frame
    if form.columns:
        inputs["columns"] = dict(form.columns)
    if world is not None and world.joints:  # angles are converted by its hinges
        inputs["world"] = world.id
    document = {"source": {"file": path.name, "sha256": inputs["file"]}, "sealed": listed, **_plain(recording)}
    with app.store.transaction():
        content = app.store.observations.put(KIND, inputs, document)
        app.store.cases.add_observation(case.id, KIND, content.id)
    return Imported(content.id, recording, parts, tuple(dict.fromkeys(str(w.message) for w in caught)))


def case_recording(app: App, case: Case, world: World) -> CaseRecording:
    """The case's latest recording of runs, else the tracks that the world models, as one run.

    Of tracks that part is sealed which the world's fit held out, else the last quarter. Objects that the world has not
    are left out. Raises ValueError where the case has neither.
    """
    known = [identifier for _, identifier in app.store.cases.observations(case.id, KIND)]
    if known:
        document = app.store.observations.get(known[0]).document
        recording = _known_objects(recording_of(document), world)
        return CaseRecording(known[0], hold_out(recording, document["sealed"]))
    record = read_record(app.store, case, app.store.cases.modelled_observation(case.id, world.id))
    if record is None:
        raise ValueError(
            f"case {case.id!r} has no measured motion. Next: ImportObservation(case={case.id!r}, kind='recording', "
            "path=CSV), or ObserveObjects and BuildWorld for a video"
        )
    step = world.time.seconds_per_frame
    filmed = Run.of_tracks("video", at_rate(record.tracks, step))
    # The world's time 0 is frame 0, also where the tracks begin later.
    run = replace(_present(filmed, world), lead=float(filmed.times[0]))
    fit = last_fit(app, world)
    unseen = None if fit is None or fit.unseen_from is None else fit.unseen_from * step
    parts = hold_out(_known_objects(Recording((run,)), world), begin=unseen)
    if fit is not None and unseen is None and parts.held_out is not None:
        seen = "FitWorld has seen it, but all that it fitted is refitted without it (holdout_from keeps it unseen)"
        parts = replace(parts, summary=f"{parts.summary}; {seen}")
    return CaseRecording(record.id, parts)


def _present(run: Run, world: World) -> Run:
    """The run without what was seen of objects before they join the world."""
    starts = {item.name: item.start_time for item in world.objects}
    early = run.times[:, None] < np.array([starts.get(name, 0.0) for name in run.names]) - 1e-9
    return replace(
        run,
        positions=np.where(early[..., None], np.nan, run.positions),
        orientations=np.where(early[..., None], np.nan, run.orientations),
        angular_velocities=np.where(early[..., None], np.nan, run.angular_velocities),
    )


def _known_objects(recording: Recording, world: World) -> Recording:
    """The runs with those objects alone that the world has, at the instants at which any of them was seen."""
    runs = []
    for run in recording.runs:
        known = run.columns([i for i, name in enumerate(run.names) if name.split("#", 1)[0] in world.moving_names])
        measured = np.concatenate([known.positions, known.orientations, known.angular_velocities], axis=-1)
        seen = np.any(np.isfinite(measured), axis=(1, 2))
        if not seen.any():
            continue
        kept = known.rows(seen)
        # The run begins when it did, whoever is seen first.
        runs.append(replace(kept, lead=float(kept.times[0]) - run.origin))
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
                **({"arms": _listed(np.array(run.arms))} if np.isfinite(run.arms).any() else {}),
                **(
                    {"angular_velocities": _listed(spins)} if np.isfinite(spins := run.angular_velocities).any() else {}
                ),
            }
            for run in recording.runs
        ]
    }


def recording_of(document: dict[str, Any]) -> Recording:
    """The recording in an observation of kind `recording`."""
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
                angular_velocities=np.asarray(item.get("angular_velocities", []), dtype=float).reshape(
                    -1, len(item["names"]), 3
                ),
                arms=tuple(np.asarray(item.get("arms", []), dtype=float).tolist()),
            )
            for item in document["runs"]
        )
    )


def _listed(values: NDArray[np.float64]) -> list[Any]:
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    listed: list[Any] = plain.tolist()
    return listed
