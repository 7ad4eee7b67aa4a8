"""Where an object's substance is: amounts in boxes and containers, filling of a grid, fronts.

Particles of a fluid are taken as cubes of their volume, so that an amount changes smoothly as one crosses a border;
nodes of other objects are points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.model import DeformableMesh
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import Deformable, World, geometry
from polyworld.world.materials import PLANAR, material_of
from polyworld.world.representations.fluid import Container

Array = NDArray[np.float64]


def substance(world: World, item: Deformable, mesh: DeformableMesh, count: int) -> Array:
    """Length, area or volume (count,) that each point of an object stands for.

    Particles that an emitter makes are like those that were there at first, or fill a cell evenly.
    """
    measure = mesh.measure
    if len(measure) >= count:
        return measure[:count]
    if len(measure):
        one = float(np.median(measure))
    else:
        assert world.fluid_grid is not None  # the world's own check: a fluid needs one
        one = (world.fluid_grid.cell / 2.0) ** (2 if item.representation.endswith(PLANAR) else 3)
    return np.concatenate([measure, np.full(count - len(measure), one)])


def particle_edges(world: World, item: Deformable, substances: Array) -> Array:
    """Edges (k, 3) [m] of the cubes that particles are taken for; 0 across a motion plane and for other objects."""
    edges = np.zeros((len(substances), 3))
    if material_of(item).form != "liquid":
        return edges
    if item.representation.endswith(PLANAR):
        across = np.abs(geometry.plane_axes(world.environment.motion_plane)[2])
        edges[:] = np.sqrt(substances)[:, None] * (across < 0.5)
        return edges
    edges[:] = np.cbrt(substances)[:, None]
    return edges


def share_inside(points: Array, edges: Array, lower: Array, upper: Array) -> Array:
    """Share (..., k) of each particle, a cube with edges (k, 3) at points (..., k, 3), inside a box; 0 for NaN."""
    share = np.ones(points.shape[:-1])
    for axis in range(3):
        x, edge = points[..., axis], edges[:, axis]
        with np.errstate(invalid="ignore"):
            inside = ((x >= lower[axis]) & (x <= upper[axis])).astype(float)
            if edge.any():
                width = np.where(edge > 0.0, edge, 1.0)
                overlap = np.minimum(x + edge / 2, upper[axis]) - np.maximum(x - edge / 2, lower[axis])
                inside = np.where(edge > 0.0, np.clip(overlap / width, 0.0, 1.0), inside)
        share *= np.nan_to_num(inside, nan=0.0)
    return share


def amount_inside(points: Array, substances: Array, edges: Array, lower: Array, upper: Array) -> Array:
    """Amount (...) of points (..., k, 3) inside a box."""
    amount: Array = share_inside(points, edges, np.asarray(lower), np.asarray(upper)) @ substances
    return amount


def in_container_axes(
    world: World, trajectory: Trajectory | BatchTrajectory, container: Container, points: Array
) -> Array:
    """Points (..., T, k, 3) as seen from a container that moves with its object: where they would be at the start."""
    if container.object is None:
        return points
    item = world.object(container.object)
    column = trajectory.names.index(container.object)
    begin = geometry.quaternion_matrix(np.asarray(item.orientation))
    now = geometry.quaternion_matrix(trajectory.orientations[..., column, :])
    turn = begin @ np.swapaxes(now, -1, -2)
    offset = points - trajectory.positions[..., column, None, :]
    moved: Array = offset @ np.swapaxes(turn, -1, -2) + np.asarray(item.position)
    return moved


def container_named(world: World, name: str) -> Container:
    """The container called `name`; raises KeyError naming the valid choices."""
    for container in world.containers:
        if container.name == name:
            return container
    raise KeyError(f"unknown container {name!r}; containers: {[c.name for c in world.containers]}")


def grid_filling(
    points: Array, substances: Array, lower: Array, upper: Array, cells: tuple[int, int, int], planar_axis: int | None
) -> Array:
    """Compute the filled share (..., nx ny nz) of the cells of a box, z fastest, at most 1; points (..., k, 3).

    Each particle is a cube of its volume and belongs to the cells in proportion to what of it is in them; cubes larger
    than a cell are taken for cells. planar_axis: the world axis across the motion plane, along which nothing is
    resolved and sizes do not count.
    """
    shape = np.asarray(cells)
    size = (np.asarray(upper) - np.asarray(lower)) / shape
    flat = points.reshape(-1, *points.shape[-2:])
    place = (flat - np.asarray(lower)) / size
    known: NDArray[np.bool_] = np.isfinite(place).all(axis=-1)
    if planar_axis is not None:
        place[..., planar_axis] = 0.5
    place = np.where(known[..., None], place, -9.0)
    edge = substances ** (1.0 / 3.0 if planar_axis is None else 0.5)
    half = np.minimum(0.5 * edge[:, None] / size, 0.5)
    base = np.floor(place - half).astype(np.int64)
    part = np.clip((place + half - (base + 1)) / (2.0 * half), 0.0, 1.0)
    filled = np.zeros((len(flat), int(shape.prod())))
    rows = np.broadcast_to(np.arange(len(flat))[:, None], base.shape[:-1])
    content = np.where(known, substances, 0.0)
    for corner in np.ndindex(2, 2, 2):
        index = base + np.asarray(corner)
        weight = np.prod(np.where(np.asarray(corner) == 1, part, 1.0 - part), axis=-1) * content
        inside = np.all((index >= 0) & (index < shape), axis=-1)
        cell = (index[..., 0] * shape[1] + index[..., 1]) * shape[2] + index[..., 2]
        flat_index = rows[inside] * filled.shape[1] + cell[inside]
        filled += np.bincount(flat_index, weights=weight[inside], minlength=filled.size).reshape(filled.shape)
    volume = float(np.prod(np.delete(size, planar_axis))) if planar_axis is not None else float(np.prod(size))
    share: Array = np.minimum(filled / volume, 1.0)
    return share.reshape(*points.shape[:-2], -1)


def front(points: Array, substances: Array, direction: Array, share: float) -> Array:
    """Coordinate (...) along a direction below which `share` of points (..., k, 3) lies; NaN where nothing is there."""
    along = points @ (np.asarray(direction) / np.linalg.norm(direction))
    if share >= 1.0:
        highest = np.max(np.where(np.isfinite(along), along, -np.inf), axis=-1)
        return np.where(np.isfinite(highest), highest, np.nan)
    order = np.argsort(along, axis=-1)  # NaN last
    sorted_along = np.take_along_axis(along, order, axis=-1)
    weight = np.where(np.isfinite(sorted_along), substances[order], 0.0)
    cumulated = np.cumsum(weight, axis=-1)
    total = cumulated[..., -1:]
    # A point's own substance is spread about it: its middle lies half-way up its step.
    middle = cumulated - 0.5 * weight
    target = share * total
    after = np.clip((middle < target).sum(axis=-1, keepdims=True), 1, along.shape[-1] - 1)
    low, high = (np.take_along_axis(middle, i, axis=-1) for i in (after - 1, after))
    a, b = (np.take_along_axis(sorted_along, i, axis=-1) for i in (after - 1, after))
    b = np.where(np.isfinite(b), b, a)
    part = np.clip(np.where(high > low, (target - low) / np.where(high > low, high - low, 1.0), 0.0), 0.0, 1.0)
    found: Array = (a + part * (b - a))[..., 0]
    return np.where(total[..., 0] > 0.0, found, np.nan)


def centre(points: Array, substances: Array) -> Array:
    """Centre of mass (..., 3) of the points (..., k, 3) that are there; NaN where none is."""
    known: NDArray[np.bool_] = np.asarray(np.isfinite(points).all(axis=-1))
    weight = np.where(known, substances, 0.0)
    total = weight.sum(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle: Array = (np.where(known[..., None], points, 0.0) * weight[..., None]).sum(axis=-2) / total
    return middle
