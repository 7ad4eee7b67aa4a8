"""Position and orientation of objects of known shape, by a command such as FoundationPose (see `commands.py`).

OUTPUT/poses.json: {"objects": {NAME: [{"frame": number, "pose": 4 x 4, "confidence": 0..1, "sigma": metres}, ...]}}

pose takes body axes to camera axes (x right, y down, z forward), translation in metres. confidence and sigma may be
left out; they are then 1, and 1% of the distance, which is an assumption and not a measurement.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.models.commands import Request, outcome_of, read_outcome
from atw_mcp.models.folders import ModelError, ModelFolder
from atw_mcp.models.running import Limits
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Cancelled, Frames, Progress
from polyworld.data.tracks import ObservedTracks, continuous
from polyworld.world.camera import Camera
from polyworld.world.geometry import surface_mesh
from polyworld.world.shapes import BodyShape, Compound

DEFAULT_SIGMA = 0.01  # of the distance


def poses(
    model: ModelFolder,
    observation: ImageObservation,
    frames: Frames,
    camera: Camera,
    shapes: Mapping[str, BodyShape],
    seconds_per_frame: float,
    limits: Limits,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ObservedTracks:
    """Tracks with orientations of the objects in `shapes`; raises ModelError."""
    request = Request(
        observation,
        frames,
        tuple(shapes),
        seconds_per_frame,
        intrinsics=[list(row) for row in camera.intrinsics],
        meshes={name: _surface(shape) for name, shape in shapes.items()},
    )
    with outcome_of(model, request, limits, progress=progress, cancelled=cancelled) as folder:
        said = read_outcome(folder, "poses.json", model)
    unknown = sorted(set(said) - set(shapes))
    if unknown:
        raise ModelError(f"{model.name} gave poses of {unknown}; it was asked for {list(shapes)}")
    return _tracks(model, said, observation, camera, tuple(shapes), seconds_per_frame)


def _surface(shape: BodyShape) -> trimesh.Trimesh:
    """Return the surface of a body; raises ModelError for a compound, which has no single one here."""
    if isinstance(shape, Compound):
        raise ModelError(f"a shape of kind {shape.kind} has no single surface: give a mesh of the whole object")
    return surface_mesh(shape)


def _tracks(
    model: ModelFolder,
    said: dict[str, Any],
    observation: ImageObservation,
    camera: Camera,
    names: tuple[str, ...],
    seconds_per_frame: float,
) -> ObservedTracks:
    count, n = len(observation.frames), len(names)
    positions, orientations = np.full((count, n, 3), np.nan), np.full((count, n, 4), np.nan)
    sigma, confidence = np.full((count, n), np.nan), np.zeros((count, n))
    rotation, translation = np.asarray(camera.rotation), np.asarray(camera.translation)
    for column, name in enumerate(names):
        for entry in said.get(name, []):
            row, pose = _entry(model, name, entry, observation)
            positions[row, column] = (pose[:3, 3] - translation) @ rotation
            turned = Rotation.from_matrix(rotation.T @ pose[:3, :3])
            orientations[row, column] = turned.as_quat()[[3, 0, 1, 2]]
            sigma[row, column] = float(entry.get("sigma", DEFAULT_SIGMA * np.linalg.norm(pose[:3, 3])))
            confidence[row, column] = float(entry.get("confidence", 1.0))
        orientations[:, column] = _signed(orientations[:, column])
    return ObservedTracks(
        names=names,
        frames=np.asarray(observation.frames, dtype=np.int64),
        seconds_per_frame=seconds_per_frame,
        clock=observation.video.moments(observation.frames),
        positions=positions,
        position_sigma=sigma,
        orientations=orientations,
        confidence=confidence,
        orientation_confidence=confidence.copy(),
        symmetry=tuple(1 for _ in names),
    )


def _entry(model: ModelFolder, name: str, entry: Any, observation: ImageObservation) -> tuple[int, NDArray[np.float64]]:
    if not isinstance(entry, dict) or "frame" not in entry or "pose" not in entry:
        raise ModelError(f"{model.name}: poses.json: {name}: an entry needs frame and pose")
    row = observation.row(int(entry["frame"]))
    pose = np.asarray(entry["pose"], dtype=float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ModelError(f"{model.name}: poses.json: {name}: pose must be 4 x 4 finite numbers, got {pose.shape}")
    turn = pose[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise ModelError(f"{model.name}: poses.json: {name}, frame {entry['frame']}: not a rotation")
    if not 0.0 <= float(entry.get("confidence", 1.0)) <= 1.0:
        raise ModelError(f"{model.name}: poses.json: {name}: confidence must lie in 0..1")
    return row, pose


def _signed(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    known = np.isfinite(quaternions).all(axis=1)
    result = quaternions.copy()
    result[known] = continuous(quaternions[known])
    return result
