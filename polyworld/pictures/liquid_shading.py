"""Fluids in a picture: particles drawn as balls, their nearest surface smoothed, and shaded as water is.

The way of screen-space fluids (van der Laan, Green and Sainz 2009): the depth of the nearest balls is smoothed
where it is continuous, its normals shade the surface, and the length of the ray inside the fluid colours what is
seen through it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, distance_transform_edt, gaussian_filter

from polyworld.pictures import rasterize
from polyworld.pictures.deformable_pictures import Raster, rectangles
from polyworld.world import World
from polyworld.world.camera import Camera
from polyworld.world.colors import rgb
from polyworld.world.materials import material_of
from polyworld.world.representations.fluid import FluidGrid

Array = NDArray[np.float64]

BALL = 0.85  # radius of a drawn particle, in spacings of the particles
SMOOTH = 1.6  # width of the smoothing, in radii of a drawn particle
OPAQUE = 12.0  # spacings of fluid after which hardly anything behind is seen
SLICE = 8.0  # spacings that a planar fluid seems to be thick
SEEN_THROUGH = 0.55  # weight of a hollow or static thing's own colour where a fluid is behind it
WATER = (64, 140, 210)
SKY = np.array([0.93, 0.96, 1.0])


@dataclass(frozen=True)
class Liquid:
    """Fluids as the camera sees them: distance along the ray (H, W) [m], inf where there is none; thickness [m];
    index of the nearest fluid (H, W) among the deformables, -1 where none; colour (3,) of each by index."""

    distance: Array
    thickness: Array
    nearest: NDArray[np.int32]
    colors: dict[int, Array]
    spacing: float


def liquid_seen(
    world: World, points: Mapping[str, Array], camera: Camera, pixel_to_ray: Array, hidden: set[str]
) -> Liquid | None:
    """Every fluid of a world by itself, as if nothing else were there; None where none is in the picture."""
    fluids = [
        (i, d) for i, d in enumerate(world.deformables) if material_of(d).form == "liquid" and d.name not in hidden
    ]
    if not fluids or world.fluid_grid is None:
        return None
    shape = (camera.height, camera.width)
    distance: Any = wp.full(shape, 1.0e30, dtype=float, device="cpu")
    thickness: Any = wp.zeros(shape, dtype=float, device="cpu")
    nearest: Any = wp.full(shape, -1, dtype=int, device="cpu")
    spacing = world.fluid_grid.cell / 2.0
    colors: dict[int, Array] = {}
    for index, fluid in fluids:
        places = np.asarray(points[fluid.name], dtype=float)
        places = places[np.all(np.isfinite(places), axis=1)] - camera.centre
        colors[index] = np.array(rgb(fluid.appearance.color) or WATER) / 255.0
        if not len(places):
            continue
        wp.launch(
            rasterize.splat_balls,
            dim=len(places),
            inputs=[
                wp.mat33(*pixel_to_ray.ravel()),
                wp.array(np.ascontiguousarray(places, dtype=np.float32), dtype=wp.vec3, device="cpu"),
                BALL * spacing,
                wp.array(
                    rectangles(camera, places, np.full(len(places), BALL * spacing)), dtype=wp.vec4i, device="cpu"
                ),
                index,
                distance,
                thickness,
                nearest,
            ],
            device="cpu",
        )
    found = nearest.numpy()
    if not (found >= 0).any():
        return None
    far = np.where(found >= 0, distance.numpy().astype(float), np.inf)
    thick = thickness.numpy().astype(float)
    if world.planar:  # a slice: as if it went on across the plane
        thick *= SLICE
    width = 1.4 * BALL * spacing * camera.intrinsics[0][0] / float(np.median(far[found >= 0]))
    found, far, thick = _without_gaps(found, far, thick, width)
    if world.fluid_grid.closed:
        # Balls stand out of the walls that hold the fluid: rays meet it in the box only.
        enter = _into_box(world.fluid_grid, camera, pixel_to_ray)
        through = np.isfinite(enter)
        found, far = np.where(through, found, -1), np.where(through, np.maximum(far, enter), np.inf)
    if not (found >= 0).any():
        return None
    # Balls of this size overlap: their summed length counts the fluid about so many times.
    overlap = 4.0 / 3.0 * np.pi * BALL**3
    return Liquid(far, thick / overlap, found.astype(np.int32), colors, spacing)


def _without_gaps(found: Any, far: Array, thick: Array, width: float) -> tuple[Any, Array, Array]:
    """The same with gaps between balls, no wider than `width` [px], taken from the nearest ball."""
    reach = max(1, round(width))
    disc = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= width
    inside = found >= 0
    gaps = binary_closing(inside, disc) & ~inside
    if not gaps.any():
        return found, far, thick
    nearest: Any = distance_transform_edt(~inside, return_distances=False, return_indices=True)
    rows, columns = nearest
    found, far, thick = (np.where(gaps, values[rows, columns], values) for values in (found, far, thick))
    return found, far, thick


def _into_box(grid: FluidGrid, camera: Camera, pixel_to_ray: Array) -> Array:
    """Distance (H, W) [m] at which the ray of each pixel enters a grid's box, inf where it misses: the slab test."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ pixel_to_ray.T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (np.asarray(grid.lower) - camera.centre) / rays
        b = (np.asarray(grid.upper) - camera.centre) / rays
    enter, leave = np.fmin(a, b).max(axis=-1), np.fmax(a, b).min(axis=-1)
    inside: Array = np.where((enter <= leave) & (leave > 0.0), np.maximum(enter, 0.0), np.inf)
    return inside


def with_liquid(liquid: Liquid, raster: Raster, color: Array, opaque: Array, through: NDArray[np.bool_]) -> Array:
    """Colours (H, W, 3) in 0..1 with the fluids laid over, or shown through, what was drawn before.

    color, opaque: colour and distance along the ray [m] of all but the fluids. through (H, W): pixels whose
    nearest thing lets a fluid behind it be guessed: walls of tanks, hollow bodies.
    """
    rows, columns = np.nonzero(liquid.nearest >= 0)
    margin = 24
    top, bottom = max(int(rows.min()) - margin, 0), min(int(rows.max()) + margin + 1, color.shape[0])
    left, right = max(int(columns.min()) - margin, 0), min(int(columns.max()) + margin + 1, color.shape[1])
    cut = (slice(top, bottom), slice(left, right))
    inside = liquid.nearest[cut] >= 0
    focal = raster.camera.intrinsics[0][0]
    depth = float(np.median(liquid.distance[cut][inside]))
    radius = BALL * liquid.spacing * focal / depth  # [px]
    surface = smoothed(np.where(inside, liquid.distance[cut], 0.0), inside, SMOOTH * radius, 4.0 * liquid.spacing)
    rays = _rays(raster, cut)
    normal = _normals(rays * surface[..., None], inside)
    weight = np.maximum(gaussian_filter(inside.astype(float), 0.7 * radius), 1e-6)
    thick = gaussian_filter(liquid.thickness[cut], 0.7 * radius) / weight
    own = np.zeros((*inside.shape, 3))
    for index, value in liquid.colors.items():
        share = gaussian_filter((liquid.nearest[cut] == index).astype(float), 0.7 * radius) / weight
        own += share[..., None] * value
    behind = _bent(color[cut], normal, raster, thick, liquid.spacing, radius)
    # Beer and Lambert: what the fluid's colour lacks is absorbed on the way.
    passed = np.exp(-(3.0 / OPAQUE) * (thick / liquid.spacing)[..., None] * (1.15 - own))
    toward = -rays
    facing = np.clip((normal * toward).sum(axis=-1), 0.0, 1.0)[..., None]
    lit = 0.45 + 0.55 * np.clip((normal * raster.light).sum(axis=-1), 0.0, 1.0)[..., None]
    murky = 1.0 - np.exp(-(1.4 / OPAQUE) * (thick / liquid.spacing))[..., None]
    water = behind * passed * (1.0 - 0.75 * murky) + own * lit * (0.12 + 0.63 * murky)
    reflected = 0.04 + 0.6 * (1.0 - facing) ** 5
    half = toward + raster.light
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    glint = 0.55 * np.clip((normal * half).sum(axis=-1), 0.0, 1.0)[..., None] ** 80
    water = water * (1.0 - reflected) + SKY * reflected + glint
    in_front = inside & (liquid.distance[cut] < opaque[cut])
    seen_through = inside & ~in_front & through[cut]
    result: Array = color.copy()
    part = result[cut]
    # The rim of the water is the rim of balls: let it fade over a pixel or two.
    edge = np.clip(gaussian_filter(inside.astype(float), 0.6) * 2.0 - 1.0, 0.35, 1.0)[..., None]
    part[in_front] = (water * edge + color[cut] * (1.0 - edge))[in_front]
    part[seen_through] = (SEEN_THROUGH * color[cut] + (1.0 - SEEN_THROUGH) * water)[seen_through]
    return np.clip(result, 0.0, 1.0)


def smoothed(values: Array, inside: NDArray[np.bool_], width: float, step: float) -> Array:
    """Values (H, W) averaged over neighbours within about `width` [px] that differ by less than `step`; where
    `inside` alone. A bilateral filter, one direction after the other, twice."""
    reach = int(np.clip(round(width), 1, 10))
    shares = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(width / 1.5, 0.5)) ** 2)
    current = values.copy()
    for _ in range(2):
        for axis in (1, 0):
            total, weights = np.zeros_like(current), np.zeros_like(current)
            for offset, share in zip(range(-reach, reach + 1), shares, strict=True):
                moved, there = np.roll(current, offset, axis), np.roll(inside, offset, axis)
                alike = there * share * np.exp(-(((moved - current) / step) ** 2))
                total += alike * moved
                weights += alike
            current = np.where(inside, total / np.maximum(weights, 1e-12), 0.0)
    return current


def _rays(raster: Raster, cut: tuple[slice, slice]) -> Array:
    columns = np.arange(raster.camera.width)[cut[1]]
    rows = np.arange(raster.camera.height)[cut[0]]
    u, v = np.meshgrid(columns, rows)
    rays: Array = np.stack([u, v, np.ones_like(u)], axis=-1) @ raster.pixel_to_ray.T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return rays


def _normals(places: Array, inside: NDArray[np.bool_]) -> Array:
    """Unit normals (H, W, 3) of a surface of points (H, W, 3), towards the camera; the flatter side at a step."""
    slopes = []
    for axis in (1, 0):
        ahead = np.roll(places, -1, axis) - places
        back = places - np.roll(places, 1, axis)
        there, before = np.roll(inside, -1, axis), np.roll(inside, 1, axis)
        take_ahead = there & (~before | (np.linalg.norm(ahead, axis=-1) <= np.linalg.norm(back, axis=-1)))
        slopes.append(np.where(take_ahead[..., None], ahead, back))
    normal = np.cross(slopes[1], slopes[0])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
    away = (normal * places).sum(axis=-1) > 0.0
    normal[away] *= -1.0
    return normal


def _bent(color: Array, normal: Array, raster: Raster, thick: Array, spacing: float, radius: float) -> Array:
    """Shift the colours behind a liquid as its surface, where oblique to the view, refracts them."""
    rotation = np.asarray(raster.camera.rotation)
    lateral = normal @ rotation[:2].T
    strength = np.minimum(thick / spacing, 8.0) * radius * 0.35
    rows, columns = np.indices(thick.shape)
    u = np.clip(np.rint(columns - lateral[..., 0] * strength), 0, thick.shape[1] - 1).astype(int)
    v = np.clip(np.rint(rows - lateral[..., 1] * strength), 0, thick.shape[0] - 1).astype(int)
    shifted: Array = color[v, u]
    return shifted
