"""Soft bodies alone: the soft stage driven by a bare loop, without contact or any other material."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.meshing import mesh_of
from polyworld.representations.soft import Soft
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.soft import SoftStage
from polyworld.world import World

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
        self, *items: Soft, worlds: int = 1, parameters: dict[str, dict[str, Array]] | None = None, step: float = 1.0
    ) -> None:
        world = World(deformables=items)
        self.mesh = {item.name: mesh_of(world, item) for item in items}
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

        self.nodes = Nodes(
            x=vectors(), v=vectors(), f=vectors(), mass=scalars(mass), inverse_mass=scalars(1.0 / mass),
            radius=scalars(np.zeros(count)), owner=wp.zeros(count, dtype=wp.int32, device="cpu"),
            friction=scalars(np.zeros((1, 1))), restitution=scalars(np.zeros((1, 1))),
            active=wp.ones((worlds, count), dtype=wp.int32, device="cpu"),
            first=self.first, count={n: len(m.nodes) for n, m in self.mesh.items()},
        )  # fmt: skip
        self._load = vectors()
        self.x, self.v, self.load = self.nodes.x.numpy(), self.nodes.v.numpy(), self._load.numpy()
        self.mass, self.inverse_mass = self.nodes.mass.numpy(), self.nodes.inverse_mass.numpy()
        self.x[:] = start
        self.rest = self.x.copy()
        self.dt = np.broadcast_to(np.minimum(self.stage.stable_step(), step), (worlds,)).copy()
        dt = scalars(self.dt)
        self.rate = scalars(np.zeros(worlds))
        self.clock = Clock(
            time=scalars(np.zeros(worlds)), h=dt, dt=dt, inner_steps=wp.ones(worlds, dtype=wp.int32, device="cpu"),
            inner=wp.zeros(1, dtype=wp.int32, device="cpu"), gravity=wp.zeros(1, dtype=wp.vec3d, device="cpu"),
        )  # fmt: skip
        self._graph = None

    def hold(self, chosen: NDArray[np.bool_]) -> None:
        """Hold nodes (N,) in place in all worlds."""
        self.inverse_mass[:, chosen] = 0.0

    def damp(self, rate: float) -> None:
        """Slow everything at a rate [1/s], to find rest."""
        self.rate.numpy()[:] = rate

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
