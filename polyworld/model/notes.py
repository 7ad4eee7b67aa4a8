"""Find what is doubtful about meshes, cells and starts, and the number that would cure it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.model.model import model_of
from polyworld.world import World, geometry
from polyworld.world.shapes import Box, Capsule, Compound, Cylinder, Sphere

Array = NDArray[np.float64]

# Cells across a body in a liquid: the fewest for which the verification cases hold draft and lift to their tolerances.
CELLS = 5.0


def model_notes(world: World) -> tuple[str, ...]:
    """State what is under-resolved or starts stretched, a sentence each."""
    model = model_of(world)
    found = _in_liquid(world)
    for item in world.deformables:
        found += model.materials[item.name].notes(world, item, model.mesh(item.name))
    return tuple(found)


def _in_liquid(world: World) -> list[str]:
    grid = world.fluid_grid
    if grid is None:
        return []
    found = []
    low, high = np.asarray(grid.lower), np.asarray(grid.upper)
    for item in world.objects:
        place = np.asarray(item.position)
        wide = [a for a in (0, 1) if high[a] > low[a]]
        if not all(low[a] <= place[a] <= high[a] for a in wide):
            continue
        across = _thickness(item.shape)
        if across < CELLS * grid.cell * (1.0 - 1e-9):
            found.append(
                f"{item.name}: {across / grid.cell:.2g} cells across in the fluid grid; below {CELLS:g} its draft, "
                f"drag and lift are rough: fluid_grid.cell {across / CELLS:.3g} m resolves it"
            )
    return found


def _thickness(shape: geometry.Solid) -> float:
    """Smallest extent of a body; of one of several pieces, of its thickest [m]."""
    if isinstance(shape, Compound):
        return max(_thickness(piece.shape) for piece in geometry.pieces(shape))
    if isinstance(shape, Sphere | Capsule):
        return 2.0 * shape.radius
    if isinstance(shape, Cylinder):
        return 2.0 * min(shape.radius, shape.half_height)
    if isinstance(shape, Box):
        return 2.0 * min(shape.half_extents)
    return float(np.ptp(np.asarray(shape.vertices), axis=0).min())
