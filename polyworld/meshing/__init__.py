"""Deformable objects divided into nodes and elements, the same on every call."""

from __future__ import annotations

from polyworld.meshing.mesh import DeformableMesh
from polyworld.world import Deformable, World
from polyworld.world.representations.cloth import Cloth
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft


def mesh_of(world: World, item: Deformable) -> DeformableMesh:
    """The nodes and elements of one deformable object of a world."""
    # Imported here: a world needs only its own materials, and the mesher of soft bodies is heavy.
    if isinstance(item, Rope):
        from polyworld.meshing.rope import rope_mesh

        return rope_mesh(world, item)
    if isinstance(item, Cloth):
        from polyworld.meshing.cloth import cloth_mesh

        return cloth_mesh(item)
    if isinstance(item, Soft):
        from polyworld.meshing.soft import soft_mesh

        return soft_mesh(world, item)
    from polyworld.meshing.fluid import fluid_particles

    return fluid_particles(world, item)


__all__ = ["DeformableMesh", "mesh_of"]
