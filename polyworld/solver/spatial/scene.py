"""A world's shapes as the arrays the kernels read."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.core import buffers
from polyworld.model import Model
from polyworld.solver.spatial import layout
from polyworld.world import StaticObject, World, geometry
from polyworld.world.shapes import Box, Capsule, Compound, Cylinder, Plane, Sphere, TriangleMesh, Wall

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]

INSET = 0.02  # depth of a shape's core below its surface, as a fraction of the smallest half extent


@dataclass
class _Tables:
    """Rows that grow as shapes are added."""

    shapes: list[dict[str, Any]] = field(default_factory=list)
    vertices: list[Array] = field(default_factory=list)
    normals: list[Array] = field(default_factory=list)
    starts: list[int] = field(default_factory=lambda: [0])
    corners: list[int] = field(default_factory=list)
    active: list[int] = field(default_factory=list)
    trees: list[Any] = field(default_factory=list)


def build_geometry(model: Model) -> tuple[layout.Geometry, list[Any]]:
    """Geometry of a world's model, and the trees that must live as long as it is used."""
    tables, world = _Tables(), model.world
    pieces = [geometry.pieces(o.shape) for o in world.objects]
    for piece in chain.from_iterable(pieces):
        _add(tables, piece.shape)
    for static in world.statics:
        _add_static(tables, static)
    g = layout.Geometry()
    rows = np.zeros(len(tables.shapes), dtype=layout.Shape.numpy_dtype())
    for i, shape in enumerate(tables.shapes):
        for name, value in shape.items():
            rows[name][i] = value
    g.shapes = buffers.array(rows, layout.Shape)
    _place_shapes(g, world, pieces, tables)
    g.vertices = _array(tables.vertices, wp.vec3d)
    g.face_normals = _array(tables.normals, wp.vec3d)
    g.face_starts = _array(tables.starts, wp.int32)
    g.face_corners = _array(tables.corners, wp.int32)
    g.edge_active = _array(tables.active, wp.int32)
    g.tree = _array([0 if t is None else t.id for t in tables.trees], wp.uint64)
    inertia = [s.inertia / s.volume for s in model.solids]
    g.inertia = _array(inertia, wp.mat33d)
    g.inverse_inertia = _array([np.linalg.inv(i) for i in inertia], wp.mat33d)
    g.radius = _array([(0.75 * s.volume / np.pi) ** (1.0 / 3.0) for s in model.solids], wp.float64)
    return g, tables.trees


def _place_shapes(g: layout.Geometry, world: World, pieces: list[tuple[geometry.Piece, ...]], tables: _Tables) -> None:
    """Find which shapes each body has and where they lie in its axes; statics have one, at their origin."""
    statics = len(world.statics)
    g.first_shape = _array(np.cumsum([0, *(len(p) for p in pieces), *[1] * statics]), wp.int32)
    placed = [int(isinstance(o.shape, Compound)) for o, own in zip(world.objects, pieces, strict=True) for _ in own]
    g.placed = _array(placed + [0] * statics, wp.int32)
    objects = list(chain.from_iterable(pieces))
    g.offset = _array([p.position for p in objects] + [np.zeros(3)] * statics, wp.vec3d)
    g.rotation = _array([p.rotation for p in objects] + [np.eye(3)] * statics, wp.mat33d)
    own = [geometry.circumscribed_radius(o.shape) for o in world.objects]
    g.bound = _array(own + [shape["bound"] for shape in tables.shapes[len(objects) :]], wp.float64)
    g.collides = buffers.ints(~world.passing())
    if world.planar:
        normal = np.asarray(world.environment.motion_plane.normal, dtype=float)
        g.lock = wp.vec3d(*(normal / np.linalg.norm(normal)))


def _add(tables: _Tables, shape: geometry.ConvexShape) -> None:
    tables.trees.append(None)
    if isinstance(shape, Sphere):
        row = {"kind": layout.SPHERE, "size": (shape.radius, 0, 0), "bound": shape.radius}
    elif isinstance(shape, Box):
        half = np.asarray(shape.half_extents)
        row = {"kind": layout.BOX, "size": half, "bound": np.linalg.norm(half), "inset": INSET * half.min()}
    elif isinstance(shape, Cylinder):
        r, h = shape.radius, shape.half_height
        row = {"kind": layout.CYLINDER, "size": (r, r, h), "bound": np.hypot(r, h), "inset": INSET * min(r, h)}
    elif isinstance(shape, Capsule):
        r, h = shape.radius, shape.half_height
        row = {"kind": layout.CAPSULE, "size": (r, r, h), "bound": r + h}
    else:
        row = _add_hull(tables, geometry.hull(shape))
    tables.shapes.append(row)


def _add_hull(tables: _Tables, hull: trimesh.Trimesh) -> dict[str, Any]:
    """Return a convex mesh's vertices and its flat faces, triangles of one plane joined."""
    vertices = np.asarray(hull.vertices, dtype=float)
    offset, first = len(tables.vertices), len(tables.normals)
    tables.vertices.extend(vertices)
    normals = np.asarray(hull.face_normals, dtype=float)
    scale = float(np.linalg.norm(vertices, axis=1).max())
    left = set(range(len(normals)))
    while left:
        f = min(left)
        normal, origin = normals[f], vertices[hull.faces[f][0]]
        flat = np.abs((vertices - origin) @ normal) < 1e-7 * scale
        left -= {k for k in left if flat[hull.faces[k]].all() and normals[k] @ normal > 0}
        corners = np.flatnonzero(flat)
        centre = vertices[corners].mean(axis=0)
        x = vertices[corners[0]] - centre
        x /= np.linalg.norm(x)
        y = np.cross(normal, x)
        spokes = vertices[corners] - centre
        corners = corners[np.argsort(np.arctan2(spokes @ y, spokes @ x), kind="stable")]
        tables.normals.append(normal)
        tables.corners.extend(int(c) + offset for c in corners)
        tables.starts.append(len(tables.corners))
        tables.active.append(7)
    return {
        "kind": layout.CONVEX,
        "first_vertex": offset,
        "vertices": len(vertices),
        "first_face": first,
        "faces": len(tables.normals) - first,
        "bound": scale,
        # The core is the hull shrunk to 1 - INSET about its centre of mass.
        "inset": INSET * scale,
    }


def _add_static(tables: _Tables, static: StaticObject) -> None:
    shape = static.shape
    if isinstance(shape, Plane):
        orientation = geometry.quaternion_matrix(np.asarray(static.orientation, dtype=float))
        normal = np.asarray(shape.normal, dtype=float)
        normal = orientation @ (normal / np.linalg.norm(normal))
        offset = shape.offset + float(normal @ np.asarray(static.position, dtype=float))
        tables.shapes.append({"kind": layout.PLANE, "size": normal, "bound": offset})
        tables.trees.append(None)
    elif isinstance(shape, Wall):
        _add(tables, geometry.wall_box(shape)[0])
    elif isinstance(shape, TriangleMesh):
        _add_triangles(tables, shape)
    else:
        _add(tables, shape)


def _add_triangles(tables: _Tables, shape: TriangleMesh) -> None:
    vertices = np.asarray(shape.vertices, dtype=float)
    faces = np.asarray(shape.faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    flat = lengths > 1e-12 * (np.ptp(vertices, axis=0).max() ** 2)
    if not flat.any():
        raise ValueError("a triangle mesh needs at least one triangle with an area")
    faces, corners, normals = faces[flat], corners[flat], normals[flat] / lengths[flat, None]
    first_vertex, first_face = len(tables.vertices), len(tables.normals)
    tables.vertices.extend(corners.reshape(-1, 3))
    tables.normals.extend(normals)
    for k in range(len(faces)):
        tables.corners.extend(range(first_vertex + 3 * k, first_vertex + 3 * k + 3))
        tables.starts.append(len(tables.corners))
    tables.active.extend(_active_edges(vertices, faces, normals))
    low, high = corners.min(axis=1), corners.max(axis=1)
    # The tree has single precision: widen its boxes so that none gets too small by rounding.
    grain = 1e-6 * max(1.0, float(np.abs(vertices).max()))
    tree = wp.Bvh(
        buffers.array((low - grain).astype(np.float32), wp.vec3),
        buffers.array((high + grain).astype(np.float32), wp.vec3),
    )
    tables.trees.append(tree)
    tables.shapes.append(
        {
            "kind": layout.MESH,
            "first_vertex": first_vertex,
            "vertices": 3 * len(faces),
            "first_face": first_face,
            "faces": len(faces),
            "bound": float(np.linalg.norm(vertices, axis=1).max()),
        }
    )


def _active_edges(vertices: Array, faces: NDArray[Any], normals: Array) -> list[int]:
    """Per face, bit k set where edge k (corner k to k + 1) is a border or convex: not where the surface goes on."""
    # Vertices at one place count as one, so that unwelded meshes have no seams.
    _, same = np.unique(
        np.round(vertices / max(float(np.ptp(vertices, axis=0).max()), 1e-12), 9), axis=0, return_inverse=True
    )
    welded = np.asarray(same).reshape(-1)[faces]
    across: dict[tuple[int, int], int] = {}
    for f, face in enumerate(welded):
        for k in range(3):
            across[int(face[k]), int(face[(k + 1) % 3])] = f
    masks = []
    for f, face in enumerate(welded):
        mask = 0
        for k in range(3):
            other = across.get((int(face[(k + 1) % 3]), int(face[k])))
            if other is None:
                mask |= 1 << k
                continue
            opposite = vertices[faces[other]].mean(axis=0) - vertices[faces[f][k]]
            # Convex where the neighbour falls away behind this face; a twentieth of a degree counts as flat.
            if opposite @ normals[f] < -1e-3 * np.linalg.norm(opposite):
                mask |= 1 << k
        masks.append(mask)
    return masks


def box_orientation(rotation: Array) -> Array:
    """Quaternion (4,) w, x, y, z of a rotation matrix (3, 3)."""
    q: Array = np.roll(Rotation.from_matrix(rotation).as_quat(), 1)
    return q


def _array(rows: Any, dtype: Any) -> Any:
    if len(rows) == 0:
        return buffers.zeros(1, dtype)
    return buffers.array(np.asarray(rows), dtype)
