"""A triangle mesh of each object from its images, by a command such as SAM 3D (see `commands.py`).

OUTPUT/meshes.json: {"objects": {NAME: {"file": "ball.ply", "metres_per_unit": 1.0}}}

file lies in OUTPUT, of any kind trimesh reads (PLY, OBJ, GLB, STL). metres_per_unit: null where the model does not know
the scale; then it is not guessed, but comes from the object's known size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from atw_mcp.models.commands import Request, outcome_of, read_outcome
from atw_mcp.models.folders import ModelError, ModelFolder
from atw_mcp.models.running import Limits
from atw_mcp.perception.import_images import ImportedMesh, import_mesh
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Cancelled, Frames, Progress


@dataclass(frozen=True)
class PredictedMesh:
    """A mesh in metres; scale_from: where its size comes from."""

    mesh: ImportedMesh
    scale_from: str


def meshes(
    model: ModelFolder,
    observation: ImageObservation,
    frames: Frames,
    objects: Sequence[str],
    sizes: Mapping[str, float],
    seconds_per_frame: float,
    limits: Limits,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> dict[str, PredictedMesh]:
    """Meshes by object; sizes: its greatest extent [m] where that is known. Raises ModelError."""
    best = {}
    for name in objects:
        item = observation.object(name)
        best[name] = observation.frames[int(np.argmax(item.confidence * np.sqrt(item.area)))]
    request = Request(observation, frames, objects, seconds_per_frame, more={"best_frames": best})
    found = {}
    with outcome_of(model, request, limits, progress=progress, cancelled=cancelled) as folder:
        said = read_outcome(folder, "meshes.json", model)
        for name in objects:
            entry = said.get(name)
            if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
                raise ModelError(f"{model.name}: meshes.json has no file for {name!r}; it has {sorted(said)}")
            file = (folder / entry["file"]).resolve()
            if folder.resolve() not in file.parents:
                raise ModelError(f"{model.name}: the mesh of {name} must lie in OUTPUT, not at {entry['file']}")
            plain = import_mesh(file)
            extent = float(np.ptp(plain.vertices, axis=0).max())
            if name in sizes:
                scale, origin = sizes[name] / extent, f"the given size of {sizes[name]:g} m"
            elif entry.get("metres_per_unit") is not None:
                scale, origin = float(entry["metres_per_unit"]), f"{model.name}'s own scale"
            else:
                raise ModelError(f"{model.name} does not know the size of {name}: give its greatest extent in metres")
            found[name] = PredictedMesh(import_mesh(file, scale=scale), origin)
    return found
