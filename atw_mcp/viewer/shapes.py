"""Shapes of bodies and statics as the page draws them: the simple ones as they are, all others as triangles."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from atw_mcp.viewer import parts
from atw_mcp.viewer.packing import Blocks
from polyworld.world import geometry
from polyworld.world.shapes import (
    BodyShape,
    Box,
    Capsule,
    Compound,
    ConvexMesh,
    Cylinder,
    Plane,
    Sphere,
    StaticShape,
    TriangleMesh,
    Wall,
)

Array = NDArray[np.float64]


def shape_view(shape: BodyShape | StaticShape, blocks: Blocks) -> parts.Shape:
    """Return a shape in the axes of its body, whose origin is its centre of mass."""
    if isinstance(shape, Sphere):
        return parts.Sphere(radius=shape.radius)
    if isinstance(shape, Box):
        return parts.Box(half_extents=list(shape.half_extents))
    if isinstance(shape, Cylinder):
        return parts.Cylinder(radius=shape.radius, half_height=shape.half_height)
    if isinstance(shape, Capsule):
        return parts.Capsule(radius=shape.radius, half_height=shape.half_height)
    if isinstance(shape, Plane):
        normal = np.asarray(shape.normal) / np.linalg.norm(shape.normal)
        return parts.Plane(normal=normal.tolist(), offset=shape.offset)
    vertices, triangles = _triangles(shape)
    return parts.Mesh(vertices=blocks.floats(vertices), triangles=blocks.integers(triangles))


def form_words(shape: BodyShape) -> str:
    """Return what a shape that the page draws as triangles is, in words; empty for others."""
    if isinstance(shape, Compound):
        kinds = {part.shape.kind.replace("_", " ") for part in shape.parts}
        plural = {"box": "boxes", "convex mesh": "convex meshes"}
        (kind,) = kinds if len(kinds) == 1 else ("piece",)
        return f"{len(shape.parts)} {plural.get(kind, kind + 's') if len(shape.parts) > 1 else kind}"
    return "convex mesh" if isinstance(shape, ConvexMesh) else ""


def _triangles(shape: ConvexMesh | Compound | Wall | TriangleMesh) -> tuple[ArrayLike, ArrayLike]:
    """Vertices (k, 3) and triangles (t, 3) of a shape."""
    if isinstance(shape, TriangleMesh):
        return shape.vertices, shape.faces
    if isinstance(shape, Wall):
        box, centre, turn = geometry.wall_box(shape)
        return _joined([geometry.Piece(box, centre, turn)])
    return _joined(geometry.pieces(shape))


def _joined(pieces: Iterable[geometry.Piece]) -> tuple[Array, NDArray[np.int64]]:
    vertices, triangles, count = [], [], 0
    for piece in pieces:
        mesh = geometry.surface_mesh(piece.shape)
        vertices.append(np.asarray(mesh.vertices) @ piece.rotation.T + piece.position)
        triangles.append(np.asarray(mesh.faces, dtype=np.int64) + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(triangles)
