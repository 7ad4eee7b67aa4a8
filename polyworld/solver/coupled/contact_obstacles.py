"""Rigid bodies and statics as the pieces that nodes touch, and the nodes as what may touch."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.core.references import by_reference
from polyworld.solver.coupled.attachment_targets import held_nodes
from polyworld.solver.coupled.contact_layout import Obstacles, Part, Surface
from polyworld.solver.coupled.contact_search import mark_overlaps
from polyworld.solver.coupled.nodes import Nodes
from polyworld.solver.spatial import layout
from polyworld.world import World
from polyworld.world.materials import PLANAR, material_of

# Of its radius. A rope that lay on a wheel with the middles of its segments could swing in zigzag about them; where
# the nodes touch, it cannot.
ROPE_YIELDS = 0.5

Array = NDArray[np.float64]
Ints = NDArray[np.int32]


def no_obstacles(n_worlds: int) -> Obstacles:
    """Return what a world without rigid bodies has: no pieces, and one body that nothing touches."""
    obstacles = Obstacles()
    obstacles.bodies = buffers.zeros((n_worlds, 1), layout.Body)
    obstacles.geometry = by_reference(layout.Geometry(), layout.Geometry)
    obstacles.parts = buffers.zeros((0,), Part)
    return obstacles


def build_obstacles(geometry: layout.Geometry, bodies: Any) -> Obstacles:
    """Build the pieces of all bodies (W, B), in the order of their shapes."""
    shapes = buffers.read(geometry.shapes)
    vertices = buffers.read(geometry.vertices)
    first = buffers.read(geometry.first_shape)
    offset, rotation = buffers.read(geometry.offset), buffers.read(geometry.rotation)
    rows = np.zeros(int(first[-1]), dtype=Part.numpy_dtype())
    points: list[Array] = []
    owners: list[int] = []
    radii: list[float] = []
    for body, (low, high) in enumerate(itertools.pairwise(first)):
        for s in range(low, high):
            corners, radius = _corners(shapes[s], vertices)
            row = rows[s]
            row["shape"], row["body"] = s, body
            row["first_corner"], row["corners"] = len(points), len(corners)
            row["position"], row["rotation"] = offset[s], rotation[s]
            row["bound"] = 0.0 if shapes[s]["kind"] == layout.PLANE else shapes[s]["bound"]
            points.extend(np.asarray(rotation[s]) @ c + offset[s] for c in corners)
            owners.extend([body] * len(corners))
            radii.extend([radius] * len(corners))
    obstacles = Obstacles()
    obstacles.bodies = bodies
    obstacles.geometry = by_reference(geometry, layout.Geometry)
    obstacles.parts = buffers.array(rows, Part)
    obstacles.corners = buffers.array(np.array(points or [np.zeros(3)]), wp.vec3d)
    obstacles.corner_body = buffers.ints(owners or [0])
    obstacles.corner_radius = buffers.doubles(radii or [0.0])
    return obstacles


def _corners(shape: Any, vertices: Array) -> tuple[list[Array], float]:
    """Points of a shape that may press into a triangle between its nodes, in the shape's axes, and their radius."""
    size = np.asarray(shape["size"])
    kind = int(shape["kind"])
    if kind == layout.SPHERE:
        return [np.zeros(3)], float(size[0])
    if kind == layout.CAPSULE:
        return [np.array([0.0, 0.0, s * size[2]]) for s in (-1.0, 1.0)], float(size[0])
    if kind == layout.BOX:
        return [size * (x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], 0.0
    if kind == layout.CONVEX:
        first = int(shape["first_vertex"])
        return list(vertices[first : first + int(shape["vertices"])]), 0.0
    return [], 0.0


def build_surface(world: World, meshes: dict[str, DeformableMesh], first: dict[str, int], nodes: int) -> Surface:
    """Build the nodes, edges and faces that may touch, but for `excluded`. first: each object's first node."""
    exposed = np.zeros(nodes, dtype=np.int32)
    edges: list[Ints] = [np.zeros((0, 2), dtype=np.int32)]
    sides: list[Ints] = [np.zeros((0, 2), dtype=np.int32)]
    triangles: list[Ints] = [np.zeros((0, 3), dtype=np.int32)]
    begin = np.zeros(len(world.deformables), dtype=np.int32)
    count = np.zeros(len(world.deformables), dtype=np.int32)
    one_sided = np.zeros(len(world.deformables), dtype=np.int32)
    yielding = np.zeros(len(world.deformables))
    for d, item in enumerate(world.deformables):
        if item.name not in first:
            continue
        mesh, form = meshes[item.name], material_of(item).form
        begin[d], count[d] = first[item.name], len(mesh.nodes)
        yielding[d] = ROPE_YIELDS if form == "line" else 0.0
        one_sided[d] = form == "solid"
        edges.append(begin[d] + surface_edges(mesh))
        if form == "solid" and item.representation.endswith(PLANAR):
            sides.append((begin[d] + mesh.segments).astype(np.int32))
        else:
            triangles.append((begin[d] + mesh.triangles).astype(np.int32))
        used = surface_edges(mesh).ravel()
        exposed[begin[d] + used] = 1
    surface = Surface()
    surface.edges = buffers.array(np.concatenate(edges).astype(np.int32), wp.int32)
    surface.triangles = buffers.array(np.concatenate(triangles).astype(np.int32), wp.int32)
    surface.sides = buffers.array(np.concatenate(sides).astype(np.int32), wp.int32)
    normal = np.asarray(world.environment.motion_plane.normal, dtype=float)
    surface.across = wp.vec3d(*(normal / np.linalg.norm(normal)))
    surface.radius = buffers.doubles(np.concatenate([meshes[name].radius for name in first] or [np.zeros(0)]))
    surface.friction = buffers.zeros((1, len(world.deformables)), wp.float64)
    surface.restitution = buffers.zeros((1, len(world.deformables)), wp.float64)
    surface.exposed = buffers.array(exposed, wp.int32)
    surface.one_sided = buffers.array(one_sided, wp.int32)
    surface.yielding = buffers.array(yielding, wp.float64)
    surface.first = buffers.array(begin, wp.int32)
    surface.count = buffers.array(count, wp.int32)
    return surface


def surface_edges(mesh: DeformableMesh) -> Ints:
    """Edges (E, 2) by which an object touches: a rope's segments, the edges of its triangles, or, of a slice of
    triangles in a plane, its outline.
    """
    if len(mesh.segments):
        return mesh.segments
    pairs = np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]])
    found: Ints = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int32)
    return found


def excluded_bodies(
    world: World,
    meshes: dict[str, DeformableMesh],
    first: dict[str, int],
    nodes: Nodes,
    surface: Surface,
    obstacles: Obstacles,
) -> Any:
    """Find which nodes must not touch which bodies (N, B): those held to a body, those that lie in it at the start and
    belong to an object that is fastened to it, and ropes that run over a pulley it carries.

    first: the row of each object's first node.
    """
    names = [o.name for o in world.objects]
    owners = {d.name: k for k, d in enumerate(world.deformables)}
    excluded = np.zeros((nodes.x.shape[1], obstacles.bodies.shape[1]), dtype=np.int32)
    linked = np.zeros((len(owners), excluded.shape[1]), dtype=np.int32)
    for attachment in world.attachments:
        if attachment.to in names:
            body = names.index(attachment.to)
            linked[owners[attachment.object], body] = 1
            excluded[held_nodes(meshes, attachment) + first[attachment.object], body] = 1
    for pulley in world.pulleys:
        if pulley.object is not None:
            own = np.arange(len(meshes[pulley.rope].nodes)) + first[pulley.rope]
            excluded[own, names.index(pulley.object)] = 1
    marked = buffers.ints(excluded)
    if not linked.any():
        return marked
    positions = np.concatenate([meshes[name].nodes for name in first])
    buffers.launch(
        mark_overlaps,
        (nodes.x.shape[1], obstacles.parts.shape[0]),
        [buffers.array(positions, wp.vec3d), buffers.ints(linked), nodes, surface, obstacles, marked],
    )
    return marked
