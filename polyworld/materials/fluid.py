"""Fluids: everything the engine knows of them, by reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from polyworld.model.mesh import DeformableMesh
from polyworld.world import World, geometry
from polyworld.world.materials import Material, Place
from polyworld.world.parameter_tables import ParameterSpec
from polyworld.world.representations.fluid import Fluid

if TYPE_CHECKING:
    from polyworld.pictures.deformable_pictures import View
    from polyworld.pictures.scene import Surface

PARAMETERS = {
    "density": ParameterSpec("kg/m^3", 1e-2, 1e6, (300.0, 3e3), "density"),
    "viscosity": ParameterSpec("Pa s", 0.0, 1e6, (1e-3, 10.0), "dynamic viscosity"),
    "surface_tension": ParameterSpec("N/m", 0.0, 1e3, (0.0, 0.1), "surface tension against air"),
}


def _mesh(world: World, item: Fluid) -> DeformableMesh:
    from polyworld.solver.fluid.seeding import fluid_particles  # measures distances by kernels

    return fluid_particles(world, item)


def _moved(item: dict[str, Any], place: Place, turn: Any) -> None:
    for volume in item["volumes"]:
        volume["position"] = place(volume["position"])
        if turn is not None:
            product = geometry.quaternion_product(turn, np.asarray(volume["orientation"]))
            volume["orientation"] = tuple(float(x) for x in product)


def _facts(world: World, item: Fluid, _mesh: DeformableMesh) -> dict[str, Any]:
    emitters = [e.name for e in world.emitters if e.fluid == item.name]
    return {"fed_by": emitters} if emitters else {}


def _picture(world: World, item: Fluid, mesh: DeformableMesh, points: Any, view: View) -> Surface:
    from polyworld.pictures.deformable_pictures import fluid_surface

    return fluid_surface(world, item, mesh, points, view)


MATERIAL = Material(
    kind="fluid",
    description=Fluid,
    form="liquid",
    density="density",
    parameters=PARAMETERS,
    fitted=("viscosity",),
    mesh=_mesh,
    kernels="polyworld.solver.fluid",
    moved=_moved,
    picture=_picture,
    facts=_facts,
    color="#408cd2",
    opacity=0.75,
)
