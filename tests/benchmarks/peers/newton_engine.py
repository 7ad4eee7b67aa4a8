"""Newton by its solvers XPBD and SemiImplicit, a sample interval captured as a graph and replayed. Single precision."""

from __future__ import annotations

import math
from typing import Any

import newton
import numpy as np
import warp as wp

from tests.benchmarks.peers.engine import Prepared, UnsupportedError
from tests.benchmarks.peers.scenes import Body, Motion, Scene

VOLUMES = {
    "sphere": lambda size: 4 / 3 * math.pi * size[0] ** 3,
    "cylinder": lambda size: 2 * math.pi * size[0] ** 2 * size[1],
    "box": lambda size: 8 * size[0] * size[1] * size[2],
}


def _configuration(scene: Scene, density: float = 0.0) -> Any:
    """Contacts of a scene. Stiffness and damping, which only SemiImplicit reads, are Newton's defaults."""
    return newton.ModelBuilder.ShapeConfig(
        density=density, mu=scene.friction, restitution=scene.restitution, mu_torsional=0.0, mu_rolling=0.0
    )


def _add(builder: Any, body: Body, scene: Scene, link: bool) -> int:
    half = body.tilt / 2
    place = wp.transform(wp.vec3(*body.position), wp.quat(0.0, math.sin(half), 0.0, math.cos(half)))
    index = int(builder.add_link(xform=place) if link else builder.add_body(xform=place))
    settings = _configuration(scene, 1.0 / VOLUMES[body.kind](body.size))
    if body.kind == "sphere":
        builder.add_shape_sphere(index, radius=body.size[0], cfg=settings)
    elif body.kind == "cylinder":
        builder.add_shape_cylinder(index, radius=body.size[0], half_height=body.size[1], cfg=settings)
    else:
        builder.add_shape_box(index, hx=body.size[0], hy=body.size[1], hz=body.size[2], cfg=settings)
    return index


def _hinge(builder: Any, bodies: list[int], scene: Scene) -> None:
    joints = []
    for k, (index, body, point) in enumerate(zip(bodies, scene.bodies, scene.chain, strict=True)):
        half = body.tilt / 2
        turn = wp.quat(0.0, math.sin(half), 0.0, math.cos(half))
        end = wp.vec3(body.size[0], 0.0, 0.0)
        holder = wp.transform(wp.vec3(*point), turn) if k == 0 else wp.transform(end, wp.quat_identity())
        joints.append(
            builder.add_joint_revolute(
                parent=bodies[k - 1] if k else -1,
                child=index,
                axis=wp.vec3(0.0, 1.0, 0.0),
                parent_xform=holder,
                child_xform=wp.transform(-end, wp.quat_identity()),
            )
        )
    builder.add_articulation(joints)


def _model(scene: Scene, worlds: int) -> Any:
    one = newton.ModelBuilder()
    bodies = [_add(one, body, scene, bool(scene.chain)) for body in scene.bodies]
    if scene.chain:
        _hinge(one, bodies, scene)
    builder = newton.ModelBuilder()
    settings = _configuration(scene)
    planes = [(0.0, 0.0, 1.0, 0.0)] if scene.floor else []
    if scene.walls is not None:
        planes += [(x, y, 0.0, scene.walls) for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))]
    for plane in planes:
        builder.add_shape_plane(plane=wp.vec4(*plane), width=0.0, length=0.0, cfg=settings)
    if scene.terrain is not None:
        vertices, faces = scene.terrain.mesh()
        mesh = newton.Mesh(vertices.astype(np.float32), faces.astype(np.int32).ravel())
        builder.add_shape_mesh(-1, mesh=mesh, cfg=settings)
    builder.replicate(one, world_count=worlds)
    model = builder.finalize(device="cpu")
    model.set_gravity(scene.gravity)
    return model


class _Run:
    def __init__(self, scene: Scene, worlds: int, interval: float, solver: str) -> None:
        self._scene, self._interval = scene, interval
        self._inner, self._count = round(interval / scene.substep), round(scene.duration / interval)
        if self._inner % 2:
            raise UnsupportedError("an interval must have an even number of steps")
        model = _model(scene, worlds)
        self._solver = (
            newton.solvers.SolverXPBD(model, enable_restitution=scene.restitution > 0)
            if solver == "XPBD"
            else newton.solvers.SolverSemiImplicit(model, angular_damping=0.0)
        )
        self._states = [model.state(), model.state()]
        if scene.chain:
            newton.eval_fk(model, model.joint_q, model.joint_qd, self._states[0])
        self._control = model.control()
        self._pipeline = None if scene.chain else newton.CollisionPipeline(model)
        self._contacts: Any = None if self._pipeline is None else self._pipeline.contacts()
        n = len(scene.bodies)
        velocities = [(*body.velocity, *body.spin) for body in scene.bodies]
        self._start_q = self._states[0].body_q.numpy().copy()
        self._start_v = np.tile(np.array(velocities, dtype=np.float32), (worlds, 1))
        self._q = np.zeros((self._count + 1, worlds * n, 7), dtype=np.float32)
        self._v = np.zeros((self._count + 1, worlds * n, 6), dtype=np.float32)
        self._advance()  # kernels are compiled before the capture
        with wp.ScopedCapture(device="cpu") as capture:
            self._advance()
        self._graph = capture.graph

    def _advance(self) -> None:
        before, after = self._states
        for _ in range(self._inner):
            before.clear_forces()
            if self._pipeline is not None:
                self._pipeline.collide(before, self._contacts)
            self._solver.step(before, after, self._control, self._contacts, self._scene.substep)
            before, after = after, before

    def run(self) -> None:
        state = self._states[0]
        state.body_q.assign(self._start_q)
        state.body_qd.assign(self._start_v)
        self._q[0], self._v[0] = self._start_q, self._start_v
        for k in range(1, self._count + 1):
            wp.capture_launch(self._graph)
            self._q[k], self._v[k] = state.body_q.numpy(), state.body_qd.numpy()

    def motion(self) -> Motion:
        n = len(self._scene.bodies)
        q, v = self._q[:, :n].astype(float), self._v[:, :n].astype(float)
        rotations = _rotations(q[..., 3:])
        times = self._interval * np.arange(len(q), dtype=float)
        return Motion(times, q[..., :3], v[..., :3], v[..., 3:], rotations)


def _rotations(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) written x, y, z, w."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class Newton:
    """Newton by one of its solvers."""

    def __init__(self, solver: str) -> None:
        """solver: XPBD or SemiImplicit."""
        self.name = f"Newton {solver}"
        self._solver = solver

    def prepare(self, scene: Scene, worlds: int, interval: float, threads: int) -> Prepared:  # noqa: ARG002
        """Return a scene as a model with its graph. Warp's launches on a CPU take one thread, whatever is asked."""
        return _Run(scene, worlds, interval, self._solver)
