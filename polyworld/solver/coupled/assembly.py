"""Parts of a shard: nodes, clock, the stages of its materials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.coupled.stage import MaterialStage
from polyworld.world import Deformable, World
from polyworld.world.materials import material, material_of

if TYPE_CHECKING:
    from polyworld.solver.fluid.solver import FluidSolver


def allocate_nodes(
    solids: Sequence[Deformable], meshes: dict[str, DeformableMesh], owners: dict[str, int], w: int
) -> Nodes:
    """Nodes of all ropes, cloths and soft bodies of w worlds, at rest at the origin."""
    first: dict[str, int] = {}
    count: dict[str, int] = {}
    total = 0
    for item in solids:
        first[item.name], count[item.name] = total, len(meshes[item.name].nodes)
        total += count[item.name]
    owner = np.concatenate([np.full(count[d.name], owners[d.name]) for d in solids] or [np.zeros(0)])
    radius = np.concatenate([meshes[d.name].radius for d in solids] or [np.zeros(0)])

    def vectors() -> Any:
        return buffers.zeros((w, total), wp.vec3d)

    return Nodes(
        x=vectors(),
        v=vectors(),
        f=vectors(),
        mass=buffers.zeros((1, total), wp.float64),
        inverse_mass=buffers.zeros((1, total), wp.float64),
        radius=buffers.array(radius, wp.float64),
        owner=buffers.array(owner.astype(np.int32), wp.int32),
        friction=buffers.zeros((1, len(owners)), wp.float64),
        restitution=buffers.zeros((1, len(owners)), wp.float64),
        active=buffers.zeros((w, total), wp.int32),
        first=first,
        count=count,
    )


def clock_of(w: int) -> Clock:
    """Return the clock of w worlds, at time 0."""

    def seconds() -> Any:
        return buffers.zeros((w,), wp.float64)

    return Clock(
        time=seconds(),
        h=seconds(),
        dt=seconds(),
        inner_steps=buffers.zeros((w,), wp.int32),
        inner=buffers.zeros((1,), wp.int32),
        gravity=buffers.zeros((1,), wp.vec3d),
    )


def stages_of(world: World, nodes: Nodes, n_worlds: int) -> list[MaterialStage]:
    """Return the stages of the materials that the world has; only their kernels are compiled."""
    stages = []
    for kind in dict.fromkeys(material_of(item).kind for item in world.deformables):
        own = [item for item in world.deformables if material_of(item).kind == kind]
        stage = material(kind).stage
        if stage is not None:
            stages.append(stage(world, own, nodes.first, n_worlds))
    return stages


def fluid_of(world: World, n_worlds: int, horizon: float) -> FluidSolver | None:
    """Return the solver of the world's fluids, None where it has none."""
    if not world.of_form("liquid"):
        return None
    from polyworld.solver.fluid.solver import FluidSolver

    return FluidSolver(world, n_worlds, horizon)


def write_in_place(holder: Any, name: str, values: Any) -> bool:
    """Write values into holder.name in place; reallocate, and return True, where the shape differs."""
    kept = getattr(holder, name)
    if kept is not None and kept.shape == values.shape:
        kept.numpy()[:] = values.numpy()
        return False
    setattr(holder, name, values)
    return True
