"""Soft bodies: everything the engine knows of them, by reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from polyworld.model.mesh import DeformableMesh
from polyworld.world import World
from polyworld.world.materials import Material, Place
from polyworld.world.parameter_tables import COMMON, TAU, ParameterSpec
from polyworld.world.representations.soft import Soft

if TYPE_CHECKING:
    from polyworld.solver.soft.stage import SoftStage

PARAMETERS = {
    "density": ParameterSpec("kg/m^3", 1e-2, 1e6, (100.0, 5e3), "density"),
    "youngs_modulus": ParameterSpec("Pa", 1e-2, 1e12, (1e3, 1e6), "Young's modulus"),
    "poisson_ratio": ParameterSpec("1", 0.0, 0.49, (0.0, 0.48), "Poisson ratio"),
    "damping": ParameterSpec("s", 0.0, 1e3, TAU, "damping time of deformation"),
    "yield_stress": ParameterSpec("Pa", 1e-2, 1e12, (1e2, 1e6), "von Mises stress beyond which it flows"),
    **COMMON,
}


def _mesh(world: World, item: Soft) -> DeformableMesh:
    from polyworld.model.soft import soft_mesh  # trimesh and its meshers are slow to import

    return soft_mesh(world, item)


def _stage(world: World, items: Sequence[Soft], first: dict[str, int], n_worlds: int) -> SoftStage:
    from polyworld.solver.soft.stage import SoftStage

    return SoftStage(world, items, first, n_worlds)


def _moved(item: dict[str, Any], place: Place, _turn: Any) -> None:
    item["position"] = place(item["position"])


MATERIAL = Material(
    kind="soft",
    description=Soft,
    form="solid",
    density="density",
    parameters=PARAMETERS,
    fitted=("youngs_modulus", "damping"),
    mesh=_mesh,
    stage=_stage,
    kernels="polyworld.solver.soft",
    moved=_moved,
    turns=True,
)
