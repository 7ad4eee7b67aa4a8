"""Compare tracks with the world's floors, walls and other statics: who touches them, and who lies inside them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding, length, runs_listed
from polyworld.screening.tracks import Subject, Track
from polyworld.world import StaticObject, World, geometry
from polyworld.world.distances import distance_to_static, signed_distance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import BodyShape, Box, Capsule, Compound, Cylinder, Plane, Sphere

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

ACROSS = 1e-9  # component of a plane's normal below which the position along that axis does not matter
WAYS = 16  # directions in a motion plane in which a body's reach is looked at


def plane_normal(static: StaticObject) -> Array | None:
    """Return the outward unit normal (3,) of a plane, world axes; None for other shapes."""
    if not isinstance(static.shape, Plane):
        return None
    normal = np.asarray(static.shape.normal) / np.linalg.norm(static.shape.normal)
    return np.asarray(geometry.quaternion_matrix(np.asarray(static.orientation)) @ normal)


def inner_radius(world: World, item: RigidObject) -> float:
    """Return the radius [m] of a ball (planar worlds: disc) about the centre that the body certainly fills."""
    if isinstance(item.shape, Compound):
        return 0.0
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    if world.planar:
        angles = np.arange(WAYS) * (2.0 * np.pi / WAYS)
        inside = (
            np.stack([np.cos(angles), np.sin(angles)], axis=1) @ geometry.plane_axes(world.environment.motion_plane)[:2]
        )
        ways = inside @ geometry.quaternion_matrix(np.asarray(item.orientation))
    elif not isinstance(item.shape, Sphere | Box | Capsule | Cylinder):
        ways = np.asarray(geometry.hull(item.shape).face_normals)
    return float(_reach(item.shape, ways).min())


def _reach(shape: BodyShape, ways: Array) -> Array:
    """How far a body reaches from its centre in directions (T, 3) in body axes [m]."""
    if isinstance(shape, Compound):
        reaches = [_reach(p.shape, ways @ p.rotation) + ways @ p.position for p in geometry.pieces(shape)]
        return np.asarray(np.max(reaches, axis=0))
    if isinstance(shape, Sphere):
        return np.full(len(ways), shape.radius)
    if isinstance(shape, Box):
        return np.asarray(np.abs(ways) @ np.asarray(shape.half_extents))
    if isinstance(shape, Capsule | Cylinder):
        across = 1.0 if isinstance(shape, Capsule) else np.hypot(ways[:, 0], ways[:, 1])
        return np.asarray(np.abs(ways[:, 2]) * shape.half_height + shape.radius * across)
    return np.asarray((ways @ np.asarray(geometry.hull(shape).vertices).T).max(axis=1))


def clearance(world: World, item: RigidObject, static: StaticObject, track: Track) -> Array | None:
    """Return the least distance (T,) [m] of a body's surface from a static's, negative where the body lies inside.

    Exact for balls, and on planes for all shapes whose orientation was measured; else an upper bound, of the ball that
    the body certainly fills. NaN where a position that matters was not measured; None where `signed_distance` is.
    """
    places, normal = track.places, plane_normal(static)
    if world.planar:
        places = np.where(np.isfinite(places), places, np.asarray(item.position))
    if normal is not None:
        places = np.where(np.abs(normal) < ACROSS, 0.0, places)
    distance = signed_distance(static, places)
    if distance is None:
        return None
    known = np.isfinite(track.orientations).all(axis=1)
    reach = np.full(len(places), inner_radius(world, item))
    if normal is not None and known.any() and not world.planar:
        turns = geometry.quaternion_matrix(track.orientations[known])
        reach[known] = _reach(item.shape, -(np.swapaxes(turns, 1, 2) @ normal))
    gap: Array = distance - reach
    return gap


def touching(data: Subject, item: RigidObject, track: Track) -> Bools:
    """Return at which instants (T,) the surface may lie on that of a static: neither clear of it nor deep inside."""
    near = np.zeros(len(track.times), dtype=bool)
    outer, inner = geometry.circumscribed_radius(item.shape), inner_radius(data.world, item)
    slack = data.settings.significant * float(track.noise.max()) + data.settings.deep * outer
    for static in data.world.statics:
        gap = clearance(data.world, item, static, track)
        if gap is None:
            near |= distance_to_static(static, np.nan_to_num(track.places)) <= outer + slack
        else:
            near |= (gap >= -slack) & (gap <= outer - inner + slack)
    return near


def penetrating(data: Subject) -> Iterator[Finding]:
    """Caution where a body lies inside a static by much more than the noise in many samples."""
    settings, jointed = data.settings, {n for j in data.world.joints for n in (j.object, j.other)}
    for item in (o for o in data.world.objects if o.name not in jointed):
        own = [t for t in data.tracks if t.object == item.name]
        for static in data.world.statics:
            depths, runs, total = [np.zeros(0)], [], 0
            for track in own:
                gap = clearance(data.world, item, static, track)
                if gap is not None:
                    noise = settings.significant * float(track.noise[track.axes].max(initial=0.0))
                    deep = gap < -(noise + settings.deep * inner_radius(data.world, item))
                    total += int(np.count_nonzero(np.isfinite(gap)))
                    depths.append(-gap[deep])
                    runs += [track.run] * bool(deep.any())
            depth = np.concatenate(depths)
            if len(depth) >= max(settings.deep_least, settings.deep_share * total):
                yield Finding(
                    "penetration",
                    f"Tracks of {item.name} lie inside {static.name} by {length(float(np.median(depth)))} (median) in "
                    f"{len(depth)} samples of {runs_listed(runs)}: check its size, the place of {static.name}, and the "
                    "axes and the origin of the data, and correct whichever is wrong.",
                )
