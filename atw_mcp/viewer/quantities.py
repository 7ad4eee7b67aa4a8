"""Series of a rollout beside its motion: energies, and what the engine reads off deformable objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer.packing import Blocks
from polyworld.solver.energy_sources import masses_of, points_masses
from polyworld.solver.energy_watch import energies
from polyworld.trajectory import Trajectory
from polyworld.world import World
from polyworld.world.materials import material_of, measure_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """A series (T,) made of a quantity's values (T, m): its name, its unit, and what it takes of them."""

    name: str
    unit: str
    over: Literal["largest", "mean", "total"]  # largest: of the absolute values


READINGS: dict[tuple[str, str], tuple[Reading, ...]] = {
    ("line", "tension"): (Reading("largest_tension", "N", "largest"), Reading("mean_tension", "N", "mean")),
    ("line", "curvature"): (Reading("largest_curvature", "1/m", "largest"),),
    ("sheet", "strain"): (Reading("largest_strain", "1", "largest"),),
    ("sheet", "elastic_energy"): (Reading("elastic_energy", "J", "total"),),
    ("solid", "stress"): (Reading("largest_von_mises_stress", "Pa", "largest"),),
    ("solid", "strain"): (Reading("largest_strain", "1", "largest"),),
    ("solid", "volume"): (Reading("volume", "m^3", "total"),),
}
"""By form of material and quantity; see `PointMotion.quantities`."""


def quantities_view(world: World, run: Trajectory, blocks: Blocks) -> list[view.Quantity]:
    """Return energies of every object, and readings of the deformable ones."""
    found: list[view.Quantity] = []

    def add(name: str, item: str, unit: str, values: Array) -> None:
        found.append(view.Quantity(name=name, object=item, unit=unit, values=blocks.floats(values)))

    kinetic, weight = energies(world, run, masses_of(world))
    for k, name in enumerate(run.names):
        here = run.active[:, k]
        add("kinetic_energy", name, "J", np.where(here, kinetic[:, k], np.nan))
        add("potential_energy", name, "J", np.where(here, weight[:, k], np.nan))
    for name, motion in run.deformables.items():
        item = world.deformable(name)
        form = material_of(item).form
        for quantity, values in motion.quantities.items():
            for reading in READINGS.get((form, quantity), ()):
                add(reading.name, name, reading.unit, _reduced(values, reading.over))
        if form == "liquid" and world.fluid_grid is not None:
            there = np.isfinite(motion.points).all(axis=-1).sum(axis=1)
            add("mass", name, "kg/m" if world.planar else "kg", there * float(points_masses(world, name, 1)[0]))
            size, unit = measure_of(item)
            add(size, name, unit, there * float(world.fluid_grid.cell / 2.0) ** (2 if world.planar else 3))
    return found


def _reduced(values: Array, over: Literal["largest", "mean", "total"]) -> Array:
    if over == "largest":
        return np.asarray(np.abs(values).max(axis=-1))
    return np.asarray(values.mean(axis=-1) if over == "mean" else values.sum(axis=-1))
