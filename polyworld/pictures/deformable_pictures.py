"""Ropes, cloth and soft bodies in a picture: which triangles and tubes show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.model import DeformableMesh, mesh_of
from polyworld.pictures import rasterize
from polyworld.probing.readouts.rope_line import along_wheels
from polyworld.world import Deformable, World
from polyworld.world.camera import Camera
from polyworld.world.colors import display_color
from polyworld.world.materials import material_of
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.rope import Pulley, Rope

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

THINNEST = 0.8  # [px] radius of a rope that would be thinner than that
CHECKS = 6  # checks along an edge of a cloth, faint: they show how it is stretched and folded
CHECK_CONTRAST = 0.10
STRIPE = 0.12  # contrast between the halves of a rope's stripes, of which there are STRIPES
STRIPES = 16
_MESHES: dict[tuple[str, str], DeformableMesh] = {}
_MOST_MESHES = 64


@dataclass(frozen=True)
class Raster:
    """A picture being drawn: Warp arrays (H, W) of labels, distances along the rays [m] and colours (0..1)."""

    camera: Camera
    pixel_to_ray: NDArray[np.float64]
    light: Array
    labels: Any
    distance: Any
    color: Any


def mesh_for(world: World, item: Deformable) -> DeformableMesh:
    """`mesh_of`, kept for the pictures and readings that follow."""
    key = (world.id, item.name)
    if key not in _MESHES:
        if len(_MESHES) >= _MOST_MESHES:
            _MESHES.clear()
        _MESHES[key] = mesh_of(world, item)
    return _MESHES[key]


def starting_points(world: World) -> dict[str, Array]:
    """Points (k, 3) [m] of every deformable object as it starts, by name."""
    return {item.name: mesh_for(world, item).nodes for item in world.deformables}


def draw_solids(
    world: World,
    points: Mapping[str, Array],
    wheels: Sequence[Pulley],
    raster: Raster,
    hidden: set[str],
    first_label: int,
) -> None:
    """Draw ropes, cloth and soft bodies over what is farther away; fluids are left to `liquid_shading`.

    wheels: the world's pulleys where they now are.
    """
    item: Any
    for index, item in enumerate(world.deformables):
        if material_of(item).form == "liquid" or item.name in hidden:
            continue
        mesh, places = mesh_for(world, item), np.asarray(points[item.name], dtype=float)
        color = display_color(item.appearance.color, first_label + index)
        relative = places - raster.camera.centre
        if material_of(item).form == "line":
            over = [wheel for wheel in wheels if wheel.rope == item.name]
            line, number = along_wheels(item.name, places, over)
            _tubes(item, line - raster.camera.centre, number, len(mesh.segments), color, first_label + index, raster)
        else:
            tint = _checks(item, mesh) if hasattr(item, "geometry") else np.ones(len(mesh.triangles))
            _triangles(relative, mesh.triangles, tint, color, first_label + index, raster)


def rectangles(camera: Camera, centres: Array, bounds: Array) -> Ints:
    """First and last column, first and last row (k, 4) of the pixels that can show balls about points (k, 3),
    relative to the camera's centre; empty behind the camera, cut at the image's border."""
    seen = centres @ np.asarray(camera.rotation).T
    matrix = np.asarray(camera.intrinsics)
    bounds = np.broadcast_to(np.asarray(bounds, dtype=float), len(centres))
    finite = np.all(np.isfinite(seen), axis=1)
    nearest = np.where(finite, seen[:, 2] - bounds, -1.0)
    # A ball of radius b at depth z reaches f b / (z - b) pixels from its centre, and some more off the axis.
    safe = np.where(nearest > 1e-6, nearest, 1.0)
    depth = np.where(finite & (seen[:, 2] > 1e-6), seen[:, 2], 1.0)
    flat = np.where(finite[:, None], seen, 0.0) @ matrix.T
    pixel = flat[:, :2] / depth[:, None]
    off_axis = np.sqrt(1.0 + ((pixel - matrix[:2, 2]) ** 2).sum(axis=1) / matrix[0, 0] ** 2)
    reach = max(matrix[0, 0], matrix[1, 1]) * bounds / safe * off_axis + 1.0
    whole = finite & (nearest <= 1e-6) & (seen[:, 2] + bounds > 0.0)  # the camera is inside the ball
    first = np.clip(np.floor(pixel - reach[:, None]), -1e6, 1e6).astype(np.int64)
    last = np.clip(np.ceil(pixel + reach[:, None]), -1e6, 1e6).astype(np.int64)
    size = np.array([camera.width, camera.height])
    first = np.where(whole[:, None], 0, np.maximum(first, 0))
    last = np.where(whole[:, None], size - 1, np.minimum(last, size - 1))
    gone = ~(whole | (nearest > 1e-6))
    last[gone] = -1
    return np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1).astype(np.int32)


def _triangles(
    vertices: Array, triangles: Ints, tint: Array, color: tuple[int, int, int], label: int, raster: Raster
) -> None:
    whole = np.all(np.isfinite(vertices[triangles]).reshape(len(triangles), -1), axis=1)
    triangles, tint = triangles[whole], tint[whole]
    if not len(triangles):
        return
    corners = vertices[triangles]
    wp.launch(
        rasterize.draw_triangles,
        dim=len(triangles),
        inputs=[
            wp.mat33(*raster.pixel_to_ray.ravel()),
            _vectors(vertices),
            _vectors(vertex_normals(vertices, triangles)),
            wp.array(np.ascontiguousarray(triangles, dtype=np.int32), dtype=int, ndim=2, device="cpu"),
            _rectangle_array(_triangle_rectangles(raster.camera, corners)),
            wp.array(np.asarray(tint, dtype=np.float32), dtype=float, device="cpu"),
            wp.vec3(*(c / 255.0 for c in color)),
            label,
            wp.vec3(*raster.light),
            raster.labels,
            raster.distance,
            raster.color,
        ],
        device="cpu",
    )


def _triangle_rectangles(camera: Camera, corners: Array) -> Ints:
    """Rectangles (k, 4) of triangles (k, 3, 3) relative to the camera: of their corners, or, near the camera, of the
    ball around them."""
    seen = corners @ np.asarray(camera.rotation).T
    centre = corners.mean(axis=1)
    found = rectangles(camera, centre, np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1))
    front = seen[..., 2].min(axis=1) > 1e-6
    image = seen[front] @ np.asarray(camera.intrinsics).T
    pixel = np.clip(image[..., :2] / image[..., 2:], -1e6, 1e6)
    first, last = np.floor(pixel.min(axis=1)), np.ceil(pixel.max(axis=1))
    size = np.array([camera.width, camera.height])
    first, last = np.maximum(first, 0).astype(np.int32), np.minimum(last, size - 1).astype(np.int32)
    found[front] = np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1)
    return found


def vertex_normals(vertices: Array, triangles: Ints) -> Array:
    """Unit normals (k, 3) at vertices: of the faces around, weighted by their areas."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    normals: Array = np.zeros_like(vertices)
    for axis in range(3):
        for corner in range(3):
            normals[:, axis] += np.bincount(triangles[:, corner], weights=face[:, axis], minlength=len(vertices))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return normals


def _tubes(
    rope: Rope,
    line: Array,
    number: NDArray[np.int64],
    segments: int,
    color: tuple[int, int, int],
    label: int,
    raster: Raster,
) -> None:
    ends = np.stack([line[:-1], line[1:]], axis=1)
    whole = np.all(np.isfinite(ends).reshape(len(ends), -1), axis=1)
    ends, number = ends[whole], number[whole]
    if not len(ends):
        return
    depth = (ends @ np.asarray(raster.camera.rotation)[2]).max(axis=1)
    radius = np.maximum(rope.radius, THINNEST * np.maximum(depth, 0.0) / raster.camera.intrinsics[0][0])
    wide = max(1, round(segments / STRIPES))
    tint = 1.0 - STRIPE * ((number // wide) % 2)
    middle, half = ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    wp.launch(
        rasterize.draw_tubes,
        dim=len(ends),
        inputs=[
            wp.mat33(*raster.pixel_to_ray.ravel()),
            _vectors(ends[:, 0]),
            _vectors(ends[:, 1]),
            wp.array(radius.astype(np.float32), dtype=float, device="cpu"),
            _rectangle_array(rectangles(raster.camera, middle, half + radius)),
            wp.array(tint.astype(np.float32), dtype=float, device="cpu"),
            wp.vec3(*(c / 255.0 for c in color)),
            label,
            wp.vec3(*raster.light),
            raster.labels,
            raster.distance,
            raster.color,
        ],
        device="cpu",
    )


def _checks(cloth: Cloth, mesh: DeformableMesh) -> Array:
    """Brightness (t,) of a sheet's triangles, in faint checks fixed to it; plain for other meshes."""
    geometry = cloth.geometry
    if not isinstance(geometry, Sheet):
        return np.ones(len(mesh.triangles))
    edges = np.stack([geometry.edge_u, geometry.edge_v], axis=1)
    lengths = np.linalg.norm(edges, axis=0)
    centres = mesh.nodes[mesh.triangles].mean(axis=1) - np.asarray(geometry.corner)
    shares = np.linalg.lstsq(edges, centres.T, rcond=None)[0]
    squares = np.floor(shares * lengths[:, None] * CHECKS / lengths.min())
    tint: Array = 1.0 - CHECK_CONTRAST * (squares.sum(axis=0) % 2)
    return tint


def _vectors(rows: Array) -> Any:
    return wp.array(np.ascontiguousarray(rows, dtype=np.float32), dtype=wp.vec3, device="cpu")


def _rectangle_array(rows: Ints) -> Any:
    return wp.array(np.ascontiguousarray(rows, dtype=np.int32), dtype=wp.vec4i, device="cpu")
