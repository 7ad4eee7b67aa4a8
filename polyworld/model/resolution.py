"""Find meshes and cells that are too coarse for what they carry, and the number that would resolve it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.model.model import model_of
from polyworld.model.soft import edge_length
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Capsule, Compound, Cylinder, Sphere

Array = NDArray[np.float64]

# Cells across a body in a liquid: the fewest for which the verification cases hold draft and lift to their tolerances.
CELLS = 5.0
# Angle that a segment of a rope spans on a drum [rad]: the polygon then lies within 1.2% of the radius of the circle.
TURN = 0.3
# Distance of a soft body's flat faces from its round surface that is worth a word, over its radius.
FLAT = 0.02


def resolution_notes(world: World) -> tuple[str, ...]:
    """Say what is under-resolved: bodies in coarse liquids, ropes on drums, round soft bodies of few elements."""
    return (*_in_liquid(world), *_on_drums(world), *_round(world))


def _in_liquid(world: World) -> list[str]:
    grid = world.fluid_grid
    if grid is None:
        return []
    found = []
    low, high = np.asarray(grid.lower), np.asarray(grid.upper)
    for item in world.objects:
        place = np.asarray(item.position)
        wide = [a for a in (0, 1) if high[a] > low[a]]
        if not all(low[a] <= place[a] <= high[a] for a in wide):
            continue
        across = _thickness(item.shape)
        if across < CELLS * grid.cell * (1.0 - 1e-9):
            found.append(
                f"{item.name}: {across / grid.cell:.2g} cells across in the fluid grid; below {CELLS:g} its draft, "
                f"drag and lift are rough: fluid_grid.cell {across / CELLS:.3g} m resolves it"
            )
    return found


def _thickness(shape: geometry.Solid) -> float:
    """Smallest extent of a body; of one of several pieces, of its thickest [m]."""
    if isinstance(shape, Compound):
        return max(_thickness(piece.shape) for piece in geometry.pieces(shape))
    if isinstance(shape, Sphere | Capsule):
        return 2.0 * shape.radius
    if isinstance(shape, Cylinder):
        return 2.0 * min(shape.radius, shape.half_height)
    if isinstance(shape, Box):
        return 2.0 * min(shape.half_extents)
    return float(np.ptp(np.asarray(shape.vertices), axis=0).min())


def _on_drums(world: World) -> list[str]:
    found = []
    for rope in world.deformables:
        if not isinstance(rope, Rope):
            continue
        held = {a.to for a in world.attachments if a.object == rope.name}
        nodes = model_of(world).mesh(rope.name).nodes
        length = model_of(world).size(rope.name)
        bodies: list[RigidObject | StaticObject] = [*world.objects, *world.statics]
        for item in bodies:
            if not isinstance(item.shape, Cylinder | Capsule) or item.name in held:
                continue
            radius = item.shape.radius + rope.radius
            apart = np.linalg.norm(nodes - np.asarray(item.position), axis=1).min()
            if apart < length + radius + item.shape.half_height and length / rope.segments > TURN * radius:
                found.append(
                    f"rope {rope.name}: segments of {length / rope.segments:.3g} m are coarse for the curve of "
                    f"{item.name} (radius {item.shape.radius:g} m): segments {int(np.ceil(length / (TURN * radius)))} "
                    "follow it"
                )
    return found


def _round(world: World) -> list[str]:
    found = []
    for item in world.deformables:
        if not isinstance(item, Soft) or not isinstance(item.shape, Sphere | Cylinder | Capsule):
            continue
        mesh = model_of(world).mesh(item.name)
        faces = mesh.segments if item.representation.endswith("planar") else mesh.triangles
        sides = np.linalg.norm(mesh.nodes[faces[:, 0]] - mesh.nodes[faces[:, 1]], axis=1)
        # The height of an arc of radius R over a chord c is c^2 / 8 R; over a triangle of sides c, c^2 / 6 R.
        part = 8.0 if item.representation.endswith("planar") else 6.0
        lies = float(np.median(sides)) ** 2 / (part * item.shape.radius**2)
        if lies > FLAT:
            layers = max(1, round(item.shape.radius / edge_length(item)))
            finer = item.shape.radius / np.ceil(layers * np.sqrt(lies / FLAT))
            found.append(
                f"soft body {item.name}: its faces lie up to {lies:.1%} of its radius inside its round surface, and it "
                f"rests that much lower: resolution {finer:.3g} m brings that below {FLAT:.0%}"
            )
    return found
