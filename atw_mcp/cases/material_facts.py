"""Facts about a deformable object in a few numbers: size, mass, resolution, where it starts."""

from __future__ import annotations

from typing import Any

import numpy as np

from polyworld.model import mesh_of, model_of
from polyworld.world import Deformable, World
from polyworld.world.materials import BUILT_IN, material_of, measure_of


def about_deformable(world: World, item: Deformable) -> dict[str, Any]:
    """Return name, kind, size, mass [kg], numbers of nodes and elements, and the box [m] it starts in."""
    mesh, material = mesh_of(world, item), material_of(item)
    facts: dict[str, Any] = {
        "name": item.name,
        "representation": item.representation,
        "color": item.appearance.color,
        size_of(world, item)[0]: model_of(world).size(item.name),
        "mass": mass(world, item),
    }
    if material.form == "liquid":
        facts["particles"] = len(mesh.nodes)
    else:
        facts["nodes"] = len(mesh.nodes)
        elements = {"segments": mesh.segments, "tetrahedra": mesh.tetrahedra, "triangles": mesh.triangles}
        facts |= {kind: len(rows) for kind, rows in elements.items() if len(rows)}
        held = [a.name for a in world.attachments if item.name in (a.object, a.to)]
        if held:
            facts["held_by"] = held
    own = material.facts(world, item, mesh)
    facts |= own if material.kind in BUILT_IN else {"facts": own}
    if len(mesh.nodes):
        reach = material.reach(world, item, mesh)
        facts["starts_in"] = [reach.min(axis=0).tolist(), reach.max(axis=0).tolist()]
    if getattr(item, "start_time", 0.0):
        facts["start_frame"] = round(getattr(item, "start_time", 0.0) / world.time.seconds_per_frame)
    return facts


def mass(world: World, item: Deformable) -> float:
    """Mass [kg] at the start; of a planar fluid per metre of thickness."""
    density: float = getattr(item, material_of(item).density)
    return density * model_of(world).size(item.name)


def size_of(world: World, item: Deformable) -> tuple[str, float, str]:
    """Length, area or volume of a deformable object at rest: the word for it, its value and its unit."""
    word, unit = measure_of(item)
    return word, model_of(world).size(item.name), unit


def nodes_of(world: World, item: Deformable, most: int) -> dict[str, Any]:
    """Where nodes start, evenly picked: index and place [m]; attachments hold nodes by index."""
    nodes = mesh_of(world, item).nodes
    picked = [int(i) for i in np.unique(np.rint(np.linspace(0, len(nodes) - 1, min(most, len(nodes)))))]
    return {"of": len(nodes), "index": picked, "place": [nodes[i].tolist() for i in picked]}
