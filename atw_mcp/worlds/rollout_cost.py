"""How much a rollout of a world with deformable objects is: points, samples, and the longest that is stored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polyworld.model import mesh_of
from polyworld.world import World
from polyworld.world.materials import PLANAR, material_of
from polyworld.world.representations.fluid import Emitter

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
    points = {}
    for item in world.deformables:
        count = len(mesh_of(world, item).nodes)
        if material_of(item).form == "liquid" and world.fluid_grid is not None:
            # Two particles along a cell's edge; planar fluids have one layer of them.
            spacing = world.fluid_grid.cell / 2.0
            size = spacing**2 if item.representation.endswith(PLANAR) else spacing**3
            count += sum(round(emitted(e, horizon) / size) for e in world.emitters if e.fluid == item.name)
        points[item.name] = count
    return Cost(points, int(np.floor(horizon / world.time.seconds_per_frame)) + 2)


def size_in_words(world: World, horizon: float) -> str:
    """', 6400 points of water, ...': what makes a rollout long; empty without deformable objects."""
    points = cost(world, horizon).points
    return "".join(f", {count} points of {name}" for name, count in points.items())


def emitted(emitter: Emitter, horizon: float) -> float:
    """Compute what flows from an emitter up to a time: volume [m^3], in a plane area [m^2]."""
    end = min(horizon, emitter.end if emitter.end is not None else horizon)
    if end <= emitter.start:
        return 0.0
    if not emitter.schedule:
        return emitter.rate * (end - emitter.start)
    times, factors = np.asarray(emitter.schedule, dtype=float).T
    knots = np.unique(np.concatenate([[emitter.start, end], times[(times > emitter.start) & (times < end)]]))
    return emitter.rate * float(np.trapezoid(np.interp(knots, times, factors), knots))


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
