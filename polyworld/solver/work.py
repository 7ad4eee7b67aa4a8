"""Work of rollouts with deformable objects, from which follows how many of them are made."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.model import model_of
from polyworld.world import World
from polyworld.world.materials import PLANAR

LEAST = 16  # rollouts of an ensemble, however costly: 80% intervals need them


def points_of(world: World, horizon: float) -> int:
    """Return how many nodes and particles a world with deformable objects has by a time [s]."""
    model = model_of(world)
    count = sum(len(model.mesh(item.name).nodes) for item in world.deformables)
    if world.fluid_grid is not None and world.emitters:
        volume = (world.fluid_grid.cell / 2.0) ** (2 if _flat(world) else 3)
        count += int(sum(e.rate for e in world.emitters) * horizon / volume)
    return count


def work_of(world: World, horizon: float) -> float:
    """Return steps times points and cells of a rollout to a time [s]; 0 where nothing deforms.

    Of liquids a core does some 6e5 in a second. It is counted, not timed, so that equal requests have equal answers.
    """
    if not world.deformables:
        return 0.0
    count, box = points_of(world, horizon), world.fluid_grid
    if box is not None and world.of_form("liquid"):
        sides = np.ceil(np.subtract(box.upper, box.lower) / box.cell - 1e-6)
        across = np.abs(np.asarray(world.environment.motion_plane.normal)).argmax()
        count += int(np.delete(sides, across).prod() if _flat(world) else sides.prod())
    return count * horizon / world.time.substep


def _flat(world: World) -> bool:
    """Whether liquids move in the motion plane alone."""
    return any(item.representation.endswith(PLANAR) for item in world.of_form("liquid"))


def affordable(works: Sequence[float], budget: float, most: int) -> int:
    """Return how many rollouts of each of some works fit a budget: at least LEAST, and at most `most`."""
    total = sum(works)
    return most if total * most <= budget else min(max(int(budget / total), LEAST), most)
