"""Ropes: everything the engine knows of them, by reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polyworld.model.mesh import DeformableMesh
from polyworld.model.rope import rope_mesh, round_wheels, threading
from polyworld.world import World
from polyworld.world.materials import Material, Place
from polyworld.world.parameter_tables import COMMON, TAU, ParameterSpec
from polyworld.world.representations.rope import Rope

if TYPE_CHECKING:
    from polyworld.pictures.deformable_pictures import View
    from polyworld.pictures.scene import Rods
    from polyworld.solver.rope.stage import RopeStage

PARAMETERS = {
    "linear_density": ParameterSpec("kg/m", 1e-6, 1e5, (0.01, 1.0), "mass per rest length"),
    "stretch_stiffness": ParameterSpec("N", 1e-3, 1e12, (10.0, 1e5), "EA: tension per strain"),
    "bending_stiffness": ParameterSpec("N m^2", 0.0, 1e9, (1e-6, 1e-1), "EI: moment per curvature"),
    "twist_stiffness": ParameterSpec("N m^2", 0.0, 1e9, (1e-6, 1e-1), "GJ: torque per twist rate"),
    "stretch_damping": ParameterSpec("s", 0.0, 1e3, TAU, "damping time of stretching"),
    "bending_damping": ParameterSpec("s", 0.0, 1e3, TAU, "damping time of bending"),
    **COMMON,
}


def _stage(world: World, items: Sequence[Rope], first: dict[str, int], n_worlds: int) -> RopeStage:
    from polyworld.solver.rope.stage import RopeStage

    return RopeStage(world, items, first, n_worlds)


def _moved(item: dict[str, Any], place: Place, _turn: Any) -> None:
    item["points"] = [place(p) for p in item["points"]]


def _facts(world: World, item: Rope, mesh: DeformableMesh) -> dict[str, Any]:
    thread = threading(world, item)
    facts: dict[str, Any] = {"ends": [mesh.nodes[0].tolist(), mesh.nodes[-1].tolist()]}
    turns = {p.name: round(float(np.degrees(a)), 1) for p, a in zip(thread.pulleys, thread.wrap, strict=True)}
    if turns:
        facts["wraps_deg"] = turns  # a pulley passed on the wrong side shows here
    return facts


def _size(world: World, item: Rope, _mesh: DeformableMesh) -> float:
    """Length without tension [m], with what lies on its pulleys."""
    return float(threading(world, item).rest.sum())


def _reach(world: World, item: Rope, mesh: DeformableMesh) -> Any:
    return np.concatenate([mesh.nodes, round_wheels(threading(world, item))])


def _picture(world: World, item: Rope, mesh: DeformableMesh, points: Any, view: View) -> Rods:
    from polyworld.pictures.deformable_pictures import rope_rods

    return rope_rods(world, item, mesh, points, view)


MATERIAL = Material(
    kind="rope",
    description=Rope,
    form="line",
    density="linear_density",
    parameters=PARAMETERS,
    fitted=("bending_stiffness", "linear_damping"),
    mesh=rope_mesh,
    stage=_stage,
    kernels="polyworld.solver.rope",
    moved=_moved,
    picture=_picture,
    facts=_facts,
    size=_size,
    reach=_reach,
)
