"""How much a rollout of a world with deformable objects is: points, samples, and the longest that is stored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polyworld.solver.work import points_of
from polyworld.world import World

MAX_POINT_SAMPLES = 8_000_000  # places of points in one rollout: some 60 MB in the store for a fluid


@dataclass(frozen=True)
class Cost:
    """points: nodes and particles at the end of the horizon, by deformable object. samples: frames."""

    points: dict[str, int]
    samples: int

    @property
    def point_samples(self) -> int:
        """How many places of points are kept."""
        return sum(self.points.values()) * self.samples


def cost(world: World, horizon: float) -> Cost:
    """Estimate what rolling a world out to `horizon` [s] takes."""
    return Cost(points_of(world, horizon), int(np.floor(horizon / world.time.seconds_per_frame)) + 2)


def size_in_words(world: World, horizon: float) -> str:
    """', 6400 points of water, ...': what makes a rollout long; empty without deformable objects."""
    points = points_of(world, horizon)
    return "".join(f", {count} points of {name}" for name, count in points.items())


def longest_horizon(world: World) -> float:
    """The longest horizon [s] whose points can be kept; infinite without deformable objects."""
    if not world.deformables:
        return float("inf")
    low, high = 0.0, 1e6
    if cost(world, high).point_samples <= MAX_POINT_SAMPLES:
        return float("inf")
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cost(world, middle).point_samples <= MAX_POINT_SAMPLES else (low, middle)
    return low
