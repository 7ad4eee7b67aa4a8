"""Ropes: everything the engine knows of them, by reference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polyworld.model.mesh import DeformableMesh
from polyworld.model.rope import rope_mesh, round_wheels, threading
from polyworld.world import StaticObject, World
from polyworld.world.materials import Material, Place
from polyworld.world.parameter_tables import COMMON, TAU, ParameterSpec
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Capsule, Cylinder

if TYPE_CHECKING:
    from polyworld.pictures.deformable_pictures import View
    from polyworld.pictures.scene import Rods
    from polyworld.solver.rope.stage import RopeStage

# Angle that a segment may span on a drum [rad]: the polygon then lies within 1.2% of the radius of the circle.
TURN = 0.3
TIGHT = 0.01  # strain from which on it is hardly meant: strings and cables are tightened by less
FOLDED = 1.5  # half an angle between links that counts [rad]: a fold has no finite curvature

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


def _notes(world: World, rope: Rope, mesh: DeformableMesh) -> list[str]:
    """State the drums that its segments are too long to follow, and how far it starts stretched."""
    held = {a.to for a in world.attachments if a.object == rope.name}
    length = _size(world, rope, mesh)
    found = _stretched(world, rope)
    bodies: list[RigidObject | StaticObject] = [*world.objects, *world.statics]
    for item in bodies:
        if not isinstance(item.shape, Cylinder | Capsule) or item.name in held:
            continue
        radius = item.shape.radius + rope.radius
        apart = np.linalg.norm(mesh.nodes - np.asarray(item.position), axis=1).min()
        if apart < length + radius + item.shape.half_height and length / rope.segments > TURN * radius:
            found.append(
                f"rope {rope.name}: segments of {length / rope.segments:.3g} m are coarse for the curve of "
                f"{item.name} (radius {item.shape.radius:g} m): segments {int(np.ceil(length / (TURN * radius)))} "
                "follow it"
            )
    return found


def _stretched(world: World, rope: Rope) -> list[str]:
    if rope.length is None:
        return []
    thread = threading(world, rope)
    strain = thread.stretch - 1.0
    if not thread.pulleys:
        strain = float(np.linalg.norm(np.diff(thread.nodes, axis=0), axis=1).sum()) / rope.length - 1.0
    if strain <= TIGHT:
        return []
    return [
        f"rope {rope.name} starts stretched by {100.0 * strain:.1f} %, with a tension of "
        f"{rope.stretch_stiffness * strain:.3g} N: give it length {rope.length * (1.0 + strain):.4g} (or none, for a "
        "start without tension), or shorten its way"
    ]


def _stored(world: World, rope: Rope, mesh: DeformableMesh) -> float:
    rest = float(mesh.measure.sum())
    links = np.diff(mesh.nodes, axis=0)
    lengths = np.linalg.norm(links, axis=1)
    thread = threading(world, rope)
    strains = lengths * len(lengths) / rest - 1.0
    if thread.pulleys:  # their arcs have no nodes
        rest, strains = float(thread.rest.sum()), np.array([thread.stretch - 1.0])
    cell = thread.segment_length
    total = 0.5 * rope.stretch_stiffness * rest * float(np.mean(np.maximum(strains, 0.0) ** 2))
    # A link that is pushed together bears its Euler load at most (`solver.rope.stretch`).
    total += np.pi**2 * rope.bending_stiffness / cell**2 * float(np.maximum(cell - lengths, 0.0).sum())
    if rope.bending_stiffness > 0.0 and not rope.curved_at_rest:
        unit = links / lengths[:, None]
        half = 0.5 * np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1.0, 1.0))
        total += 2.0 * rope.bending_stiffness / cell * float((np.tan(np.minimum(half, FOLDED)) ** 2).sum())
    return float(total)


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
    notes=_notes,
    stored=_stored,
)
