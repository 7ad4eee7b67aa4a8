"""Soft bodies alone: the soft stage driven by a bare loop, without contact or any other material."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.model.soft import soft_form
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.soft import SoftStage
from polyworld.world import Environment, World
from polyworld.world.representations.soft import Soft

Array = NDArray[np.float64]
PARAMETERS = ("density", "youngs_modulus", "poisson_ratio", "damping", "yield_stress")


@wp.kernel(module="unique", enable_backward=False)
def integrate(
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    f: wp.array2d[wp.vec3d],
    load: wp.array2d[wp.vec3d],
    inverse_mass: wp.array2d[wp.float64],
    rate: wp.array[wp.float64],
    dt: wp.array[wp.float64],
    part: int,
) -> None:
    w, i = wp.tid()
    if part == 0:
        v[w, i] = (v[w, i] + (f[w, i] + load[w, i]) * (dt[w] * inverse_mass[w, i])) / (
            wp.float64(1.0) + dt[w] * rate[w]
        )
    elif part == 1:
        x[w, i] = x[w, i] + v[w, i] * dt[w]
    else:
        f[w, i] = wp.vec3d(wp.float64(0.0))


class Bench:
    """W worlds of soft bodies; x, v, load (W, N, 3) and mass (W, N) are numpy views that may be written.

    Differing `parameters` a world: name -> parameter -> (W,).
    """

    def __init__(
        self,
        *items: Soft,
        worlds: int = 1,
        parameters: dict[str, dict[str, Array]] | None = None,
        environment: Environment | None = None,
    ) -> None:
        world = World(deformables=items, environment=environment or Environment())
        self.mesh = {item.name: mesh_of(world, item) for item in items}
        self.forms = {item.name: soft_form(world, item) for item in items}
        self.first, count = {}, 0
        for item in items:
            self.first[item.name] = count
            count += len(self.mesh[item.name].nodes)
        self.stage = SoftStage(world, items, self.first, worlds)
        fields = {i.name: {k: np.array([getattr(i, k)], dtype=float) for k in PARAMETERS} for i in items}
        for name, values in (parameters or {}).items():
            fields[name].update(values)
        self.stage.write(fields)
        start = np.concatenate([self.mesh[i.name].nodes for i in items])
        measure = [self.mesh[i.name].measure[None, :] * fields[i.name]["density"][:, None] for i in items]
        mass = np.concatenate([np.broadcast_to(m, (worlds, m.shape[1])) for m in measure], axis=1)

        def vectors() -> wp.array:
            return wp.zeros((worlds, count), dtype=wp.vec3d, device="cpu")

        def scalars(values: Array) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device="cpu")

        self.nodes = Nodes()
        self.nodes.x, self.nodes.v, self.nodes.f = vectors(), vectors(), vectors()
        self.nodes.mass, self.nodes.inverse_mass = scalars(mass), scalars(1.0 / mass)
        self.nodes.active = wp.ones((worlds, count), dtype=wp.int32, device="cpu")
        self._load = vectors()
        self.x, self.v, self.load = self.nodes.x.numpy(), self.nodes.v.numpy(), self._load.numpy()
        self.mass, self.inverse_mass = self.nodes.mass.numpy(), self.nodes.inverse_mass.numpy()
        self.x[:] = start
        self.rest = self.x.copy()
        self.dt = np.broadcast_to(self.stage.stable_step(), (worlds,)).copy()
        dt = scalars(self.dt)
        self.rate = scalars(np.zeros(worlds))
        self.clock = Clock()
        self.clock.dt = dt
        self._graph = None

    def hold(self, chosen: NDArray[np.bool_]) -> None:
        """Hold nodes (N,) in place in all worlds."""
        self.inverse_mass[:, chosen] = 0.0

    def damp(self, rate: float) -> None:
        """Slow everything at a rate [1/s], to find rest."""
        self.rate.numpy()[:] = rate

    def press(self, traction: Callable[[Array, Array], Array]) -> None:
        """Load the surface of the one body: traction(centre, normal) [Pa] of each face or outline edge at rest.

        A uniform traction on a straight face of six nodes acts on its three middles alike, and not on its corners; on
        an edge of three nodes by Simpson's rule.
        """
        (form,) = self.forms.values()
        faces = form.boundary
        x = self.rest[0]
        if form.planar:
            along = x[faces[:, 1]] - x[faces[:, 0]]
            area = np.linalg.norm(along, axis=1) * form.thickness
            across = np.cross(
                x[form.elements[0, 1]] - x[form.elements[0, 0]], x[form.elements[0, 2]] - x[form.elements[0, 0]]
            )
            normal = np.cross(along, across)
            shares = {0: 1 / 6, 1: 1 / 6, 2: 2 / 3}
        else:
            normal = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
            area = 0.5 * np.linalg.norm(normal, axis=1)
            shares = {3: 1 / 3, 4: 1 / 3, 5: 1 / 3}
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        corners = faces[:, : 2 if form.planar else 3]
        force = traction(x[corners].mean(axis=1), normal) * area[:, None]
        for node, share in shares.items():
            for w in range(len(self.load)):
                np.add.at(self.load[w], faces[:, node], share * force)

    def _launch(self) -> None:
        n, dim = self.nodes, self.nodes.x.shape
        arrays = [n.x, n.v, n.f, self._load, n.inverse_mass, self.rate, self.clock.dt]
        wp.launch(integrate, dim=dim, inputs=[*arrays, 2], device="cpu")
        self.stage.launch_forces(n, self.clock)
        wp.launch(integrate, dim=dim, inputs=[*arrays, 0], device="cpu")
        self.stage.launch_velocities(n, self.clock)
        wp.launch(integrate, dim=dim, inputs=[*arrays, 1], device="cpu")
        self.stage.launch_positions(n, self.clock)

    def run(self, steps: int, each: Callable[[int], object] | None = None, every: int = 1) -> None:
        """Take steps; call `each` with the step's number after every `every` of them."""
        if self._graph is None:
            with wp.ScopedCapture(device="cpu") as capture:
                self._launch()
            self._graph = capture.graph
        for step in range(1, steps + 1):
            wp.capture_launch(self._graph)
            if each is not None and step % every == 0:
                each(step)
