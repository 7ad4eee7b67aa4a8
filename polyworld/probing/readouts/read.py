"""Read a readout off the motion of one world or of a whole batch of worlds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import DeformableMesh, mesh_of
from polyworld.probing.readouts import distribution
from polyworld.probing.readouts.centreline import nearest_on_polyline, resampled
from polyworld.probing.readouts.deformation import principal_stretches, reach
from polyworld.probing.readouts.kinds import (
    Amount,
    Centreline,
    Curve,
    Front,
    GridOccupancy,
    ImageOccupancy,
    Level,
    Markers,
    Outline,
    Readout,
    Stretch,
    Tension,
)
from polyworld.probing.readouts.material_points import MaterialPoints, material_points
from polyworld.probing.readouts.rope_line import rope_line
from polyworld.probing.readouts.silhouette import image_occupancy
from polyworld.trajectory import BatchTrajectory, PointMotion, Trajectory
from polyworld.world import Deformable, World, geometry
from polyworld.world.camera import Camera
from polyworld.world.materials import Form, kinds_of, material_of

Array = NDArray[np.float64]
Motion = Trajectory | BatchTrajectory


def read(readout: Readout, world: World, motion: Motion, observed: Array | None = None) -> Array:
    """Values (..., T, m, c) of a readout; the leading axis W is there for a batch. NaN where there is nothing.

    observed (T, m, c): the observation, for a readout that depends on it (`Curve`: points to be nearest to). Raises
    KeyError for an unknown object or container, ValueError where the object has no such readout, or the world no
    camera.
    """
    reader = _READERS[type(readout)]
    return reader(_Subject.of(world, motion, readout.object), readout, observed)


def check_readable(readout: Readout, world: World) -> None:
    """Raise ValueError or KeyError where `read` would for any motion of this world."""
    item = world.deformable(readout.object)
    form = material_of(item).form
    allowed = APPLIES[readout.kind]
    if form not in allowed:
        fitting = sorted(k for k, forms in APPLIES.items() if form in forms)
        raise ValueError(
            f"{readout.kind} is read off {' or '.join(kinds_of(*allowed))}, and {readout.object!r} is "
            f"{item.representation}; its readouts: {fitting}"
        )
    if _view(readout) == "image" and world.camera is None:
        raise ValueError(f"{readout.kind} of {readout.object!r} is in pixels, and the world has no camera")
    if isinstance(readout, Amount | Level) and readout.container is not None:
        distribution.container_named(world, readout.container)
    if isinstance(readout, Level) and world.planar and abs(_normal(world)[2]) > 0.5:
        raise ValueError(f"level is read off fluids that can stand: the motion plane of {readout.object!r} is level")


_SOLID: tuple[Form, ...] = ("line", "sheet", "solid")
_ALL: tuple[Form, ...] = (*_SOLID, "liquid")
APPLIES: dict[str, tuple[Form, ...]] = {
    "markers": _SOLID,
    "centreline": ("line",),
    "curve": ("line",),
    "outline": _ALL,
    "image_occupancy": _ALL,
    "grid_occupancy": ("liquid",),
    "amount": _ALL,
    "front": _ALL,
    "level": ("liquid",),
    "tension": ("line",),
    "stretch": ("sheet", "solid"),
}


def _view(readout: Readout) -> str:
    if isinstance(readout, ImageOccupancy):
        return "image"
    return str(getattr(readout, "view", "world"))


class _Subject:
    """One object of a motion, with what readouts need to know about it."""

    def __init__(self, world: World, motion: Motion, name: str) -> None:
        self.world, self.motion = world, motion
        self.item = world.deformable(name)
        if name not in motion.deformables:
            raise KeyError(f"the motion holds no points of {name!r}; it holds those of {sorted(motion.deformables)}")
        self.points: Array = motion.deformables[name].points

    @classmethod
    def of(cls, world: World, motion: Motion, name: str) -> _Subject:
        return cls(world, motion, name)

    @property
    def quantities(self) -> PointMotion:
        return self.motion.deformables[self.item.name]

    @property
    def line(self) -> Array:
        """Points of a rope's line, round its wheels."""
        return rope_line(self.world, self.motion, self.item.name)

    @property
    def mesh(self) -> DeformableMesh:
        return mesh_of(self.world, self.item)

    @property
    def substance(self) -> Array:
        return distribution.substance(self.world, self.item, self.mesh, self.points.shape[-2])

    def seen(self, view: str, points: Array) -> Array:
        """Points as they are, or as pixels."""
        return self.camera.project(points) if view == "image" else points

    @property
    def camera(self) -> Camera:
        if self.world.camera is None:
            raise ValueError(f"a readout of {self.item.name!r} is in pixels, and the world has no camera")
        return self.world.camera

    @property
    def planar_axis(self) -> int | None:
        if not self.world.planar:
            return None
        return int(np.argmax(np.abs(_normal(self.world))))


def _normal(world: World) -> Array:
    """Unit normal (3,) of the motion plane."""
    normal: Array = geometry.plane_axes(world.environment.motion_plane)[2]
    return normal


def thickness(item: Deformable, mesh: DeformableMesh) -> float:
    """How far the visible surface is from the points [m]: the radius of a rope or of a fluid's particles, else 0."""
    if material_of(item).form in ("sheet", "solid") or not len(mesh.radius):
        return 0.0
    return float(np.median(mesh.radius))


def _markers(subject: _Subject, readout: Markers, observed: Array | None) -> Array:
    del observed
    followed: MaterialPoints = material_points(subject.mesh, np.asarray(readout.at))
    return subject.seen(readout.view, followed.places(subject.points))


def _centreline(subject: _Subject, readout: Centreline, observed: Array | None) -> Array:
    del observed
    return resampled(subject.seen(readout.view, subject.line), readout.count)


def _curve(subject: _Subject, readout: Curve, observed: Array | None) -> Array:
    if observed is None:
        raise ValueError("a curve is read at observed points: give them")
    return nearest_on_polyline(subject.seen(readout.view, subject.line), observed)


def _outline(subject: _Subject, readout: Outline, observed: Array | None) -> Array:
    del observed
    directions = np.asarray(readout.directions)
    points = subject.seen(readout.view, subject.points)
    reached = reach(points, directions[:, : points.shape[-1]])
    radius = thickness(subject.item, subject.mesh)
    if readout.view == "image":
        middle = distribution.centre(subject.points, subject.substance)
        depth = subject.camera.to_camera(middle)[..., 2, None]
        return (reached + radius * subject.camera.intrinsics[0][0] / depth)[..., None]
    return (reached + radius)[..., None]


def _image_occupancy(subject: _Subject, readout: ImageOccupancy, observed: Array | None) -> Array:
    del observed
    shares = image_occupancy(subject.points, subject.mesh, subject.camera, readout.columns, readout.rows)
    return shares.reshape(*shares.shape[:-2], -1, 1)


def _grid_occupancy(subject: _Subject, readout: GridOccupancy, observed: Array | None) -> Array:
    del observed
    return distribution.grid_filling(
        subject.points,
        subject.substance,
        np.asarray(readout.lower),
        np.asarray(readout.upper),
        readout.cells,
        subject.planar_axis,
    )[..., None]


def _amount(subject: _Subject, readout: Amount, observed: Array | None) -> Array:
    del observed
    points = subject.points
    if readout.container is not None:
        box = distribution.container_named(subject.world, readout.container)
        points = distribution.in_container_axes(subject.world, subject.motion, box, points)
        lower, upper = box.lower, box.upper
    else:
        assert readout.lower is not None  # the readout's own check
        assert readout.upper is not None
        lower, upper = readout.lower, readout.upper
    edges = distribution.particle_edges(subject.world, subject.item, subject.substance)
    amount = distribution.amount_inside(points, subject.substance, edges, np.asarray(lower), np.asarray(upper))
    return amount[..., None, None]


def _front(subject: _Subject, readout: Front, observed: Array | None) -> Array:
    del observed
    direction = np.asarray(readout.direction)
    return distribution.front(subject.points, subject.substance, direction, readout.share)[..., None, None]


def _level(subject: _Subject, readout: Level, observed: Array | None) -> Array:
    grid = subject.world.fluid_grid
    assert grid is not None  # the world's own check: a fluid needs one
    if readout.container is None:
        lower, upper = grid.lower, grid.upper
        place = Amount(object=readout.object, lower=lower, upper=upper)
    else:
        box = distribution.container_named(subject.world, readout.container)
        lower, upper = box.lower, box.upper
        place = Amount(object=readout.object, container=box.name)
    extent = np.subtract(upper, lower)
    across = [extent[axis] for axis in (0, 1) if axis != subject.planar_axis]
    return _amount(subject, place, observed) / float(np.prod(across))


def _tension(subject: _Subject, readout: Tension, observed: Array | None) -> Array:
    del observed
    tension = subject.quantities.quantities.get("tension")
    if tension is None:
        raise ValueError(f"the motion of {readout.object!r} holds no tension")
    if readout.at is None:
        largest: Array = tension.max(axis=-1)
        return largest[..., None, None]
    segment = min(int(readout.at * tension.shape[-1]), tension.shape[-1] - 1)
    return tension[..., segment, None, None]


def _stretch(subject: _Subject, readout: Stretch, observed: Array | None) -> Array:
    del observed, readout
    mesh = subject.mesh
    stretches = principal_stretches(subject.points, mesh.nodes, mesh.measure)
    count = 2 if subject.planar_axis is not None or not len(mesh.tetrahedra) else 3
    return stretches[..., None, :count]


_READERS: dict[type, Callable[[_Subject, Any, Array | None], Array]] = {
    Markers: _markers,
    Centreline: _centreline,
    Curve: _curve,
    Outline: _outline,
    ImageOccupancy: _image_occupancy,
    GridOccupancy: _grid_occupancy,
    Amount: _amount,
    Front: _front,
    Level: _level,
    Tension: _tension,
    Stretch: _stretch,
}
