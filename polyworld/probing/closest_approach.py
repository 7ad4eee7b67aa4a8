"""How near the surfaces of two bodies come to each other over a stretch of a trajectory.

Distances are those between the shapes that the engine lets touch: the solids themselves in spatial worlds, their
outlines in the motion plane in planar ones, where a cylinder lying down is a prism of 16 sides.

At a given pose the gap is exact for balls, upright cylinders in planar worlds, capsules, boxes, walls, planes and
hulls of points, and good to `TOLERANCE` for cylinders in spatial worlds. Between two samples positions run along a
straight line and orientations along the shorter turn; the time is that of the smallest gap on that line next to
the nearest sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # whose parts load when they are first used
from numpy.typing import NDArray

from polyworld.probing.point_approach import point_gaps
from polyworld.solver.planar.scene import Outline, body_outline, static_outline
from polyworld.trajectory import Trajectory
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Cylinder, Plane, Sphere, TriangleMesh, Wall

Array = NDArray[np.float64]

TOLERANCE = 1e-7  # [m]
MOST_STEPS = 100


@dataclass(frozen=True)
class ClosestApproach:
    """The smallest gap between two surfaces [m], 0 where they touch or overlap, and when it is reached [s]."""

    gap: float
    time: float
    other: str

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {"gap_m": self.gap, "time": self.time, "with": self.other}


@dataclass(frozen=True)
class ConvexSet:
    """A convex set: `support` (its furthest point in a direction), grown by `sweep`, inside a ball of `bound`.

    half_space: outward unit normal and offset of a plane, instead.
    """

    support: Callable[[Array], Array]
    centre: Array
    sweep: float = 0.0
    bound: float = np.inf
    half_space: tuple[Array, float] | None = None


Place = Callable[[float], list[ConvexSet]]  # the convex pieces of a body at a time


def closest_approach(
    world: World, trajectory: Trajectory, a: str, b: str, interval: tuple[float, float]
) -> ClosestApproach | None:
    """The closest approach of object `a` to object or static `b` within `interval` [s], both ends included.

    None where there is no such distance: to a triangle mesh; in planar worlds also between bodies at different
    heights, which pass over each other, and to a surface parallel to the motion plane. Both must take part all
    the time and the trajectory cover the interval. Deformable objects are measured at the samples, by their points
    (`polyworld.probing.point_approach`). Raises KeyError for an unknown name.
    """
    if a in trajectory.deformables or b in trajectory.deformables:
        return _of_points(world, trajectory, a, b, interval)
    first, second = place_of(world, trajectory, a), place_of(world, trajectory, b)
    if first is None or second is None or (world.planar and not same_height(world, a, b)):
        return None
    times = trajectory.times
    inner = (times > interval[0]) & (times < interval[1])
    grid = np.unique(np.concatenate([[interval[0]], times[inner], [interval[1]]]))

    def gap(time: float) -> float:
        return _least(_gap, first(time), second(time))

    floor = np.array([_least(_lowest_gap, first(t), second(t)) for t in grid])
    best, at = np.inf, 0
    for k in np.argsort(floor, kind="stable"):
        if floor[k] > best or best == 0.0:
            break
        here = gap(float(grid[k]))
        if here < best:
            best, at = here, int(k)
    when = float(grid[at])
    for low, high in ((at - 1, at), (at, at + 1)):
        if best > 0.0 and low >= 0 and high < len(grid):
            ends = (grid[low], grid[high])
            found = scipy.optimize.minimize_scalar(gap, bounds=ends, method="bounded", options={"xatol": 1e-9})
            if found.fun < best:
                best, when = float(found.fun), float(found.x)
    return ClosestApproach(float(best), when, b)


def height(item: RigidObject, position: Array, orientation: Array, *, highest: bool) -> float:
    """Height (z) of the highest or lowest point of a rigid object at a pose [m]; orientation w, x, y, z."""
    up = np.array([0.0, 0.0, 1.0 if highest else -1.0])
    solids = _solids(item.shape, position, geometry.quaternion_matrix(orientation))
    return float(up[2] * max(s.support(up) @ up + s.sweep for s in solids))


def surface_gaps(world: World, trajectory: Trajectory, a: str, b: str, rows: NDArray[np.intp]) -> Array | None:
    """Gaps (n,) between the surfaces of object `a` and object or static `b` at some samples, 0 where they touch.

    None where there is no such distance, as for `closest_approach`.
    """
    if a in trajectory.deformables or b in trajectory.deformables:
        soft, other = (a, b) if a in trajectory.deformables else (b, a)
        return point_gaps(world, trajectory, soft, other, rows)
    first, second = place_of(world, trajectory, a), place_of(world, trajectory, b)
    if first is None or second is None or (world.planar and not same_height(world, a, b)):
        return None
    return np.array([_least(_gap, first(float(t)), second(float(t))) for t in trajectory.times[rows]])


def gap_to_statics(world: World, shape: geometry.Solid, position: Array, orientation: Array) -> float:
    """Gap between a solid at a pose (w, x, y, z) and the nearest fixed surface of a spatial world [m].

    0 where they touch or overlap, infinite where nothing is fixed. Triangle meshes are taken to touch: no distance to
    them is known.
    """
    solids = _solids(shape, position, geometry.quaternion_matrix(orientation))
    gaps = [np.inf]
    for item in world.statics:
        static = _static(world, item)
        gaps.append(0.0 if static is None else _least(_gap, solids, [static]))
    return float(min(gaps))


def _of_points(
    world: World, trajectory: Trajectory, a: str, b: str, interval: tuple[float, float]
) -> ClosestApproach | None:
    rows = np.flatnonzero((trajectory.times >= interval[0]) & (trajectory.times <= interval[1]))
    if not len(rows):  # shorter than a sample: the nearest one
        rows = np.array([int(np.argmin(np.abs(trajectory.times - interval[0])))])
    first, second = (a, b) if a in trajectory.deformables else (b, a)
    gaps = point_gaps(world, trajectory, first, second, rows)
    if gaps is None or not np.isfinite(gaps).any():
        return None
    at = int(np.nanargmin(gaps))
    return ClosestApproach(float(gaps[at]), float(trajectory.times[rows[at]]), b)


def place_of(world: World, trajectory: Trajectory, name: str) -> Place | None:
    """Return the body as a function of time; None where it has no surface to measure to."""
    static = next((s for s in world.statics if s.name == name), None)
    if static is not None:
        solid = _static(world, static)
        return None if solid is None else lambda _: [solid]
    item = world.object(name)
    column = trajectory.index(name)
    if not world.planar:
        return lambda time: _solids(item.shape, *_pose(trajectory, column, time))
    axes = geometry.plane_axes(world.environment.motion_plane)
    outline = body_outline(item, axes)
    back = geometry.quaternion_matrix(np.asarray(item.orientation)).T

    def there(time: float) -> list[ConvexSet]:
        position, rotation = _pose(trajectory, column, time)
        turn = axes[:2] @ rotation @ back @ axes[:2].T
        return [_points(outline.vertices @ turn.T + axes[:2] @ position, outline.sweep, axes[:2] @ position)]

    return there


def _static(world: World, item: StaticObject) -> ConvexSet | None:
    turn, position = geometry.quaternion_matrix(np.asarray(item.orientation)), np.asarray(item.position)
    if world.planar:
        plane = world.environment.motion_plane
        outline = static_outline(item, geometry.plane_axes(plane), np.asarray(plane.point))
        return None if outline is None else _flat_static(outline)
    if isinstance(item.shape, TriangleMesh):
        return None
    if isinstance(item.shape, Plane):
        normal = turn @ (np.asarray(item.shape.normal) / np.linalg.norm(item.shape.normal))
        return _half_space(normal, item.shape.offset + float(normal @ position))
    if isinstance(item.shape, Wall):
        box, centre, rotation = geometry.wall_box(item.shape)
        return _solid(box, turn @ centre + position, turn @ rotation)
    return _solid(item.shape, position, turn)


def _flat_static(outline: Outline) -> ConvexSet:
    if len(outline.vertices) == 0:
        return _half_space(np.array(outline.pose[:2]), outline.pose[2])
    centre = np.array(outline.pose[:2])
    return _points(outline.vertices + centre, outline.sweep, centre)


def same_height(world: World, a: str, b: str) -> bool:
    """Return whether two bodies of a planar world can meet: their extents along the plane's normal overlap."""
    plane = world.environment.motion_plane
    axes = geometry.plane_axes(plane)
    statics = {s.name: s for s in world.statics}
    outlines = [
        static_outline(statics[name], axes, np.asarray(plane.point))
        if name in statics
        else body_outline(world.object(name), axes)
        for name in (a, b)
    ]
    first, second = outlines
    return first is not None and second is not None and first.low < second.high and second.low < first.high


def _pose(trajectory: Trajectory, column: int, time: float) -> tuple[Array, Array]:
    """Position (3,) and rotation matrix (3, 3) at a time, on the line between two samples."""
    times = trajectory.times
    k = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, max(len(times) - 2, 0)))
    if not (trajectory.active[k, column] and len(times) > 1):  # it joins within this frame: where it joined
        k = min(k + 1, len(times) - 1)
        q = trajectory.orientations[k, column]
        late = time - times[k]
        position = trajectory.positions[k, column] + late * trajectory.velocities[k, column]
        return position, geometry.quaternion_matrix(q)
    share = (time - times[k]) / (times[k + 1] - times[k])
    p, q = trajectory.positions[:, column], trajectory.orientations[:, column]
    turned = (1 - share) * q[k] + share * q[k + 1] * (1.0 if q[k] @ q[k + 1] >= 0 else -1.0)
    return (1 - share) * p[k] + share * p[k + 1], geometry.quaternion_matrix(turned / np.linalg.norm(turned))


def _solids(shape: geometry.Solid, position: Array, rotation: Array) -> list[ConvexSet]:
    return [
        _solid(piece.shape, position + rotation @ piece.position, rotation @ piece.rotation)
        for piece in geometry.pieces(shape)
    ]


def _solid(shape: geometry.ConvexShape, position: Array, rotation: Array) -> ConvexSet:
    if isinstance(shape, Sphere):
        return _points(position[None], shape.radius, position)
    if isinstance(shape, Capsule):
        tip = rotation[:, 2] * shape.half_height
        return _points(np.stack([position - tip, position + tip]), shape.radius, position)
    if isinstance(shape, Cylinder):
        axis, radius, half = rotation[:, 2], shape.radius, shape.half_height

        def rim(direction: Array) -> Array:
            along = float(direction @ axis)
            across = direction - along * axis
            length = float(np.linalg.norm(across))
            out = across * (radius / length) if length > 1e-12 else np.zeros(3)
            return position + out + axis * (half if along >= 0 else -half)

        return ConvexSet(rim, position, 0.0, float(np.hypot(radius, half)))
    if isinstance(shape, Box):
        corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1).reshape(-1, 3)
        local = corners * np.asarray(shape.half_extents)
    else:
        local = np.asarray(geometry.hull(shape).vertices, dtype=float)
    return _points(local @ rotation.T + position, 0.0, position)


def _points(points: Array, sweep: float, centre: Array) -> ConvexSet:
    bound = float(np.linalg.norm(points - centre, axis=1).max()) + sweep
    return ConvexSet(lambda direction: points[int(np.argmax(points @ direction))], centre, sweep, bound)


def _half_space(normal: Array, offset: float) -> ConvexSet:
    def nowhere(direction: Array) -> Array:
        raise AssertionError(f"a half space reaches for ever in direction {direction}")

    return ConvexSet(nowhere, normal * offset, half_space=(normal, offset))


def _least(measure: Callable[[ConvexSet, ConvexSet], float], a: list[ConvexSet], b: list[ConvexSet]) -> float:
    return min(measure(p, q) for p in a for q in b)


def _lowest_gap(a: ConvexSet, b: ConvexSet) -> float:
    """A number no larger than the gap, from the balls around both."""
    if b.half_space is not None:
        normal, offset = b.half_space
        return float(normal @ a.centre) - offset - a.bound
    return float(np.linalg.norm(a.centre - b.centre)) - a.bound - b.bound


def _gap(a: ConvexSet, b: ConvexSet) -> float:
    """Distance of the surfaces of two convex bodies, 0 where they overlap [m]."""
    if b.half_space is not None:
        normal, offset = b.half_space
        return max(float(normal @ a.support(-normal)) - offset - a.sweep, 0.0)
    return max(_distance(a, b) - a.sweep - b.sweep, 0.0)


def _distance(a: ConvexSet, b: ConvexSet) -> float:
    """Distance of two convex sets given by their supports.

    The point of their difference nearest the origin is sought among the convex combinations of support points,
    to which the one furthest towards the origin is added until none is further (Gilbert, Johnson and Keerthi
    1988). The nearest combination is a non-negative least-squares problem: with the points as columns of P,
    |P x|^2 + (sum x - 1)^2 is least at a multiple of the weights sought (Lawson and Hanson 1974, ch. 23).
    """
    towards = b.centre - a.centre
    if not towards.any():
        towards = np.ones_like(towards)
    found = [a.support(towards) - b.support(-towards)]
    nearest = found[0]
    for _ in range(MOST_STEPS):
        distance = float(np.linalg.norm(nearest))
        if distance <= TOLERANCE:
            return 0.0
        point = a.support(-nearest) - b.support(nearest)
        if distance - float(nearest @ point) / distance <= TOLERANCE:
            return distance
        found.append(point)
        columns = np.stack(found, axis=1)
        rows = np.vstack([columns, np.ones(len(found))])
        weights, _ = scipy.optimize.nnls(rows, np.append(np.zeros(len(point)), 1.0))
        found = [p for p, weight in zip(found, weights, strict=True) if weight > 0]
        nearest = columns @ (weights / weights.sum())
    return float(np.linalg.norm(nearest))
