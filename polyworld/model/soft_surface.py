"""Surfaces that bodies are filled up to: where the nearest point is, and which side is inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

wp.set_module_options({"enable_backward": False})

SHARP = np.radians(30.0)  # faces that meet at a larger angle than this form an edge that the mesh keeps


class Surface(Protocol):
    """A closed surface."""

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Nearest points of the surface (n, 3) and depths below it (n,), negative outside [m]."""
        ...

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of its bounding box."""
        ...

    def edges(self) -> Array:
        """Sharp edges (e, 2, 3): their ends."""
        ...


@dataclass(frozen=True)
class CapsuleSurface:
    """A cylinder about z with half-spheres on both ends."""

    radius: float
    half_height: float

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """See Surface."""
        axis = np.zeros_like(points)
        axis[:, 2] = np.clip(points[:, 2], -self.half_height, self.half_height)
        away = points - axis
        length = np.linalg.norm(away, axis=1)
        away[length < 1e-12] = (1.0, 0.0, 0.0)
        unit = away / np.linalg.norm(away, axis=1)[:, None]
        return axis + self.radius * unit, self.radius - length

    def bounds(self) -> tuple[Array, Array]:
        """See Surface."""
        upper = np.array([self.radius, self.radius, self.radius + self.half_height])
        return -upper, upper

    def edges(self) -> Array:
        """It has none."""
        return np.zeros((0, 2, 3))


class MeshSurface:
    """A closed triangle mesh, faces counter-clockwise seen from outside."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._vertices = np.asarray(mesh.vertices, dtype=float)
        self._faces = np.asarray(mesh.faces, dtype=np.int32)
        sharp = np.asarray(mesh.face_adjacency_angles) > SHARP
        self._edges: Array = self._vertices[np.asarray(mesh.face_adjacency_edges)[sharp]]
        lower, upper = self.bounds()
        # The tree is of single precision: in units of the body's size about its middle.
        self._middle, self._size = 0.5 * (lower + upper), float((upper - lower).max())
        scaled = (self._vertices - self._middle) / self._size
        with buffers.running():
            self._tree: Any = wp.Mesh(
                points=buffers.array(scaled, wp.vec3),
                indices=buffers.array(self._faces.ravel(), wp.int32),
                support_winding_number=True,
            )

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """See Surface."""
        count = len(points)
        asked: Any = buffers.array((points - self._middle) / self._size, wp.vec3)
        face: Any = buffers.zeros(count, wp.int32)
        place: Any = buffers.zeros(count, wp.vec3)
        inputs = [self._tree.id, asked, face, place]
        buffers.launch(_nearest, count, inputs)
        u, v, sign = np.asarray(buffers.read(place), dtype=float).T
        a, b, c = (self._vertices[self._faces[buffers.read(face), k]] for k in range(3))
        found = u[:, None] * a + v[:, None] * b + (1.0 - u - v)[:, None] * c
        return found, -sign * np.linalg.norm(points - found, axis=1)

    def bounds(self) -> tuple[Array, Array]:
        """See Surface."""
        return self._vertices.min(axis=0), self._vertices.max(axis=0)

    def edges(self) -> Array:
        """See Surface."""
        return self._edges


@wp.kernel
def _nearest(tree: wp.uint64, points: wp.array[wp.vec3], face: wp.array[wp.int32], place: wp.array[wp.vec3]) -> None:
    """Nearest face of each point, and (u, v, sign): barycentric coordinates there, -1 for a point inside."""
    i = wp.tid()
    hit = wp.mesh_query_point_sign_winding_number(tree, points[i], 10.0)
    face[i] = hit.face
    place[i] = wp.vec3(hit.u, hit.v, hit.sign)
