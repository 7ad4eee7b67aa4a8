"""Warnings where a world does not behave as its description suggests: walls that cover a plane, fluid that is not
there, bodies that nothing holds."""

from __future__ import annotations

import numpy as np

from atw_mcp.worlds.marks import held_nodes
from polyworld.model import mesh_of
from polyworld.solver.fluid.clearance import clearance
from polyworld.solver.fluid.seeding import carvings
from polyworld.world import MotionPlane, StaticObject, World, geometry
from polyworld.world.geometry import quaternion_matrix, wall_box
from polyworld.world.shapes import Box, Wall

CARVED = 0.01  # share of a volume that may be missing without a word
FLAT = 0.99  # cosine of the angle within which a wall lies across the plane's normal
COLUMN = 400  # points at which what lies under a body is looked for


def without_covering_walls(
    statics: tuple[StaticObject, ...], plane: MotionPlane
) -> tuple[tuple[StaticObject, ...], tuple[str, ...]]:
    """Statics of a planar world without the walls wholly ahead of or behind its plane, and the names of those.

    In a planar world a solid reaches through the plane: a wall that lies across its normal would cover all of it.
    """
    dropped = tuple(item.name for item in statics if _beside(item, plane))
    return tuple(item for item in statics if item.name not in dropped), dropped


def _beside(item: StaticObject, plane: MotionPlane) -> bool:
    shape = item.shape
    turn = quaternion_matrix(np.asarray(item.orientation, dtype=float) / np.linalg.norm(item.orientation))
    place = np.asarray(item.position, dtype=float)
    if isinstance(shape, Wall):
        shape, centre, rotation = wall_box(shape)
        place, turn = turn @ centre + place, turn @ rotation
    if not isinstance(shape, Box):
        return False
    normal = np.asarray(plane.normal, dtype=float) / np.linalg.norm(plane.normal)
    along = np.abs(turn.T @ normal)
    half = np.asarray(shape.half_extents, dtype=float)
    thinnest = int(np.argmax(along)) == int(np.argmin(half)) and along.max() > FLAT
    away = abs(float(normal @ (place - np.asarray(plane.point, dtype=float))))
    return bool(thinnest and away >= float(along @ half) - 1e-9)


def fluid_warnings(world: World) -> tuple[str, ...]:
    """Return warnings of what is missing of described fluids and of bodies that may leave a closed grid.

    Raises ValueError for a volume of fluid of which nothing is left, naming what covers it.
    """
    if world.fluid_grid is None:
        return ()
    notes = []
    for item in world.of_form("liquid"):
        for found in carvings(world, item):
            by = ", ".join(f"{name} ({share:.0%})" for name, share in found.by.items())
            if found.lost >= 1.0:
                raise ValueError(
                    f"fluid {item.name!r}: its volume {found.volume + 1} is empty, covered by {by}: move it, or them"
                )
            if found.lost > CARVED:
                notes.append(
                    f"fluid {item.name}: {found.lost:.0%} of its volume {found.volume + 1} is left out, covered by {by}"
                )
    loose = _unsupported(world) if world.fluid_grid.closed else []
    if loose:
        notes.append(
            f"nothing solid is under {', '.join(loose)} in fluid_grid, whose sides hold fluid but no bodies: "
            "add obstacles, e.g. an open_box as the tank, or they may fall out of it"
        )
    return tuple(notes)


def attachment_warnings(world: World) -> tuple[str, ...]:
    """Return warnings of rigid bodies that begin farther from what they are attached to than their own size."""
    notes = []
    for held in world.attachments:
        if held.to is None or not world.is_rigid(held.to):
            continue
        body, nodes = world.object(held.to), mesh_of(world, world.deformable(held.object)).nodes
        apart = np.linalg.norm(nodes[held_nodes(world, held)] - np.asarray(body.position), axis=1)
        if len(apart) and apart.max() > 2.0 * geometry.circumscribed_radius(body.shape):
            x, y, z = body.position
            notes.append(
                f"{held.to} begins at ({x:.3g}, {y:.3g}, {z:.3g}) m, {apart.max():.2g} m from where {held.object} is "
                "attached to it: its track is that of a body on the floor or in motion_plane; give the plane in which "
                "it hangs (BuildWorld, ModelVideo: motion_plane) or attach another part"
            )
    return tuple(notes)


def _unsupported(world: World) -> list[str]:
    """Bodies in or above the fluid grid with no static between them and just below its lower side."""
    box = world.fluid_grid
    assert box is not None
    places = {item.name: np.asarray(item.position, dtype=float) for item in world.objects}
    held = {name for joint in world.joints for name in (joint.object, joint.other) if name is not None}
    held |= {name for a in world.attachments for name in (a.object, a.to) if name is not None}
    for item in world.of_form("sheet", "solid"):
        places[item.name] = mesh_of(world, item).nodes.mean(axis=0)
    grounds = world.model_copy(update={"objects": ()})
    loose = []
    for name, place in places.items():
        if name in held or not all(box.lower[a] <= place[a] <= box.upper[a] for a in (0, 1)):
            continue
        if place[2] < box.lower[2]:
            continue
        heights = np.linspace(place[2], box.lower[2] - box.cell, COLUMN)
        column = np.column_stack([np.full(COLUMN, place[0]), np.full(COLUMN, place[1]), heights])
        reach = abs(heights[1] - heights[0])
        if not world.statics or float(clearance(grounds, column).min()) > reach:
            loose.append(name)
    return loose
