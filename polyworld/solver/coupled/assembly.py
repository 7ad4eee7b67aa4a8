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


def first_nodes(solids: Sequence[Deformable], meshes: dict[str, DeformableMesh]) -> dict[str, int]:
    """Return the row of the first node of each rope, cloth and soft body; they lie one after the other."""
    ends = np.cumsum([0, *(len(meshes[d.name].nodes) for d in solids)]).tolist()
    return {d.name: first for d, first in zip(solids, ends, strict=False)}


def allocate_nodes(world: World, solids: Sequence[Deformable], meshes: dict[str, DeformableMesh], w: int) -> Nodes:
    """Nodes of all ropes, cloths and soft bodies of w worlds, at rest at the origin."""
    number = {d.name: i for i, d in enumerate(world.deformables)}
    owner = np.concatenate([np.full(len(meshes[d.name].nodes), number[d.name]) for d in solids] or [np.zeros(0)])
    nodes = Nodes()
    for name in ("x", "v", "f"):
        setattr(nodes, name, buffers.zeros((w, len(owner)), wp.vec3d))
    nodes.mass = buffers.zeros((1, len(owner)), wp.float64)
    nodes.inverse_mass = buffers.zeros((1, len(owner)), wp.float64)
    nodes.owner = buffers.ints(owner)
    nodes.active = buffers.zeros((w, len(owner)), wp.int32)
    normal = np.asarray(world.environment.motion_plane.normal, dtype=float)
    nodes.across = wp.vec3d(*(normal / np.linalg.norm(normal))) if world.planar else wp.vec3d()
    return nodes


def clock_of(w: int) -> Clock:
    """Return the clock of w worlds, at time 0."""
    clock = Clock()
    for name in ("time", "h", "dt"):
        setattr(clock, name, buffers.zeros((w,), wp.float64))
    clock.inner_steps = buffers.zeros((w,), wp.int32)
    clock.inner = buffers.zeros((1,), wp.int32)
    clock.gravity = buffers.zeros((1,), wp.vec3d)
    return clock


def stages_of(world: World, first: dict[str, int], n_worlds: int) -> list[MaterialStage]:
    """Return the stages of the materials that the world has; only their kernels are compiled.

    first: the row of each object's first node.
    """
    stages = []
    for kind in dict.fromkeys(material_of(item).kind for item in world.deformables):
        own = [item for item in world.deformables if material_of(item).kind == kind]
        stage = material(kind).stage
        if stage is not None:
            stages.append(stage(world, own, first, n_worlds))
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
        buffers.write(kept, buffers.read(values))
        return False
    setattr(holder, name, values)
    return True
