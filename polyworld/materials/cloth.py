"""Cloth: everything the engine knows of it, by reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polyworld.model.cloth import cloth_mesh
from polyworld.model.mesh import DeformableMesh
from polyworld.world import World, geometry
from polyworld.world.materials import Material, Place
from polyworld.world.parameter_tables import COMMON, TAU, ParameterSpec
from polyworld.world.representations.cloth import Cloth

if TYPE_CHECKING:
    from polyworld.pictures.deformable_pictures import View
    from polyworld.pictures.scene import Surface
    from polyworld.solver.cloth.stage import ClothStage

PARAMETERS = {
    "areal_density": ParameterSpec("kg/m^2", 1e-4, 1e4, (0.05, 1.0), "mass per area"),
    "stretch_stiffness": ParameterSpec("N/m", 1e-3, 1e9, (10.0, 5e3), "E t: force per width and strain"),
    "poisson_ratio": ParameterSpec("1", -0.9, 0.49, (0.0, 0.45), "Poisson ratio in the sheet"),
    "shear_stiffness": ParameterSpec("N/m", 1e-3, 1e9, (1.0, 2e3), "G t"),
    "bending_stiffness": ParameterSpec("N m", 0.0, 1e6, (1e-7, 1e-2), "D: moment per width and curvature"),
    "stretch_damping": ParameterSpec("s", 0.0, 1e3, TAU, "damping time of stretching"),
    "bending_damping": ParameterSpec("s", 0.0, 1e3, TAU, "damping time of bending"),
    "drag_normal": ParameterSpec("1", 0.0, 1e3, (0.0, 3.0), "drag coefficient of flow across the sheet"),
    "drag_tangential": ParameterSpec("1", 0.0, 1e3, (0.0, 0.2), "friction coefficient of flow along the sheet"),
    **COMMON,
}


def _mesh(_world: World, item: Cloth) -> DeformableMesh:
    return cloth_mesh(item)


def _stage(world: World, items: Sequence[Cloth], first: dict[str, int], n_worlds: int) -> ClothStage:
    from polyworld.solver.cloth.stage import ClothStage

    return ClothStage(world, items, first, n_worlds)


def _moved(item: dict[str, Any], place: Place, turn: Any) -> None:
    rest = item["geometry"]
    if rest["kind"] == "mesh":
        rest["vertices"] = [place(p) for p in rest["vertices"]]
        return
    rest["corner"] = place(rest["corner"])
    if turn is not None:
        for edge in ("edge_u", "edge_v"):
            x, y, z = geometry.quaternion_matrix(turn) @ np.asarray(rest[edge], dtype=float)
            rest[edge] = (float(x), float(y), float(z))


def _picture(world: World, item: Cloth, mesh: DeformableMesh, points: Any, view: View) -> Surface:
    from polyworld.pictures.deformable_pictures import cloth_surface

    return cloth_surface(world, item, mesh, points, view)


MATERIAL = Material(
    kind="cloth",
    description=Cloth,
    form="sheet",
    density="areal_density",
    parameters=PARAMETERS,
    fitted=("stretch_stiffness", "bending_stiffness", "linear_damping"),
    mesh=_mesh,
    stage=_stage,
    kernels="polyworld.solver.cloth",
    moved=_moved,
    picture=_picture,
    facts=lambda _world, item, _mesh: {"thickness": item.thickness},
    planar=False,
    opacity=0.75,
)
