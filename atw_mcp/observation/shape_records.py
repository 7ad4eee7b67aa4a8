"""Shapes of a case: measured in the video, kept beside the observation they come from, and put into the world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.perception.shapes import Material
from evidence_store import Case, Content
from polyworld.data.shape_series import ShapeSeries
from polyworld.probing.readouts import Centreline, Curve
from polyworld.probing.readouts.centreline import resampled
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera

KIND = "shapes"


@dataclass(frozen=True)
class ShapeRecord:
    """Shapes in pixels as stored. objects: id of the observation they were measured in; kinds: what each object was
    taken for; declared: names that the agent said are deformable, the others were only noticed."""

    id: str
    objects: str
    kinds: dict[str, Material]
    declared: tuple[str, ...]
    frames: NDArray[np.int64]
    series: tuple[ShapeSeries, ...]

    @classmethod
    def of(cls, content: Content) -> ShapeRecord:
        """The record in an observation of kind `shapes`."""
        document = content.document
        return cls(
            id=content.id,
            objects=document["objects"],
            kinds=document["kinds"],
            declared=tuple(document["declared"]),
            frames=np.asarray(document["frames"], dtype=np.int64),
            series=tuple(ShapeSeries.from_dict(item) for item in document["series"]),
        )


def shape_inputs(objects: str, kinds: Mapping[str, Material], declared: tuple[str, ...]) -> dict[str, Any]:
    """Return what determines a shape record."""
    return {"objects": objects, "kinds": dict(sorted(kinds.items())), "declared": sorted(declared)}


def keep_shapes(
    app: App, case: Case, inputs: dict[str, Any], frames: tuple[int, ...], series: tuple[ShapeSeries, ...]
) -> ShapeRecord:
    """Store shapes and make them the case's latest."""
    document = {**inputs, "frames": list(frames), "series": [item.to_dict() for item in series]}
    with app.store.transaction():
        content = app.store.observations.put(KIND, inputs, document)
        app.store.cases.add_observation(case.id, KIND, content.id)
    return ShapeRecord.of(content)


def latest_shapes(app: App, case: Case, objects: str) -> ShapeRecord | None:
    """The latest shapes measured in an observation of the case; None where it has none."""
    for _, identifier in app.store.cases.observations(case.id, KIND):
        content = app.store.observations.get(identifier)
        if content.document["objects"] == objects:
            return ShapeRecord.of(content)
    return None


def shapes_in_world(series: tuple[ShapeSeries, ...], camera: Camera, plane: MotionPlane) -> tuple[ShapeSeries, ...]:
    """The same series, with the lines of ropes moved from the image onto the plane of motion.

    Other shapes stay in pixels: a world with this camera is compared there. A rope that leaves the plane would be
    misplaced: what lies across a supporting plane stays in pixels too.
    """
    if plane.supports:
        return series
    return tuple(_in_world(item, camera, plane) for item in series)


def _in_world(series: ShapeSeries, camera: Camera, plane: MotionPlane) -> ShapeSeries:
    readout = series.readout
    if not isinstance(readout, Centreline | Curve) or readout.view != "image":
        return series
    places = camera.onto_plane(series.values, np.asarray(plane.point), np.asarray(plane.normal))
    seen = (series.confidence > 0.0) & np.isfinite(places).all(axis=-1)
    depth = camera.to_camera(places)[..., 2]
    sigma = series.sigma * depth / camera.intrinsics[0][0]
    if isinstance(readout, Centreline):
        whole = np.asarray(np.all(seen, axis=1))
        places[whole] = resampled(places[whole], readout.count)  # even in the image is not even in space
        seen &= whole[:, None]
    return ShapeSeries(
        readout.model_copy(update={"view": "world"}),
        np.where(seen[..., None], places, np.nan),
        np.where(seen, sigma, np.nan),
        np.where(seen, series.confidence, 0.0),
    )


def series_rows(series: tuple[ShapeSeries, ...], frames: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Summarize each series for an agent: of what, how many entries, in which frames."""
    rows = []
    for item in series:
        seen = np.flatnonzero((item.confidence > 0.0).any(axis=1))
        rows.append(
            {
                "object": item.object,
                "readout": item.readout.kind,
                "view": getattr(item.readout, "view", "image" if item.readout.kind == "image_occupancy" else "world"),
                "entries": item.values.shape[1],
                "frames_seen": len(seen),
                "first_frame": int(frames[seen[0]]) if len(seen) else None,
                "last_frame": int(frames[seen[-1]]) if len(seen) else None,
                "sigma": float(np.nanmedian(item.sigma[item.confidence > 0.0])) if len(seen) else None,
            }
        )
    return rows
