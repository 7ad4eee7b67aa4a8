"""Work of rollouts with deformable objects, from which follows how many of them are made."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.model import model_of
from polyworld.solver.fluid.scene import thin_axis
from polyworld.world import World
from polyworld.world.materials import PLANAR, material_of
from polyworld.world.representations.fluid import Emitter

LEAST = 16  # rollouts of an ensemble, however costly: 80% intervals need them


def points_of(world: World, horizon: float) -> dict[str, int]:
    """Return how many nodes and particles each deformable object has at a time [s]."""
    model, points = model_of(world), {}
    for item in world.deformables:
        count = len(model.mesh(item.name).nodes)
        if material_of(item).form == "liquid" and world.fluid_grid is not None:
            # Two particles along a cell's edge; planar fluids have one layer of them.
            spacing = world.fluid_grid.cell / 2.0
            size = spacing**2 if item.representation.endswith(PLANAR) else spacing**3
            count += sum(round(emitted(e, horizon) / size) for e in world.emitters if e.fluid == item.name)
        points[item.name] = count
    return points


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


def work_of(world: World, horizon: float) -> float:
    """Return steps times points and cells of a rollout to a time [s]; 0 where nothing deforms.

    Of liquids a core does some 6e5 in a second. It is counted, not timed, so that equal requests have equal answers.
    """
    if not world.deformables:
        return 0.0
    count, box = sum(points_of(world, horizon).values()), world.fluid_grid
    if box is not None and world.of_form("liquid"):
        sides = np.ceil(np.subtract(box.upper, box.lower) / box.cell - 1e-6)
        thin = thin_axis(world)
        count += int(sides.prod() if thin < 0 else np.delete(sides, thin).prod())
    return count * horizon / world.time.substep


def affordable(works: Sequence[float], budget: float, most: int) -> int:
    """Return how many rollouts of each of some works fit a budget: at least LEAST, and at most `most`."""
    total = sum(works)
    return most if total * most <= budget else min(max(int(budget / total), LEAST), most)
