"""A world made ready for work, once: its parts by name, the materials of its objects, their meshes and solids."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.core.kept import BOUNDS, Kept
from polyworld.model.arrays import Overriding, RigidArrays
from polyworld.model.mesh import DeformableMesh
from polyworld.world import Deformable, World, geometry
from polyworld.world.materials import Material, material_of

Array = NDArray[np.float64]


class Model:
    """A world made ready for solvers, readouts and pictures. Parts are made when first asked for, and kept."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.names = world.moving_names
        self.materials: dict[str, Material] = {d.name: material_of(d) for d in world.deformables}
        self._meshes: dict[str, DeformableMesh] = {}

    def mesh(self, name: str) -> DeformableMesh:
        """Nodes and elements of a deformable object; raises KeyError naming the valid choices."""
        if name not in self._meshes:
            item = self.world.deformable(name)
            self._meshes[name] = self.materials[name].mesh(self.world, item)
        return self._meshes[name]

    @cached_property
    def variants(self) -> Overriding:
        """Arrays of variants of the world: states and parameters of rigid bodies, statics, joints and effects."""
        return Overriding(self.world)

    def arrays(self, overrides: Mapping[str, Array] | None = None) -> RigidArrays:
        """Arrays that the rigid solvers read, with some parameters given per world; see `Overriding.arrays`."""
        return self.variants.arrays(overrides or {})

    @property
    def meshes(self) -> dict[str, DeformableMesh]:
        """Meshes of all deformable objects, by name."""
        return {name: self.mesh(name) for name in self.materials}

    @cached_property
    def solids(self) -> tuple[geometry.MassProperties, ...]:
        """Volume, centre and inertia at density 1 of each rigid object, in its own axes."""
        return tuple(geometry.mass_properties(o.shape) for o in self.world.objects)

    @cached_property
    def plane_axes(self) -> Array:
        """Axes (3, 3) of the motion plane: two in it, its normal."""
        return geometry.plane_axes(self.world.environment.motion_plane)

    def size(self, name: str) -> float:
        """Length, area or volume of a deformable object without forces [m], [m^2] or [m^3]."""
        return self.materials[name].size(self.world, self.world.deformable(name), self.mesh(name))


_MODELS: Kept[str, Model] = Kept(BOUNDS.models)


def model_of(world: World) -> Model:
    """The model of a world; the same for equal worlds, while it is kept."""
    return _MODELS.get(world.id, lambda: Model(world))


def mesh_of(world: World, item: Deformable) -> DeformableMesh:
    """The nodes and elements of one deformable object of a world."""
    return model_of(world).mesh(item.name)
