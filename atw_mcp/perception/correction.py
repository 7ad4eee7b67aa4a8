"""Corrections of an observation by whoever looks at it: where objects are and are not, and which tracks are one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from atw_mcp.perception.constrained import Constrained, Constrainer
from atw_mcp.perception.constraints import ordered
from atw_mcp.perception.corrections import Correction
from atw_mcp.perception.import_images import standing_apart
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject, Status
from atw_mcp.perception.observe import describe
from atw_mcp.perception.scene_models import model_scene
from atw_mcp.perception.seed_statements import SeedReader
from atw_mcp.perception.track_edits import TrackEdits
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, load
from polyworld.world.camera import Camera

IN_PART = 0.5  # confidence below which an object that is followed is not said to be in full view


def correct(
    observation: ImageObservation,
    video_path: str | Path,
    corrections: Sequence[Correction],
    *,
    camera: Camera | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """Return the observation with corrections applied; objects not concerned keep their masks.

    Merges, splits, renamings and drops apply in the order given. Everything else becomes a constraint, kept with the
    observation and binding for all later corrections; masks depend on the set of constraints, not on their order.
    camera: needed for places in the world. Raises ObservationError for an unknown object or frame, a name that is taken
    or not allowed, an outline that holds no object, and constraints that contradict each other; VideoError for the
    video.
    """
    if not corrections:
        return observation
    report = progress or (lambda _share, _what: None)

    def stop() -> None:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("correction cancelled")

    stop()
    stride = observation.frames[1] - observation.frames[0] if len(observation.frames) > 1 else 1
    info, frames = load(video_path, stride=stride)
    if info.sha256 != observation.video.sha256:
        raise ObservationError(f"{info.path} is not the video of this observation ({observation.video.path})")
    edits = TrackEdits(observation)
    for correction in corrections:
        edits.apply(correction)
    edits.check()
    if not edits.statements and not edits.constraints:
        return _described(edits, frames, Constrained(edits.found))
    report(0.05, "modelling the background")
    models = model_scene(frames, stop)
    reader = SeedReader(models, edits, camera)
    constraints = ordered(reader.constraints())
    derived = Constrainer(
        models,
        edits.found,
        constraints,
        observation.frames,
        stop,
        lambda share, what: report(0.4 + 0.5 * share, what),
    ).run()
    report(0.9, "reading colours and shapes")
    corrected = _described(edits, frames, derived)
    report(1.0, f"{len(corrections)} corrections applied")
    return replace(corrected, constraints=constraints, notes=tuple(dict.fromkeys([*reader.notes, *derived.notes])))


def _described(edits: TrackEdits, frames: Frames, derived: Constrained) -> ImageObservation:
    """Return the observation with these masks: objects whose masks are as they were stay as they were described."""
    white = float(np.percentile(frames[0].astype(np.float32) @ np.array([0.114, 0.587, 0.299], np.float32), 80))
    apart = dict(zip(derived.masks, standing_apart(list(derived.masks.values())), strict=True))
    objects: list[ObservedObject] = []
    found = {}
    for name, masks in derived.masks.items():
        old = edits.described.get(name)
        if name in derived.changed:
            found[name] = _encoded(edits.found[name])
        if old is not None and name not in derived.sureness and _equal(masks, edits.current[name]):
            objects.append(old)
            continue
        sure = derived.sureness.get(name, np.full(len(masks), np.nan))
        clarity = np.where(np.isnan(sure), 1.0, sure)
        made = describe(masks, frames, clarity.tolist(), apart[name], white)
        if made is not None:
            objects.append(replace(made, name=name, status=_status(made, sure)))
    seen = {o.name for o in objects}
    return replace(
        edits.observation,
        objects=tuple(objects),
        found={name: masks for name, masks in found.items() if name in seen},
        constraints=tuple(c for c in edits.constraints if c.object is None or c.object in seen),
        warnings=(*edits.observation.warnings, *edits.notes),
        notes=(),
    )


def _status(described: ObservedObject, sure: np.ndarray) -> tuple[Status, ...]:
    """Return the status of an object in each row: what is followed unsurely is not in full view."""
    return tuple(
        "occluded" if status == "visible" and not np.isnan(share) and share < IN_PART else status
        for status, share in zip(described.status, sure, strict=True)
    )


def _encoded(masks: list[Mask]) -> tuple[RunLengthMask | None, ...]:
    return tuple(RunLengthMask.encode(m) if m.any() else None for m in masks)


def _equal(masks: list[Mask], others: list[Mask]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(masks, others, strict=True))
