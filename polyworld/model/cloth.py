"""Triangles of a cloth."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.model.mesh import DeformableMesh
from polyworld.world.representations.cloth import Cloth, Sheet, SurfaceMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

# Vertices closer than this part of the mesh's extent are one: files often repeat them for their normals.
SAME_VERTEX = 1e-7
# |cosine| of a sheet's corner up to which its two diagonals serve equally well.
NEARLY_SQUARE = 0.3


def cloth_mesh(item: Cloth) -> DeformableMesh:
    """Nodes and triangles of a cloth; measure is the area about a node, radius half the thickness.

    Raises ValueError for a surface mesh with faces of no area, vertices of no face, edges of more than two
    faces, or faces that cannot be turned to one side.
    """
    geometry = item.geometry
    nodes, triangles = _sheet(geometry) if isinstance(geometry, Sheet) else _surface(item.name, geometry)
    corners = nodes[triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    measure = np.zeros(len(nodes))
    np.add.at(measure, triangles.ravel(), np.repeat(area / 3.0, 3))
    radius = np.full(len(nodes), 0.5 * item.thickness)
    return DeformableMesh(nodes=nodes, measure=measure, radius=radius, triangles=triangles)


def _sheet(sheet: Sheet) -> tuple[Array, Ints]:
    """Node (i, j) at row i (n_v + 1) + j, with i along u.

    Cells are cut along one diagonal and the other in turn: diagonals of one direction would make the sheet stiffer
    in shear one way than the other. A slanted cell is cut along its shorter diagonal, for the better triangles.
    """
    nu, nv = sheet.divisions
    u, v = np.asarray(sheet.edge_u, dtype=float), np.asarray(sheet.edge_v, dtype=float)
    i, j = np.meshgrid(np.arange(nu + 1), np.arange(nv + 1), indexing="ij")
    nodes = np.asarray(sheet.corner) + (i / nu)[..., None] * u + (j / nv)[..., None] * v
    row, column = i[:-1, :-1].ravel(), j[:-1, :-1].ravel()
    a = row * (nv + 1) + column
    b, c, d = a + nv + 1, a + nv + 2, a + 1
    slant = float(u @ v / (np.linalg.norm(u) * np.linalg.norm(v)))
    rising = (row + column) % 2 == 0 if abs(slant) <= NEARLY_SQUARE else np.full(len(a), slant < 0)  # cut from a to c
    first = np.where(rising[:, None], np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(rising[:, None], np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    triangles = np.stack([first, second], axis=1).reshape(-1, 3)
    return nodes.reshape(-1, 3), triangles.astype(np.int32)


def _surface(name: str, mesh: SurfaceMesh) -> tuple[Array, Ints]:
    vertices = np.asarray(mesh.vertices, dtype=float)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    extent = float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    nodes, index = _merged(vertices, SAME_VERTEX * extent)
    faces = index[faces]
    corners = nodes[faces]
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    flat = np.flatnonzero(doubled <= 1e-12 * extent**2)
    if len(flat):
        raise ValueError(f"cloth {name!r}: faces {_some(flat)} have no area")
    unused = np.setdiff1d(np.arange(len(vertices)), np.asarray(mesh.faces).ravel())
    if len(unused):
        raise ValueError(f"cloth {name!r}: vertices {_some(unused)} belong to no face, so they would have no mass")
    return nodes, _one_sided(name, faces).astype(np.int32)


def _merged(vertices: Array, distance: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices without repetitions, in order of first appearance, and the new index of each old one."""
    from scipy.spatial import cKDTree

    index = np.arange(len(vertices))
    for a, b in sorted(cKDTree(vertices).query_pairs(distance)):
        index[b] = min(index[b], index[a])
    kept, renumbered = np.unique(index, return_inverse=True)
    return vertices[kept], renumbered.astype(np.int64)


def _one_sided(name: str, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Orient faces so that neighbours run along their common edge in opposite directions."""
    neighbours: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for f, face in enumerate(faces):
        for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0])):
            neighbours.setdefault((int(min(a, b)), int(max(a, b))), []).append((f, bool(a < b)))
    non_manifold = [edge for edge, sides in neighbours.items() if len(sides) > 2]
    if non_manifold:
        raise ValueError(
            f"cloth {name!r}: {len(non_manifold)} edges belong to more than two faces, between vertices (after merging "
            f"repeated ones) {_some(non_manifold)}; a cloth is one layer: make the layers objects of their own"
        )
    links: list[list[tuple[int, bool]]] = [[] for _ in faces]
    for sides in neighbours.values():
        if len(sides) == 2:
            (f, forward), (g, other) = sides
            links[f].append((g, forward == other))
            links[g].append((f, forward == other))
    turned = np.full(len(faces), -1)
    for start in range(len(faces)):
        if turned[start] >= 0:
            continue
        turned[start] = 0
        queue = deque([start])
        while queue:
            f = queue.popleft()
            for g, differs in links[f]:
                side = int(turned[f]) ^ int(differs)
                if turned[g] < 0:
                    turned[g] = side
                    queue.append(g)
                elif turned[g] != side:
                    raise ValueError(f"cloth {name!r}: its faces have no two sides (a Moebius band); it must have")
    return np.where(turned[:, None] == 1, faces[:, [0, 2, 1]], faces)


def _some(items: Sequence[tuple[int, int]] | NDArray[np.int64]) -> str:
    """The first of a list of places, and how many more there are."""
    values = np.asarray(items).tolist()
    more = f" and {len(values) - 8} more" if len(values) > 8 else ""
    return f"{values[:8]}{more}"
