"""The cloth's forces on nodes placed at will, and a bare loop that moves free nodes by them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld import World
from polyworld.model import mesh_of
from polyworld.solver.cloth.stage import ClothStage
from polyworld.solver.coupled.nodes import Clock, Nodes

Array = NDArray[np.float64]


class ClothLoop:
    """One free cloth without gravity; x, v (k, 3) and mass (k,) are views of its state."""

    def __init__(self, cloth: dict[str, Any], **environment: Any) -> None:
        world = World.model_validate(
            {
                "deformables": [{"name": "cloth", "representation": "cloth", **cloth}],
                "environment": {"gravity": (0.0, 0.0, 0.0), "air_density": 0.0, **environment},
            }
        )
        item = world.deformables[0]
        self.mesh = mesh_of(world, item)
        self.mass = self.mesh.measure * item.areal_density
        count = len(self.mass)
        self.nodes = Nodes()
        self.nodes.x = _array(self.mesh.nodes[None], wp.vec3d)
        self.nodes.v = _array(np.zeros((1, count, 3)), wp.vec3d)
        self.nodes.f = _array(np.zeros((1, count, 3)), wp.vec3d)
        self.nodes.mass = _array(self.mass[None], wp.float64)
        self.nodes.inverse_mass = _array(1.0 / self.mass[None], wp.float64)
        self.nodes.active = _array(np.ones((1, count), dtype=np.int32), wp.int32)
        self.stage = ClothStage(world, [item], {"cloth": 0}, 1)
        self.dt = float(self.stage.stable_step()[0])
        self.clock = Clock()
        self.clock.dt = _array(np.array([self.dt]), wp.float64)
        self.clock.gravity = _array(np.zeros((1, 3)), wp.vec3d)
        self.x: Array = self.nodes.x.numpy()[0]
        self.v: Array = self.nodes.v.numpy()[0]

    def forces(self) -> Array:
        """Forces (k, 3) at the present x and v, with the directors where they are."""
        self.nodes.f.numpy()[:] = 0.0
        self.stage.launch_forces(self.nodes, self.clock)
        return np.array(self.nodes.f.numpy()[0])

    def quantity(self, name: str) -> Array:
        """A readable quantity of the one world."""
        return self.stage.quantities(self.nodes)["cloth"][name][0]

    def run(self, steps: int) -> None:
        """Symplectic Euler steps."""
        for _ in range(steps):
            self.v += self.dt * self.forces() / self.mass[:, None]
            self.stage.launch_velocities(self.nodes, self.clock)
            self.x += self.dt * self.v

    def momentum(self) -> tuple[Array, Array]:
        """Linear momentum, and angular momentum about the origin."""
        p = self.mass[:, None] * self.v
        return p.sum(axis=0), np.cross(self.x, p).sum(axis=0)

    def kinetic_energy(self) -> float:
        """Of the nodes [J]."""
        return float(0.5 * (self.mass[:, None] * self.v**2).sum())


def _array(values: Any, dtype: Any) -> Any:
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")
