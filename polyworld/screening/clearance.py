"""Compare tracks with the world's floors, walls and other statics: who touches them, and who lies inside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding, length, runs_listed
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.tracks import Track
from polyworld.world import StaticObject, World, geometry
from polyworld.world.distances import distance_to_static, signed_distance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import BodyShape, Box, Capsule, Compound, Cylinder, Plane, Sphere

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

ACROSS = 1e-9  # component of a plane's normal below which the position along that axis does not matter


def plane_normal(static: StaticObject) -> Array | None:
    """Return the outward unit normal (3,) of a plane, world axes; None for other shapes."""
    if not isinstance(static.shape, Plane):
        return None
    normal = np.asarray(static.shape.normal) / np.linalg.norm(static.shape.normal)
    return np.asarray(geometry.quaternion_matrix(np.asarray(static.orientation)) @ normal)


def inner_radius(world: World, item: RigidObject) -> float:
    """Return the radius [m] of a ball (planar worlds: disc) about the centre that the body certainly fills."""
    if not world.planar:
        return _inner(item.shape)
    axes = geometry.plane_axes(world.environment.motion_plane)
    outline, disc = geometry.planar_outline(item.shape, geometry.quaternion_matrix(np.asarray(item.orientation)), axes)
    if len(outline) < 3:
        return float(disc)
    edges = np.roll(outline, -1, axis=0) - outline
    across = np.abs(edges[:, 0] * outline[:, 1] - edges[:, 1] * outline[:, 0]) / np.linalg.norm(edges, axis=1)
    return float(across.min() + disc)


def _inner(shape: BodyShape) -> float:
    if isinstance(shape, Sphere | Capsule):
        return shape.radius
    if isinstance(shape, Box):
        return float(min(shape.half_extents))
    if isinstance(shape, Cylinder):
        return min(shape.radius, shape.half_height)
    if isinstance(shape, Compound):
        return 0.0
    solid = geometry.hull(shape)
    return float(np.einsum("fk,fk->f", solid.face_normals, solid.triangles_center).min())


def clearance(world: World, item: RigidObject, static: StaticObject, track: Track) -> Array | None:
    """Return the least distance (T,) [m] of a body's surface from a static's, negative where the body lies inside.

    Exact for balls, and on planes for all shapes whose orientation was measured; else an upper bound, of the ball that
    the body certainly fills. NaN where a position that matters was not measured; None where `signed_distance` is.
    """
    places = track.places
    if world.planar:
        places = np.where(np.isfinite(places), places, np.asarray(item.position))
    normal = plane_normal(static)
    if normal is not None:
        places = np.where(np.abs(normal) < ACROSS, 0.0, places)
    distance = signed_distance(static, places)
    if distance is None:
        return None
    known = np.isfinite(track.orientations).all(axis=1)
    reach = np.full(len(places), inner_radius(world, item))
    if normal is not None and known.any() and not world.planar:
        turns = geometry.quaternion_matrix(track.orientations[known])
        reach[known] = _support(item.shape, -(np.swapaxes(turns, 1, 2) @ normal))
    gap: Array = distance - reach
    return gap


def _support(shape: BodyShape, ways: Array) -> Array:
    """How far a body reaches from its centre in directions (T, 3) in body axes [m]."""
    if isinstance(shape, Compound):
        reaches = [_support(p.shape, ways @ p.rotation) + ways @ p.position for p in geometry.pieces(shape)]
        return np.asarray(np.max(reaches, axis=0))
    if isinstance(shape, Sphere):
        return np.full(len(ways), shape.radius)
    if isinstance(shape, Box):
        return np.asarray(np.abs(ways) @ np.asarray(shape.half_extents))
    if isinstance(shape, Capsule):
        return np.asarray(np.abs(ways[:, 2]) * shape.half_height + shape.radius)
    if isinstance(shape, Cylinder):
        return np.asarray(np.abs(ways[:, 2]) * shape.half_height + np.hypot(ways[:, 0], ways[:, 1]) * shape.radius)
    return np.asarray((ways @ np.asarray(geometry.hull(shape).vertices).T).max(axis=1))


def touching(world: World, item: RigidObject, track: Track, settings: ScreenSettings) -> Bools:
    """Return at which instants (T,) the surface may lie on that of a static: neither clear of it nor deep inside."""
    near = np.zeros(len(track.times), dtype=bool)
    outer = geometry.circumscribed_radius(item.shape)
    slack = settings.significant * float(track.noise.max()) + settings.deep * outer
    for static in world.statics:
        gap = clearance(world, item, static, track)
        if gap is None:
            near |= distance_to_static(static, np.nan_to_num(track.places)) <= outer + slack
        else:
            near |= (gap >= -slack) & (gap <= outer - inner_radius(world, item) + slack)
    return near


def penetration_findings(world: World, tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where a body lies inside a static by much more than the noise in many samples."""
    found = []
    jointed = {n for j in world.joints for n in (j.object, j.other)}
    for item in world.objects:
        own = [t for t in tracks if t.object == item.name]
        if not own or item.name in jointed:
            continue
        allowed = settings.deep * inner_radius(world, item)
        for static in world.statics:
            depths, runs, total = [], [], 0
            for track in own:
                gap = clearance(world, item, static, track)
                if gap is None:
                    continue
                deep = gap < -(settings.significant * float(track.noise[list(track.axes)].max()) + allowed)
                total += int(np.count_nonzero(np.isfinite(gap)))
                if deep.any():
                    depths.append(-gap[deep])
                    runs.append(track.run)
            count = sum(len(d) for d in depths)
            if count < max(settings.deep_least, settings.deep_share * total):
                continue
            depth = float(np.median(np.concatenate(depths)))
            sentence = (
                f"Tracks of {item.name} lie inside {static.name} by {length(depth)} (median) in {count} samples of "
                f"{runs_listed(runs)}: check its size, the place of {static.name}, and the axes and the origin of the "
                "data, and correct whichever is wrong."
            )
            found.append(Finding("penetration", "caution", sentence))
    return found
