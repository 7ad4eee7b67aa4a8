"""Sizes of solids from their masks in many frames: Gauss-Newton steps in which each frame's pose is eliminated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye import Solid
from atw_mcp.perception.eye.silhouette import Fit, pure_edges
from atw_mcp.perception.known_scene import Sized
from atw_mcp.perception.mask_scene import MaskScene
from atw_mcp.perception.observation import ImageObservation, ObservedObject
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.shapes import Box, Cylinder, Sphere

Floats = NDArray[np.float64]
SolidKind = Literal["sphere", "cylinder", "cube", "box"]

FRAMES = 14  # in which an object is measured: more are alike
AXES: dict[SolidKind, Floats] = {  # sizes (k, 3) of each kind, by the half extents that each is
    "sphere": np.array([[1.0, 1.0, 1.0]]),
    "cylinder": np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "cube": np.array([[1.0, 1.0, 1.0]]),
    "box": np.eye(3),
}
FREEDOM = {"sphere": 0.0, "cube": 0.05, "cylinder": 0.12, "box": 0.2}  # [nats] that a kind with more of it must gain
LOOK = 0.4  # [nats] of a kind's name by its look from afar, which has no camera to go by


@dataclass(frozen=True)
class SolidEstimate:
    """The solid an object is taken for.

    size_sigma: standard deviation of each size [m]; residual: typical distance of the outline from the mask's
    [px]; alternatives: the same for every kind that was tried; confidence (0..1) that the kind is right.
    """

    solid: Sized
    size_sigma: tuple[float, ...]
    residual: float
    alternatives: dict[str, float]
    confidence: float
    frames: int

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "solid": self.solid.model_dump(mode="json"),
            "size_sigma": [round(s, 5) for s in self.size_sigma],
            "residual_px": round(self.residual, 3),
            "alternatives_px": {k: round(v, 3) for k, v in self.alternatives.items()},
            "confidence": round(self.confidence, 3),
            "frames": self.frames,
        }


def estimate_size(
    observation: ImageObservation, name: str, camera: Camera, plane: MotionPlane, kinds: Sequence[SolidKind]
) -> SolidEstimate | None:
    """Estimate which solid of some kinds an object is, and its sizes; None where no frame shows it on the plane."""
    observed = observation.object(name)
    rows = _rows(observed)
    tried: dict[SolidKind, tuple[Floats, Floats, float]] = {}
    for kind in kinds:
        found = _fit(observation, name, camera, plane, kind, rows)
        if found is not None:
            tried[kind] = found
    if not tried:
        return None
    # Each doubling of the misfit outweighs the look from afar.
    score: dict[SolidKind, float] = {}
    for kind, (_, _, misfit) in tried.items():
        agrees = kind == observed.shape.name or (kind == "cube" and observed.shape.name == "box")
        score[kind] = float(np.log(max(misfit**2, 0.02))) + FREEDOM[kind]
        score[kind] -= LOOK * observed.shape.confidence if agrees else 0.0
    best, *others = sorted(score, key=lambda kind: score[kind])
    gap = score[others[0]] - score[best] if others else 2.0
    sizes, sigma, misfit = tried[best]
    return SolidEstimate(
        solid=_solid_of(best, sizes),
        size_sigma=tuple(float(s) for s in sigma),
        residual=misfit,
        alternatives={str(kind): other for kind, (_, _, other) in tried.items()},
        confidence=float(1 / (1 + np.exp(-3 * gap))),
        frames=len(rows),
    )


def _fit(
    observation: ImageObservation, name: str, camera: Camera, plane: MotionPlane, kind: SolidKind, rows: list[int]
) -> tuple[Floats, Floats, float] | None:
    """Sizes (k,), their standard deviations (k,) [m] and the misfit [px] of one kind of solid."""
    axes = AXES[kind]
    solid = Solid(name, "box" if kind == "cube" else kind, (1e-6, 1e-6, 1e-6), camera, plane)
    scene = MaskScene(observation, [solid])
    poses = {row: pose for row in rows if (pose := scene.placed(0, row)) is not None}
    if not poses:
        return None
    areas = observation.object(name).area
    away = [solid.depth(pose) * np.sqrt(areas[row] / np.pi) for row, pose in poses.items()]
    half = np.full(3, float(np.median(away)) / camera.intrinsics[0][0] * (1.0 if kind == "sphere" else 0.8))
    step, sigma, misfit = np.zeros(len(axes)), np.zeros(len(axes)), np.inf
    near: Mapping[int, Floats] = {}
    for _ in range(5):
        scene.bodies[0] = replace(solid, half=(float(half[0]), float(half[1]), float(half[2])))
        fits = {row: fit for row in poses if (fit := scene.fit(0, row, near.get(row))) is not None}
        if not fits:
            return None
        near = {row: fit.pose for row, fit in fits.items()}
        misfit = float(np.median([fit.misfit for fit in fits.values()]))
        step, sigma = _step(scene, fits, axes)
        half = half * np.exp(step @ axes)
        if np.abs(step).max() < 1e-3:
            break
    sizes = half[np.argmax(axes, axis=1)]
    return sizes, sizes * sigma, misfit


def _step(scene: MaskScene, fits: Mapping[int, Fit], axes: Floats) -> tuple[Floats, Floats]:
    """Change (k,) of the logarithms of sizes towards the edges that all frames show, and their standard deviations."""
    s, solid = scene.settings, scene.bodies[0]
    assert isinstance(solid, Solid)
    matrix, right = 1e-9 * np.eye(len(axes)), np.zeros(len(axes))
    for row, fit in fits.items():
        contour = solid.contour(fit.pose, s.normals)
        reach = min(s.reaches[0], s.reach_radii * solid.radius(fit.pose) + 1.5)
        distance, precision, _ = pure_edges(scene, 0, row, fit.pose, contour, reach)
        shown = precision > 0
        scale = max(1.48 * float(np.median(np.abs(distance[shown]))) if shown.any() else 0.0, s.edge_error)
        limit = s.robust * scale * np.where(distance > 0, s.outward, 1.0)
        weight = precision / (1 + (distance / limit) ** 2) ** 2
        weight /= max(s.correlated / contour.spacing, 1.0)
        grown = []
        for axis in axes:  # a convex silhouette moves along a normal as its outermost point does
            larger = replace(solid, half=tuple(solid.half * np.exp(1e-4 * axis)))
            reaches = [(contour.normals @ b.polygon(fit.pose).T).max(axis=1) for b in (larger, solid)]
            grown.append((reaches[0] - reaches[1]) / 1e-4)
        rates, own = np.stack(grown, axis=1), contour.rates[:, solid.free]
        inner = np.linalg.inv(own.T @ (own * weight[:, None]) + 1e-9 * np.eye(own.shape[1]))
        coupling = rates.T @ (own * weight[:, None])
        matrix += rates.T @ (rates * weight[:, None]) - coupling @ inner @ coupling.T
        right += (rates - own @ inner @ coupling.T).T @ (weight * distance)
    matrix += 1e-4 * np.diag(matrix).max() * np.eye(len(axes))
    inverse = np.linalg.inv(matrix)
    # Errors of the outline (lens, contact shadow) repeat from frame to frame: frames do not average them out.
    sigma = np.sqrt(np.diag(inverse) * max(len(fits) / 3.0, 1.0))
    return np.clip(inverse @ right, -0.3, 0.3), sigma


def _rows(observed: ObservedObject) -> list[int]:
    """Rows with the object in full view, as different from each other as can be; else its clearest rows."""
    rows = np.array([t for t, s in enumerate(observed.status) if s == "visible"], dtype=np.int64)
    if len(rows) < 3:
        rows = np.sort(np.argsort(-observed.confidence, kind="stable")[:FRAMES])
        rows = rows[observed.confidence[rows] > 0]
    if len(rows) <= FRAMES:
        return [int(row) for row in rows]
    # Spread along the way travelled, so that a long rest does not outweigh a short flight.
    moved = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(observed.centroid[rows], axis=0).T))])
    along = moved + np.linspace(0, 1.0, len(rows))
    targets = np.linspace(along[0], along[-1], FRAMES)
    return [int(rows[k]) for k in np.unique(np.abs(along[None, :] - targets[:, None]).argmin(axis=1))]


def _solid_of(kind: SolidKind, sizes: Floats) -> Sized:
    values = [float(s) for s in sizes]
    if kind == "sphere":
        return Sphere(radius=values[0])
    if kind == "cylinder":
        return Cylinder(radius=values[0], half_height=values[1])
    a, b, c = values * 3 if kind == "cube" else values
    return Box(half_extents=(a, b, c))
