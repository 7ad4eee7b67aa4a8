"""Fluids driven without the coupled simulator: a clock, and rigid bodies under gravity alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.core import buffers
from polyworld.model import model_of
from polyworld.solver.coupled.nodes import Clock
from polyworld.solver.fluid.solver import FluidSolver
from polyworld.solver.spatial.layout import Body
from polyworld.world import Environment, MotionPlane, StaticObject, World, geometry
from polyworld.world.representations.fluid import Drain, Emitter, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box

Array = NDArray[np.float64]

GRAVITY = 9.81


def pool(name: str, lower: tuple[float, float], upper: tuple[float, float], **parameters: Any) -> Fluid:
    """A planar fluid that fills a rectangle (x, z) of the plane y = 0 at the start."""
    x, z = np.add(lower, upper) / 2
    half = np.subtract(upper, lower) / 2
    volume = FluidVolume(shape=Box(half_extents=(half[0], 1.0, half[1])), position=(x, 0.0, z))
    return Fluid(name=name, representation="fluid_planar", volumes=(volume,), **parameters)


def plane_world(
    *fluids: Fluid,
    size: tuple[float, float],
    cell: float,
    gravity: float = GRAVITY,
    closed: bool = True,
    lower: tuple[float, float] = (0.0, 0.0),
    objects: tuple[RigidObject, ...] = (),
    statics: tuple[StaticObject, ...] = (),
    emitters: tuple[Emitter, ...] = (),
    drains: tuple[Drain, ...] = (),
) -> World:
    """A box (x, z) from `lower` to lower + size, gravity along -z, everything in the plane y = 0."""
    return World(
        objects=objects,
        statics=statics,
        deformables=fluids,
        emitters=emitters,
        drains=drains,
        fluid_grid=FluidGrid(
            lower=(lower[0], -0.1, lower[1]),
            upper=(lower[0] + size[0], 0.1, lower[1] + size[1]),
            cell=cell,
            closed=closed,
        ),
        environment=Environment(gravity=(0, 0, -gravity), motion_plane=MotionPlane(normal=(0, 1, 0))),
    )


class Run:
    """A world's fluids and rigid bodies; the bodies feel gravity and the fluid, nothing else."""

    def __init__(self, world: World, *, step: float = 0.002, n_worlds: int = 1, horizon: float = 10.0) -> None:
        self.world, self.step, self.time = world, step, 0.0
        self.fluid = FluidSolver(world, n_worlds, horizon)
        self.gravity = np.asarray(world.environment.gravity)
        self.clock = _clock(step, n_worlds, self.gravity)
        self.bodies = _bodies(world, n_worlds)
        if world.objects:
            self.fluid.bind(self.bodies)

    def advance(self, duration: float, *, held: bool = False) -> Iterator[float]:
        """Step until `duration` from now has passed, yielding the time after each; held: bodies do not move."""
        with buffers.capture() as captured:
            self.fluid.step(self.clock)
        for _ in range(round(duration / self.step)):
            if self.world.objects and not held:
                self._move_bodies()
            buffers.write(self.clock.time, self.time)
            buffers.replay(captured.graph)
            self.time += self.step
            yield self.time

    def run(self, duration: float, *, held: bool = False) -> None:
        for _ in self.advance(duration, held=held):
            pass

    def present(self, world: int = 0) -> tuple[Array, Array]:
        """Positions and velocities (k, 3) of the particles of one world that are there."""
        x, v, fluid = self.fluid.particles()
        there = fluid[world] >= 0
        return x[world, there], v[world, there]

    def _move_bodies(self) -> None:
        b = buffers.read(self.bodies).copy()
        b["v"] += self.step * self.gravity
        b["x"] += self.step * b["v"]
        for w, i in np.ndindex(b.shape):
            turned = Rotation.from_rotvec(self.step * b["w"][w, i]) * Rotation.from_matrix(b["rotation"][w, i])
            b["rotation"][w, i], b["q"][w, i] = turned.as_matrix(), turned.as_quat()
        buffers.write(self.bodies, b)


def _clock(step: float, n_worlds: int, gravity: Array) -> Clock:
    clock = Clock()
    clock.time, clock.h = (buffers.full((n_worlds,), value, wp.float64) for value in (0.0, step))
    clock.gravity = buffers.array([gravity], wp.vec3d)
    return clock


def _bodies(world: World, n_worlds: int) -> Any:
    rows = np.zeros((n_worlds, max(1, len(world.objects))), dtype=Body.numpy_dtype())
    masses = model_of(world).arrays().mass[0]
    for i, item in enumerate(world.objects):
        solid = geometry.mass_properties(item.shape)
        inertia = solid.inertia / solid.volume
        values = {
            "x": item.position,
            "q": np.roll(item.orientation, -1),
            "v": item.velocity,
            "w": item.angular_velocity,
            "rotation": geometry.quaternion_matrix(np.array(item.orientation)),
            "mass": masses[i],
            "inverse_mass": 1.0 / masses[i],
            "inertia": inertia,
            "inverse_inertia": np.linalg.inv(inertia),
            "active": 1,
        }
        for name, value in values.items():
            rows[name][:, i] = value
    return buffers.array(rows, Body)
