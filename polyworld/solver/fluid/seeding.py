"""Particles that fill a fluid's volumes at the start: a lattice, two along each edge of a cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.model.mesh import DeformableMesh
from polyworld.solver.fluid.clearance import clearance
from polyworld.solver.fluid.layout import PER_AXIS
from polyworld.solver.fluid.scene import thin_axis
from polyworld.world import World, geometry
from polyworld.world.representations.cloth import SurfaceMesh
from polyworld.world.representations.fluid import Fluid, FluidVolume
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere

Array = NDArray[np.float64]


def fluid_particles(world: World, item: Fluid) -> DeformableMesh:
    """Particles of one fluid at the start: nodes (k, 3), measure (k,) their equal volumes, radius (k,).

    Lattice points inside its volumes and the fluid grid, outside statics, rigid objects and soft bodies that are there
    from the start, and outside the volumes of fluids listed before it. The same world gives the same particles.
    """
    box = world.fluid_grid
    if box is None:
        raise ValueError(f"fluid {item.name!r} needs a fluid_grid")
    thin, h = thin_axis(world), box.cell
    spacing = h / PER_AXIS
    volume = spacing**3 if thin < 0 else spacing**2
    lower, upper = np.asarray(box.lower, dtype=float), np.asarray(box.upper, dtype=float)
    parts = [_lattice(world, v, lower, upper, spacing, thin) for v in item.volumes]
    points = np.concatenate([np.zeros((0, 3)), *parts])
    for i, part in enumerate(item.volumes[:-1]):  # where volumes overlap, the first one counts
        later = np.arange(len(points)) >= sum(len(p) for p in parts[: i + 1])
        points = points[~(later & _inside(part, points, thin))]
    for other in world.of_form("liquid"):
        if other.name == item.name:
            break
        for part in other.volumes:
            points = points[~_inside(part, points, thin)]
    for solid in world.of_form("solid"):
        if solid.start_time == 0.0 and not isinstance(solid.shape, SurfaceMesh):
            body = FluidVolume(shape=solid.shape, position=solid.position, orientation=solid.orientation)
            points = points[~_inside(body, points, thin)]
    points = points[clearance(world, points) > 0.0]
    count = len(points)
    return DeformableMesh(nodes=points, measure=np.full(count, volume), radius=np.full(count, spacing / 2))


@dataclass(frozen=True)
class Carving:
    """How much of a described volume holds no fluid at the start, as shares of it: in all, and by what covers it.

    volume: its place in the fluid's list. by: names of statics and objects, and "the sides of fluid_grid".
    """

    volume: int
    lost: float
    by: dict[str, float]


def carvings(world: World, item: Fluid) -> tuple[Carving, ...]:
    """Estimate what grid sides, statics and rigid objects take from each volume of a fluid, by even sampling."""
    box = world.fluid_grid
    if box is None:
        raise ValueError(f"fluid {item.name!r} needs a fluid_grid")
    thin = thin_axis(world)
    kept_axes = [axis for axis in range(3) if axis != thin]
    lower, upper = np.asarray(box.lower, dtype=float), np.asarray(box.upper, dtype=float)
    alone = [(s.name, world.model_copy(update={"statics": (s,), "objects": ()})) for s in world.statics]
    alone += [(o.name, world.model_copy(update={"statics": (), "objects": (o,)})) for o in world.objects]
    found = []
    for number, part in enumerate(item.volumes):
        points = _samples(world, part, thin)
        outside = ((points < lower) | (points > upper))[:, kept_axes].any(axis=1)
        covered = {"the sides of fluid_grid": outside}
        covered |= {name: ~outside & (clearance(one, points) <= 0.0) for name, one in alone}
        lost = float(np.any(list(covered.values()), axis=0).mean())
        found.append(Carving(number, lost, {name: float(c.mean()) for name, c in covered.items() if c.any()}))
    return tuple(found)


def _samples(world: World, part: FluidVolume, thin: int) -> Array:
    """Midpoints of equal cells of a volume's bounding box that lie in the volume (k, 3)."""
    shape, reach = part.shape, _reach(part)
    if isinstance(shape, Box):
        turn = geometry.quaternion_matrix(np.asarray(part.orientation, dtype=float) / np.linalg.norm(part.orientation))
        half = np.abs(turn) @ np.asarray(shape.half_extents, dtype=float)
    else:
        half = np.full(3, reach)
    number = 40 if thin < 0 else 200
    steps = (np.arange(number) + 0.5) / number * 2.0 - 1.0
    axes = [part.position[a] + half[a] * steps for a in range(3)]
    if thin >= 0:
        axes[thin] = np.array([world.environment.motion_plane.point[thin]])
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points[_inside(part, points, thin)]


def predicted_particles(world: World, item: Fluid) -> float:
    """Return how many lattice points the bounding boxes of a fluid's volumes hold within the grid: an upper estimate.

    They are what seeding it needs memory for.
    """
    box = world.fluid_grid
    if box is None:
        raise ValueError(f"fluid {item.name!r} needs a fluid_grid")
    spacing, thin = box.cell / PER_AXIS, thin_axis(world)
    axes = [axis for axis in range(3) if axis != thin]
    count = 0.0
    for part in item.volumes:
        low, high = _clipped(part, np.asarray(box.lower, dtype=float), np.asarray(box.upper, dtype=float))
        count += float(np.prod(np.maximum(high - low, 0.0)[axes] / spacing))
    return count


def _clipped(part: FluidVolume, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Lower and upper corner (3,) of a box that holds what of a volume is in the grid [m]."""
    reach = _reach(part)
    return np.maximum(np.asarray(part.position) - reach, lower), np.minimum(np.asarray(part.position) + reach, upper)


def _lattice(world: World, part: FluidVolume, lower: Array, upper: Array, spacing: float, thin: int) -> Array:
    """Points of the lattice inside one volume and the box."""
    low, high = _clipped(part, lower, upper)
    axes = []
    for axis in range(3):
        if axis == thin:
            axes.append(np.array([world.environment.motion_plane.point[axis]]))
            continue
        first = int(np.floor((low[axis] - lower[axis]) / spacing - 0.5))
        last = int(np.ceil((high[axis] - lower[axis]) / spacing + 0.5))
        line = lower[axis] + (np.arange(first, last + 1) + 0.5) * spacing
        axes.append(line[(line > lower[axis]) & (line < upper[axis])])
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points[_inside(part, points, thin)]


def _reach(part: FluidVolume) -> float:
    """Radius of a ball about its position that holds the volume."""
    shape = part.shape
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Box):
        return float(np.linalg.norm(shape.half_extents))
    if isinstance(shape, Cylinder):
        return float(np.hypot(shape.radius, shape.half_height))
    if isinstance(shape, Capsule):
        return shape.radius + shape.half_height
    return float(np.linalg.norm(geometry.hull(shape).vertices, axis=1).max())


def _inside(part: FluidVolume, points: Array, thin: int) -> NDArray[np.bool_]:
    """Whether points (k, 3) lie in a volume; in a plane, whether they lie in its cut through its centre."""
    turn = geometry.quaternion_matrix(np.asarray(part.orientation, dtype=float) / np.linalg.norm(part.orientation))
    away = points - np.asarray(part.position)
    if thin >= 0:
        away = away.copy()
        away[:, thin] = 0.0
    p = away @ turn
    shape = part.shape
    inside: NDArray[np.bool_]
    if isinstance(shape, Sphere):
        inside = np.linalg.norm(p, axis=1) <= shape.radius
    elif isinstance(shape, Box):
        inside = (np.abs(p) <= np.asarray(shape.half_extents)).all(axis=1)
    elif isinstance(shape, Cylinder):
        inside = (np.hypot(p[:, 0], p[:, 1]) <= shape.radius) & (np.abs(p[:, 2]) <= shape.half_height)
    elif isinstance(shape, Capsule):
        along = np.clip(p[:, 2], -shape.half_height, shape.half_height)
        inside = np.linalg.norm(p - along[:, None] * [0.0, 0.0, 1.0], axis=1) <= shape.radius
    else:
        assert isinstance(shape, ConvexMesh)
        hull = geometry.hull(shape)
        normals = np.asarray(hull.face_normals)
        offsets = np.einsum("fi,fi->f", normals, np.asarray(hull.triangles)[:, 0])
        inside = (p @ normals.T <= offsets).all(axis=1)
    return inside
