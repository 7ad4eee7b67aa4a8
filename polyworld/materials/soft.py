"""Soft bodies: everything the engine knows of them, by reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polyworld.model.mesh import DeformableMesh
from polyworld.world import World
from polyworld.world.materials import PLANAR, Material, Place
from polyworld.world.parameter_tables import COMMON, TAU, ParameterSpec
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Capsule, Cylinder, Sphere

if TYPE_CHECKING:
    from polyworld.solver.soft.stage import SoftStage

FLAT = 0.02  # distance of flat faces from a round surface that is worth a note, over its radius

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


def _notes(_world: World, item: Soft, mesh: DeformableMesh) -> list[str]:
    """State how far its flat faces lie inside a round surface."""
    from polyworld.model.soft import edge_length

    if not isinstance(item.shape, Sphere | Cylinder | Capsule):
        return []
    planar = item.representation.endswith(PLANAR)
    faces = mesh.segments if planar else mesh.triangles
    sides = np.linalg.norm(mesh.nodes[faces[:, 0]] - mesh.nodes[faces[:, 1]], axis=1)
    # The height of an arc of radius R over a chord c is c^2 / 8 R; over a triangle of sides c, c^2 / 6 R.
    lies = float(np.median(sides)) ** 2 / ((8.0 if planar else 6.0) * item.shape.radius**2)
    if lies <= FLAT:
        return []
    layers = max(1, round(item.shape.radius / edge_length(item)))
    finer = item.shape.radius / np.ceil(layers * np.sqrt(lies / FLAT))
    return [
        f"soft body {item.name}: its faces lie up to {lies:.1%} of its radius inside its round surface, and it "
        f"rests that much lower: resolution {finer:.3g} m brings that below {FLAT:.0%}"
    ]


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
    notes=_notes,
)
