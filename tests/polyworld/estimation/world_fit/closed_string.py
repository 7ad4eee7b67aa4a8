"""A string plucked at its middle, solved in closed form: it stands in for the engine where a test is about the search.

Its n-th mode, of shape sin(n pi s), swings with w^2 = (n pi / L)^2 T / mu and dies away with exp(-c t / 2), where T is
stretch_stiffness times 1% (the strain it is strung with), mu linear_density and c linear_damping.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.trajectory import BatchTrajectory, PointMotion
from polyworld.world import World

Array = NDArray[np.float64]
LENGTH, HEIGHT, STRAIN = 2.0, 0.3, 0.01


class ClosedString:
    """Simulates the world's one rope, which runs along x from the origin."""

    def __init__(self, world: World, sample_times: Array, *, n_worlds: int) -> None:
        self.world, self.sample_times, self.n_worlds = world, np.asarray(sample_times), n_worlds
        self.names = world.moving_names
        self.mesh = mesh_of(world, world.deformables[0])

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        rope, given = self.world.deformables[0], overrides or {}

        def value(field: str) -> Array:
            own = np.full(self.n_worlds, float(getattr(rope, field)))
            return np.asarray(given.get(f"objects.{rope.name}.{field}", own))[:, None, None]

        t = self.sample_times[None, :samples, None]
        s = self.mesh.nodes[:, 0] / LENGTH
        tension = STRAIN * value("stretch_stiffness")
        up = np.zeros((self.n_worlds, t.shape[1], len(s)))
        for n in (1, 3, 5):
            w = n * np.pi / LENGTH * np.sqrt(tension / value("linear_density"))
            weight = HEIGHT * 8.0 / (np.pi * n) ** 2 * (-1) ** ((n - 1) // 2)
            up += weight * np.sin(n * np.pi * s) * np.cos(w * t)
        up *= np.exp(-0.5 * value("linear_damping") * t)
        points = np.zeros((*up.shape, 3))
        points[..., 0], points[..., 2] = self.mesh.nodes[:, 0], up
        centre = points.mean(axis=2)[:, :, None]
        pull = np.broadcast_to(tension, (self.n_worlds, t.shape[1], len(s) - 1))
        motion = PointMotion(points, np.zeros_like(points), {"tension": pull})
        w = self.n_worlds
        return BatchTrajectory(
            names=self.names,
            times=np.broadcast_to(self.sample_times[:samples], (w, t.shape[1])),
            positions=centre,
            orientations=np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*centre.shape[:3], 4)),
            velocities=np.zeros_like(centre),
            angular_velocities=np.zeros_like(centre),
            active=np.ones((t.shape[1], 1), dtype=bool),
            diverged=np.zeros(w, dtype=bool),
            diverged_time=np.full(w, np.nan),
            diverged_object=np.full(w, -1, dtype=np.int64),
            events=((),) * w,
            deformables={rope.name: motion},
        )
