"""PolyWorld, planar and spatial."""

from __future__ import annotations

import math

import numpy as np

from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere, TriangleMesh
from tests.benchmarks.peers.engine import Prepared, UnsupportedError
from tests.benchmarks.peers.scenes import Body, Motion, Scene


def world_of(scene: Scene, *, planar: bool) -> World:
    """Return a scene as a world of planar or of spatial objects."""
    objects = tuple(_object(f"b{k}", body, scene, planar) for k, body in enumerate(scene.bodies))
    upright = planar and scene.upright
    plane = MotionPlane(normal=(0, 1, 0), supports=False) if upright else MotionPlane(friction=scene.friction)
    joints = tuple(
        Hinge(name=f"j{k}", object=f"b{k}", other=f"b{k - 1}" if k else None, anchor=point, axis=(0, 1, 0))
        for k, point in enumerate(scene.chain)
    )
    return World(
        objects=objects,
        statics=_statics(scene, floor=scene.floor and not (planar and not upright), sides=not upright),
        joints=joints,
        environment=Environment(gravity=scene.gravity, motion_plane=plane),
        time=TimeBase(substep=scene.substep),
    )


def _object(name: str, body: Body, scene: Scene, planar: bool) -> RigidObject:
    return RigidObject(
        name=name,
        representation="rigid_planar" if planar else "rigid_spatial",
        shape=_shape(body),
        mass=1.0,
        friction=scene.friction,
        restitution=scene.restitution,
        position=body.position,
        orientation=(math.cos(body.tilt / 2), 0.0, math.sin(body.tilt / 2), 0.0),
        velocity=body.velocity,
        angular_velocity=body.spin,
    )


def _shape(body: Body) -> Sphere | Cylinder | Box:
    if body.kind == "sphere":
        return Sphere(radius=body.size[0])
    if body.kind == "cylinder":
        return Cylinder(radius=body.size[0], half_height=body.size[1])
    return Box(half_extents=(body.size[0], body.size[1], body.size[2]))


def _statics(scene: Scene, *, floor: bool, sides: bool) -> tuple[StaticObject, ...]:
    normals = [(1, 0, 0), (-1, 0, 0), *([(0, 1, 0), (0, -1, 0)] if sides else [])] if scene.walls else []
    statics = [
        StaticObject(name=f"wall{k}", shape=Plane(normal=n, offset=-(scene.walls or 0.0)))
        for k, n in enumerate(normals)
    ]
    if floor:
        statics.append(StaticObject(name="floor", shape=Plane()))
    if scene.terrain is not None:
        vertices, faces = scene.terrain.mesh()
        shape = TriangleMesh(vertices=tuple(map(tuple, vertices.tolist())), faces=tuple(map(tuple, faces.tolist())))
        statics.append(StaticObject(name="hills", shape=shape))
    return tuple(statics)


class _Run:
    def __init__(self, world: World, times: np.ndarray, worlds: int, threads: int) -> None:
        self._simulator = simulator(world, times, n_worlds=worlds, threads=threads)
        self._result: BatchTrajectory | None = None

    def run(self) -> None:
        self._result = self._simulator.run()

    def motion(self) -> Motion:
        out = self._result
        assert out is not None
        rotations = np.array([[quaternion_matrix(q) for q in row] for row in out.orientations[0]])
        return Motion(out.times[0], out.positions[0], out.velocities[0], out.angular_velocities[0], rotations)


class PolyWorld:
    """The engine of this project, with all of its defaults."""

    def __init__(self, planar: bool) -> None:
        self.planar = planar
        self.name = "PolyWorld planar" if planar else "PolyWorld spatial"

    def prepare(self, scene: Scene, worlds: int, interval: float, threads: int) -> Prepared:
        """Return a scene as a simulator of so many worlds."""
        if self.planar and scene.terrain is not None:
            raise UnsupportedError("triangle meshes are for spatial worlds")
        times = np.arange(0.0, scene.duration + 1e-9, interval)
        return _Run(world_of(scene, planar=self.planar), times, worlds, threads)
