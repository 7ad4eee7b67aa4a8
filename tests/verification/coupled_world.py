"""Short-hand for the small worlds with deformable objects that the verification cases run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.solver.coupled.simulator import CoupledSimulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, StaticObject, World
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]
FLOOR = StaticObject(name="floor", shape=Plane())
VACUUM = Environment(air_density=0.0)
WEIGHTLESS = Environment(gravity=(0.0, 0.0, 0.0), air_density=0.0)


def slope(angle: float) -> StaticObject:
    """A plane through the origin that falls towards +x by `angle` [rad]."""
    return StaticObject(name="slope", shape=Plane(normal=(np.sin(angle), 0.0, np.cos(angle))))


def sheet(name: str, corner: Any, u: float, v: float, divisions: tuple[int, int], **fields: Any) -> Cloth:
    """A horizontal sheet with edges of length u along x and v along y."""
    geometry = Sheet(corner=tuple(corner), edge_u=(u, 0.0, 0.0), edge_v=(0.0, v, 0.0), divisions=divisions)
    return Cloth(name=name, geometry=geometry, **fields)


def pinned_corners(name: str, divisions: tuple[int, int]) -> tuple[Attachment, ...]:
    """Holds the corners of a sheet to the world."""
    m, n = divisions
    corners = (0, m, n * (m + 1), (m + 1) * (n + 1) - 1)
    return tuple(Attachment(name=f"pin-{k}", object=name, nodes=(i,)) for k, i in enumerate(corners))


class Run:
    """A run of a world, with the simulator's masses and forces at its end."""

    def __init__(
        self,
        world: World,
        duration: float,
        *,
        samples: int = 21,
        n_worlds: int = 1,
        overrides: Mapping[str, Array] | None = None,
    ) -> None:
        self.world = world
        times = np.linspace(0.0, duration, samples)
        simulator = CoupledSimulator(model_of(world), times, n_worlds=n_worlds, record_events=True, threads=1)
        self.trajectory: BatchTrajectory = simulator.run(overrides)
        self.shard = simulator._shards[0]
        self.times = times
        assert not self.trajectory.diverged.any()

    def points(self, name: str) -> Array:
        """Points (T, k, 3) of a deformable object in the first world."""
        return np.asarray(self.trajectory.deformables[name].points[0])

    def velocities(self, name: str) -> Array:
        """Velocities (T, k, 3) of them."""
        return np.asarray(self.trajectory.deformables[name].velocities[0])

    def mass(self, name: str) -> Array:
        """Masses (k,) of an object's nodes."""
        return np.asarray(self.shard.nodes.mass.numpy()[0, self.shard.rows(name)])

    def momentum(self) -> Array:
        """Linear momentum (T, 3) of all that moves [N s]."""
        total = np.zeros((len(self.times), 3))
        for item in self.world.deformables:
            total += np.einsum("k,tkj->tj", self.mass(item.name), self.velocities(item.name))
        for k, body in enumerate(self.world.objects):
            assert body.mass is not None
            total += body.mass * self.trajectory.velocities[0, :, k]
        return total

    def along(self, name: str, direction: Any) -> Array:
        """Coordinate (T,) of an object's centre along a direction."""
        k = self.world.moving_names.index(name)
        return np.asarray(self.trajectory.positions[0, :, k] @ np.asarray(direction))
