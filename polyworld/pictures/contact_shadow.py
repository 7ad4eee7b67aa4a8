"""Soft dark footprints on the floor under objects near it: they show what stands where, and what is in the air."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polyworld.pictures.render import Picture
from polyworld.pictures.rigid_pictures import frame_about
from polyworld.world import World, geometry
from polyworld.world.camera import Camera
from polyworld.world.materials import material_of
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

DARKEST = 0.55  # of the floor's light is taken away under an object that stands on it
SOFT = 0.35  # width of the shadow's edge, in sizes of the object
LEVEL = 0.7  # least cosine between a floor's normal and the way up
SHEER = 0.6  # of that darkness, under what is soft and thin


def with_contact_shadows(
    world: World,
    positions: Array,
    orientations: Array,
    camera: Camera,
    picture: Picture,
    *,
    points: Mapping[str, Array] | None = None,
    visible: Sequence[bool] | None = None,
) -> NDArray[np.uint8]:
    """The colours (H, W, 3) of a picture of the world by this camera, with a footprint under each object near a floor.

    Floors are static planes, and the plane a planar world slides on, that lie across gravity. An object's shadow
    is its silhouette seen along the floor's normal, with a soft edge; it fades as the object rises and is gone
    one size of the object (the largest reach of its silhouette) above the floor. Ropes, cloth and soft bodies
    darken the floor near those of their points that are low; fluids do not. Arguments as in `render`.
    """
    color = picture.color.astype(float)
    for label, foot, normal in _floors(world):
        rows, columns = np.nonzero(picture.labels == label)
        if not len(rows):
            continue
        places = _points(camera, rows, columns, picture.depth[rows, columns])
        light = np.ones(len(rows))
        axes = frame_about(normal).T
        for index, item in enumerate(world.objects):
            place = np.asarray(positions[index], dtype=float)
            if (visible is not None and not visible[index]) or not np.all(np.isfinite(place)):
                continue
            rotation = geometry.quaternion_matrix(np.asarray(orientations[index], dtype=float))
            outline, radius = geometry.planar_outline(item.shape, rotation, axes)
            size = radius + float(np.linalg.norm(outline, axis=1).max())
            height = float((place - foot) @ normal) - _depth_below(item.shape, rotation, axes)
            strength = DARKEST * float(np.clip(1.0 - max(height, 0.0) / size, 0.0, 1.0))
            if strength == 0.0:
                continue
            flat = (places - place) @ axes[:2].T
            near = np.flatnonzero(np.linalg.norm(flat, axis=1) < size * (1.0 + SOFT))
            outside = _distance_outside(flat[near], outline) - radius
            light[near] *= 1.0 - strength * np.clip(1.0 - outside / (SOFT * size), 0.0, 1.0) ** 2
        for index, soft in enumerate(world.deformables, start=len(world.objects)):
            nodes = None if material_of(soft).form == "liquid" else (points or {}).get(soft.name)
            if nodes is not None and (visible is None or visible[index]):
                light *= _under_points(nodes - foot, places - foot, axes)
        color[rows, columns] *= light[:, None]
    shaded: NDArray[np.uint8] = np.clip(np.rint(color), 0, 255).astype(np.uint8)
    return shaded


def _under_points(nodes: Array, floor: Array, axes: Array) -> Array:
    """Share (k,) of the light left on floor points (k, 3) under nodes (m, 3), both from a point of the floor."""
    size = 0.25 * float(np.linalg.norm(np.ptp(nodes, axis=0)))
    height = nodes @ axes[2]
    low = (height < size) & np.all(np.isfinite(nodes), axis=1)
    light: Array = np.ones(len(floor))
    if size <= 0.0 or not low.any():
        return light
    distance, nearest = cKDTree(nodes[low] @ axes[:2].T).query(floor @ axes[:2].T, distance_upper_bound=SOFT * size)
    close = np.isfinite(distance)
    strength = SHEER * DARKEST * (1.0 - np.clip(height[low][nearest[close]] / size, 0.0, 1.0))
    light[close] -= strength * (1.0 - distance[close] / (SOFT * size)) ** 2
    return light


def _floors(world: World) -> list[tuple[int, Array, Array]]:
    """Label, a point and the unit normal of every plane that lies across gravity, as `render` labels them."""
    gravity = np.asarray(world.environment.gravity, dtype=float)
    pull = float(np.linalg.norm(gravity))
    up = -gravity / pull if pull > 0.0 else np.array([0.0, 0.0, 1.0])
    found: list[tuple[int, Array, Array]] = []
    for index, static in enumerate(world.statics):
        if isinstance(static.shape, Plane):
            turned = geometry.quaternion_matrix(np.asarray(static.orientation)) @ np.asarray(static.shape.normal)
            normal = turned / np.linalg.norm(turned)
            foot = np.asarray(static.position, dtype=float) + normal * static.shape.offset
            found.append((len(world.moving_names) + index, foot, normal))
    plane = world.environment.motion_plane
    normal = np.asarray(plane.normal, dtype=float) / np.linalg.norm(plane.normal)
    found.append((len(world.moving_names) + len(world.statics), np.asarray(plane.point, dtype=float), normal))
    return [floor for floor in found if floor[2] @ up > LEVEL]


def _points(camera: Camera, rows: NDArray[np.int64], columns: NDArray[np.int64], depth: NDArray[np.float32]) -> Array:
    """World points (k, 3) [m] that pixels show at depths along the camera's axis."""
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=1) @ np.linalg.inv(np.asarray(camera.intrinsics)).T
    seen: Array = camera.centre + (rays * depth[:, None].astype(float)) @ np.asarray(camera.rotation)
    return seen


def _depth_below(shape: geometry.Solid, rotation: Array, axes: Array) -> float:
    """How far a shape reaches below its centre, against the third axis [m]."""
    sideways = np.stack([axes[0], axes[2], -axes[1]])  # seen from the side, the normal is the second axis
    outline, radius = geometry.planar_outline(shape, rotation, sideways)
    return radius - float(outline[:, 1].min())


def _distance_outside(points: Array, outline: Array) -> Array:
    """Distance (k,) of points (k, 2) from a convex polygon (m, 2), counter-clockwise; 0 inside. m may be 1 or 2."""
    if not len(points):
        return np.zeros(0)
    start, end = outline, np.roll(outline, -1, axis=0)
    along = end - start
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    away = points[:, None] - start
    part = np.clip((away * along).sum(axis=2) / length, 0.0, 1.0)
    distance: Array = np.linalg.norm(away - part[..., None] * along, axis=2).min(axis=1)
    if len(outline) > 2:
        left = along[:, 0] * away[..., 1] - along[:, 1] * away[..., 0]
        distance = np.where(np.all(left >= 0.0, axis=1), 0.0, distance)
    return distance
