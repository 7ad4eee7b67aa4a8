"""Lanes: how many threads of the device work on one world, and which cells each of them takes.

A lane takes particles, faces and unknowns by their number: n, n + lanes, ... It takes rows of cells, along the last
axis, and cells in a row likewise, by their place in the grid: a cell belongs to the same lane in every kernel.
"""

from typing import NamedTuple

import warp as wp

from polyworld.core import buffers
from polyworld.solver.fluid.layout import Grid


class Lanes(NamedTuple):
    """count: of a world; across: how many of them share a row of cells. Powers of two."""

    count: int
    across: int


ON_CPU = Lanes(1, 1)  # its threads run one after the other; sums are then in a fixed order
ON_ACCELERATOR = Lanes(1024, 32)  # neighbours, which run in step, read cells side by side


def of_device() -> Lanes:
    """Return the lanes that suit the device in use."""
    return ON_CPU if buffers.device().is_cpu else ON_ACCELERATOR


@wp.func
def first_row(grid: Grid, lane: int, i: int, low: int) -> int:
    """Return the first j from `low` on for which a lane takes the row of cells (i, j); the next is `abreast` on."""
    return low + ((lane // grid.across - i * grid.count[1] - low) & (grid.abreast - 1))


@wp.func
def first_cell(grid: Grid, lane: int, low: int) -> int:
    """Return the first k from `low` on that a lane takes in its rows; the next is `across` on."""
    return low + ((lane - low) & (grid.across - 1))
