"""Which object forces how short an inner step, and what would allow a longer one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from polyworld.core import buffers

if TYPE_CHECKING:
    from polyworld.solver.coupled.shard import Shard


@dataclass(frozen=True)
class Need:
    """step: longest that one object allows [s]; why: which motion of it; cure: what would allow a longer one."""

    step: float
    why: str
    cure: str


def slowest_part(shard: Shard) -> str:
    """Say how a shard's worlds step now, which object forces it, and what would make them faster."""
    substep = shard.world.time.substep
    said = []
    if shard.solids:
        inner = int(np.max(buffers.read(shard.clock.inner_steps)))
        nodes = shard.nodes.x.shape[1]
        said.append(f"{nodes} nodes take {inner} inner steps of {substep / max(inner, 1):.2g} s in each step")
        needs = [need for stage in shard.stages for need in stage.needs()]
        shortest = min(needs, key=lambda need: need.step, default=None)
        if shortest is not None and shortest.step < 0.99 * shard.longest_inner_step:
            said.append(f"{shortest.why} needs {shortest.step:.2g} s at the start; {shortest.cure}")
        least = int(np.ceil(substep / min([shard.longest_inner_step, *(need.step for need in needs)])))
        if inner > 2 * least:
            said.append("tensions have grown far beyond those at the start")
    if shard.fluid is not None:
        cells, cell = shard.fluid.grid.cells, shard.world.fluid_grid
        size = f" of {cell.cell:g} m" if cell is not None else ""
        parts = int(np.max(shard.fluid.substeps))
        said.append(f"the liquid's {cells} cells{size} take {max(parts, 1)} sub-steps in each step; larger cells fewer")
    return ". ".join(f"{line[0].upper()}{line[1:]}" for line in said)
