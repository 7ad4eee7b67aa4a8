"""Deformable objects in a picture: for each material a function from its points to the form that shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.model import DeformableMesh, mesh_of
from polyworld.pictures.liquid_surface import liquid_surface
from polyworld.pictures.scene import Rods, Surface, smooth_surface
from polyworld.probing.readouts.rope_line import along_wheels
from polyworld.world import Deformable, World
from polyworld.world.camera import Camera
from polyworld.world.materials import material_of
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Fluid
from polyworld.world.representations.rope import Pulley, Rope

Array = NDArray[np.float64]

THINNEST = 0.8  # [px] radius of a rope that would be thinner than that
CHECKS = 6  # checks along an edge of a cloth, faint: they show how it is stretched and folded
CHECK_CONTRAST = 0.10
STRIPE = 0.12  # contrast between the halves of a rope's stripes, of which there are STRIPES
STRIPES = 16


@dataclass(frozen=True)
class View:
    """How a world is seen: the camera, and the pulleys where they now are."""

    camera: Camera
    wheels: Sequence[Pulley]


def starting_points(world: World) -> dict[str, Array]:
    """Points (k, 3) [m] of every deformable object as it starts, by name."""
    return {item.name: mesh_of(world, item).nodes for item in world.deformables}


def drawn_deformable(world: World, item: Deformable, points: Array, view: View) -> Surface | Rods:
    """Return the form of a deformable object whose points are at (k, 3) [m]."""
    picture = material_of(item).picture or mesh_surface
    return picture(world, item, mesh_of(world, item), np.asarray(points, dtype=float), view)


def mesh_surface(_world: World, _item: Deformable, mesh: DeformableMesh, points: Array, _view: View) -> Surface:
    """Return the triangles of a mesh: the form of a material that has no function of its own."""
    return smooth_surface(points, mesh.triangles)


def cloth_surface(_world: World, item: Cloth, mesh: DeformableMesh, points: Array, _view: View) -> Surface:
    """Return the triangles of a cloth, those of a sheet in faint checks fixed to it."""
    sheet = item.geometry
    if not isinstance(sheet, Sheet):
        return smooth_surface(points, mesh.triangles)
    edges = np.stack([sheet.edge_u, sheet.edge_v], axis=1)
    lengths = np.linalg.norm(edges, axis=0)
    centres = mesh.nodes[mesh.triangles].mean(axis=1) - np.asarray(sheet.corner)
    shares = np.linalg.lstsq(edges, centres.T, rcond=None)[0]
    squares = np.floor(shares * lengths[:, None] * CHECKS / lengths.min())
    return smooth_surface(points, mesh.triangles, 1.0 - CHECK_CONTRAST * (squares.sum(axis=0) % 2))


def rope_rods(_world: World, item: Rope, mesh: DeformableMesh, points: Array, view: View) -> Rods:
    """Return rods along a rope's line, striped, and no thinner than can be seen."""
    line, number = along_wheels(item.name, points, [wheel for wheel in view.wheels if wheel.rope == item.name])
    whole = np.all(np.isfinite(line[:-1]) & np.isfinite(line[1:]), axis=1)
    starts, ends, number = line[:-1][whole], line[1:][whole], number[whole]
    depth = np.maximum(view.camera.to_camera(starts)[:, 2], view.camera.to_camera(ends)[:, 2])
    radii = np.maximum(item.radius, THINNEST * np.maximum(depth, 0.0) / view.camera.intrinsics[0][0])
    wide = max(1, round(len(mesh.segments) / STRIPES))
    return Rods(starts, ends, radii, np.where((number // wide) % 2 == 1, 1.0 - STRIPE, 1.0))


def fluid_surface(world: World, _item: Fluid, _mesh: DeformableMesh, points: Array, _view: View) -> Surface:
    """Return the closed surface around a fluid's particles, inside the box that holds it."""
    assert world.fluid_grid is not None  # a world with a fluid has one
    return liquid_surface(points, world.fluid_grid)
