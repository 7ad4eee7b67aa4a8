"""Scenes: surfaces, rods and floors that show the things of a world at one moment, and rays cast at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.pictures import raycast
from polyworld.world.camera import Camera

Array = NDArray[np.float64]
Ints = NDArray[np.int32]
Color = tuple[int, int, int]

BACKGROUND = (222, 226, 232)


@dataclass(frozen=True)
class Surface:
    """Triangles (t, 3) of vertices (k, 3) [m], world axes, with unit normals (k, 3) and a brightness (t,) each.

    Counter-clockwise seen from outside; backs are drawn a little darker. liquid: seen through, its surface closed.
    """

    vertices: Array
    triangles: Ints
    normals: Array
    tint: Array
    liquid: bool = False


@dataclass(frozen=True)
class Rods:
    """Cylinders between starts and ends (r, 3) of radius (r,) [m], with a brightness (r,) each.

    flat: whether their ends are flat, else round. A rod of no length is a ball.
    """

    starts: Array
    ends: Array
    radii: Array
    tint: Array
    flat: bool = False


@dataclass(frozen=True)
class Floor:
    """A chequered plane through a point (3,), axes (3, 3) with its normal as third row; seen from above only."""

    point: Array
    axes: Array


@dataclass(frozen=True)
class Drawn:
    """A thing in a picture: its label, its colour, its form."""

    label: int
    color: Color
    form: Surface | Rods | Floor


@dataclass(frozen=True)
class Hits:
    """Nearest things along the rays of a camera's pixels (H, W).

    labels: -1 where nothing. depth: along the camera's axis [m], inf where nothing. normals (H, W, 3).
    color (H, W, 3): shaded, 0..1. mesh: all surfaces of the scene relative to the camera, None where it has none.
    """

    labels: Ints
    depth: NDArray[np.float32]
    normals: NDArray[np.float32]
    color: NDArray[np.float32]
    mesh: Any = None


def smooth_surface(vertices: Array, triangles: Ints, tint: Array | None = None, *, liquid: bool = False) -> Surface:
    """Return a surface whose normals at vertices are those of the faces around, weighted by their areas.

    Triangles at vertices that are not finite are left out.
    """
    whole = np.isfinite(vertices[triangles]).all(axis=(1, 2))
    triangles, tint = triangles[whole], np.ones(whole.sum()) if tint is None else tint[whole]
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    normals: Array = np.zeros_like(vertices)
    for axis in range(3):
        for corner in range(3):
            normals[:, axis] += np.bincount(triangles[:, corner], weights=face[:, axis], minlength=len(vertices))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return Surface(np.where(np.isfinite(vertices), vertices, 0.0), triangles, normals, tint, liquid)


def cast_rays(camera: Camera, things: Sequence[Drawn]) -> Hits:
    """Cast a ray through each pixel of a camera at things."""
    shape = (camera.height, camera.width)
    arrays: list[Any] = [buffers.empty(shape, kind) for kind in (int, float, wp.vec3, wp.vec3)]
    scene, mesh, _rods = _packed(camera.centre, things)
    background = wp.vec3(*(c / 255.0 for c in BACKGROUND))
    view = [pixel_to_ray(camera), wp.vec3(*light(camera)), background, _tile_size(camera)]
    buffers.launch(raycast.cast, shape, [scene, *view, *arrays])
    labels, depth, normals, color = (buffers.read(array) for array in arrays)
    return Hits(labels, depth, normals, color, mesh)


def pixel_to_ray(camera: Camera) -> Any:
    """Return the matrix that takes pixels (u, v, 1) to rays in world axes, one metre along the camera's axis."""
    return wp.mat33(*(np.asarray(camera.rotation).T @ np.linalg.inv(np.asarray(camera.intrinsics))).ravel())


def light(camera: Camera) -> Array:
    """Return the unit direction (3,) towards the light, which comes over the viewer's left shoulder."""
    direction: Array = np.asarray(camera.rotation).T @ np.array([-0.35, -0.75, -0.56])
    return direction / np.linalg.norm(direction)


def _packed(eye: Array, things: Sequence[Drawn]) -> tuple[Any, Any, Any]:
    """Return the scene on the device relative to the eye (3,), its mesh and its hierarchy of rods, None where empty.

    The caller keeps the last two as long as the scene is used.
    """
    surfaces = [(t, t.form) for t in things if isinstance(t.form, Surface) and len(t.form.triangles)]
    rods = [(t, t.form) for t in things if isinstance(t.form, Rods) and len(t.form.radii)]
    floors = [(t, t.form) for t in things if isinstance(t.form, Floor)]
    scene: Any = raycast.Scene()
    mesh = hierarchy = None

    def array(rows: Sequence[Any], dtype: Any) -> Any:
        return buffers.array(np.concatenate(rows).astype(np.int32 if dtype is int else np.float32), dtype)

    if surfaces:
        first = np.cumsum([0, *(len(s.vertices) for _, s in surfaces)])
        scene.indices = array([s.triangles + k for (_, s), k in zip(surfaces, first[:-1], strict=True)], int)
        scene.normals = array([s.normals for _, s in surfaces], wp.vec3)
        scene.triangle_label = array([np.full(len(s.triangles), t.label) for t, s in surfaces], int)
        scene.triangle_color = array([_colors(t, s.tint) for t, s in surfaces], wp.vec3)
        with buffers.running():
            mesh = wp.Mesh(array([s.vertices - eye for _, s in surfaces], wp.vec3), scene.indices.flatten())
        scene.mesh = mesh.id
    if rods:
        starts, ends = (np.concatenate([getattr(r, end) - eye for _, r in rods]) for end in ("starts", "ends"))
        radii = np.concatenate([r.radii for _, r in rods])[:, None]
        lower, upper = np.minimum(starts, ends) - radii, np.maximum(starts, ends) + radii
        with buffers.running():
            hierarchy = wp.Bvh(array([lower], wp.vec3), array([upper], wp.vec3))
        scene.rods = hierarchy.id
        scene.start, scene.end = array([starts], wp.vec3), array([ends], wp.vec3)
        scene.radius = array([radii[:, 0]], float)
        scene.flat = array([np.full(len(r.radii), r.flat) for _, r in rods], int)
        scene.rod_label = array([np.full(len(r.radii), t.label) for t, r in rods], int)
        scene.rod_color = array([_colors(t, r.tint) for t, r in rods], wp.vec3)
    if floors:
        scene.floor_point = array([[f.point - eye for _, f in floors]], wp.vec3)
        scene.floor_axes = array([[f.axes for _, f in floors]], wp.mat33)
        scene.floor_label = array([[t.label for t, _ in floors]], int)
        scene.floor_color = array([_colors(t, np.ones(1)) for t, _ in floors], wp.vec3)
    return scene, mesh, hierarchy


def _colors(thing: Drawn, tint: Array) -> Array:
    return np.outer(tint, np.asarray(thing.color) / 255.0)


def _tile_size(camera: Camera) -> float:
    """Edge of the tiles of a floor [m]: the power of ten, or half of one, that puts a handful across the view."""
    across = 2.0 * float(np.linalg.norm(camera.centre)) * camera.width / 2.0 / camera.intrinsics[0][0]
    exponent = np.floor(np.log10(max(across, 1e-6) / 4.0))
    step = float(10.0**exponent)
    return 5.0 * step if across / (5.0 * step) > 4.0 else step
