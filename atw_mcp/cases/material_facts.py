"""Facts about a deformable object in a few numbers: size, mass, resolution, where it starts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.meshing.rope import threading, unit_axis
from polyworld.pictures.deformable_pictures import mesh_for
from polyworld.world import Deformable, World
from polyworld.world.representations.cloth import Cloth
from polyworld.world.representations.fluid import Fluid
from polyworld.world.representations.rope import Rope

ARC_POINTS = 91  # at which the rope's way round a wheel is followed

SIZE = {"rope": ("length", "m"), "cloth": ("area", "m^2"), "soft": ("volume", "m^3"), "fluid": ("volume", "m^3")}


def about_deformable(world: World, item: Deformable) -> dict[str, Any]:
    """Return name, kind, size, mass [kg], numbers of nodes and elements, and the box [m] it starts in."""
    mesh = mesh_for(world, item)
    size, _ = SIZE[item.representation.removesuffix("_planar")]
    facts: dict[str, Any] = {
        "name": item.name,
        "representation": item.representation,
        "color": item.appearance.color,
        size: _measure(world, item),
        "mass": mass(world, item),
    }
    if item.representation == "fluid_planar":
        facts["area"] = facts.pop("volume")
    if isinstance(item, Fluid):
        facts["particles"] = len(mesh.nodes)
        emitters = [e.name for e in world.emitters if e.fluid == item.name]
        if emitters:
            facts["fed_by"] = emitters
    else:
        facts["nodes"] = len(mesh.nodes)
        elements = {"segments": mesh.segments, "tetrahedra": mesh.tetrahedra, "triangles": mesh.triangles}
        facts |= {kind: len(rows) for kind, rows in elements.items() if len(rows)}
        held = [a.name for a in world.attachments if item.name in (a.object, a.to)]
        if held:
            facts["held_by"] = held
    if isinstance(item, Rope):
        thread = threading(world, item)
        facts["ends"] = [mesh.nodes[0].tolist(), mesh.nodes[-1].tolist()]
        turns = {p.name: round(float(np.degrees(a)), 1) for p, a in zip(thread.pulleys, thread.wrap, strict=True)}
        if turns:
            facts["wraps_deg"] = turns  # a pulley passed on the wrong side shows here
    if isinstance(item, Cloth):
        facts["thickness"] = item.thickness
    if len(mesh.nodes):
        reach = np.concatenate([mesh.nodes, _on_wheels(world, item)])
        facts["starts_in"] = [reach.min(axis=0).tolist(), reach.max(axis=0).tolist()]
    if getattr(item, "start_time", 0.0):
        facts["start_frame"] = round(getattr(item, "start_time", 0.0) / world.time.seconds_per_frame)
    return facts


def _on_wheels(world: World, item: Deformable) -> NDArray[np.float64]:
    """Points (k, 3) of a rope's way round its wheels, on which it has no nodes."""
    points = [np.zeros((0, 3))]
    if isinstance(item, Rope):
        thread = threading(world, item)
        for pulley, start, angle in zip(thread.pulleys, thread.arrives, thread.wrap, strict=True):
            centre, axis = np.asarray(pulley.centre, dtype=float), unit_axis(pulley)
            out = start - centre
            turn = np.linspace(0.0, angle, ARC_POINTS)[:, None]
            points.append(centre + np.cos(turn) * out + np.sin(turn) * np.cross(axis, out))
    return np.concatenate(points)


def mass(world: World, item: Deformable) -> float:
    """Mass [kg] at the start; of a planar fluid per metre of thickness."""
    measure = _measure(world, item)
    if isinstance(item, Rope):
        return item.linear_density * measure
    return (item.areal_density if isinstance(item, Cloth) else item.density) * measure


def size_of(world: World, item: Deformable) -> tuple[str, float, str]:
    """Length, area or volume of a deformable object at rest: the word for it, its value and its unit."""
    word, unit = SIZE[item.representation.removesuffix("_planar")]
    if item.representation == "fluid_planar":
        word, unit = "area", "m^2"
    return word, _measure(world, item), unit


def _measure(world: World, item: Deformable) -> float:
    """Length, area or volume without forces; of a rope with what lies on its pulleys."""
    if isinstance(item, Rope):
        return float(threading(world, item).rest.sum())
    return float(mesh_for(world, item).measure.sum())


def nodes_of(world: World, item: Deformable, most: int) -> dict[str, Any]:
    """Where nodes start, evenly picked: index and place [m]; attachments hold nodes by index."""
    nodes = mesh_for(world, item).nodes
    picked = [int(i) for i in np.unique(np.rint(np.linspace(0, len(nodes) - 1, min(most, len(nodes)))))]
    return {"of": len(nodes), "index": picked, "place": [nodes[i].tolist() for i in picked]}
