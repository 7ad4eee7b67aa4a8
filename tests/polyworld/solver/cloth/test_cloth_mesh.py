"""How cloth is divided into triangles, and which meshes it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.model.cloth import cloth_mesh
from polyworld.world.representations.cloth import Cloth


def cloth(geometry: dict[str, Any], **more: Any) -> Cloth:
    return Cloth.model_validate({"name": "cloth", "geometry": geometry, **more})


def mesh(vertices: list[tuple[float, float, float]], faces: list[tuple[int, int, int]]) -> Cloth:
    return cloth({"kind": "mesh", "vertices": vertices, "faces": faces})


SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]


def test_sheet_is_covered_once_and_carries_its_whole_area() -> None:
    item = cloth(
        {"kind": "sheet", "corner": (1, 2, 3), "edge_u": (0, 2, 0), "edge_v": (0, 0, 0.5), "divisions": (6, 3)},
        thickness=0.004,
    )
    m = cloth_mesh(item)
    assert m.nodes.shape == (28, 3)
    assert m.triangles.shape == (36, 3)
    assert m.measure.sum() == pytest.approx(1.0)
    assert np.all(m.radius == 0.002)
    corners = m.nodes[m.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(normals, normals[0])  # all on one side, all of one area
    assert tuple(m.nodes[1 * 4 + 2]) == pytest.approx((1, 2 + 2 / 6, 3 + 0.5 * 2 / 3))  # row i along u, place j along v


def test_diagonals_of_a_sheet_run_both_ways_in_equal_number() -> None:
    m = cloth_mesh(
        cloth({"kind": "sheet", "corner": (0, 0, 0), "edge_u": (1, 0, 0), "edge_v": (0, 1, 0), "divisions": (4, 4)})
    )
    x = m.nodes[m.triangles]
    sides = np.concatenate([x[:, (k + 1) % 3] - x[:, k] for k in range(3)])
    diagonal = sides[np.abs(sides[:, 0] * sides[:, 1]) > 1e-9]
    assert np.sum(diagonal[:, 0] * diagonal[:, 1] > 0) == np.sum(diagonal[:, 0] * diagonal[:, 1] < 0)


@pytest.mark.parametrize("slant", [-0.8, 0.8])
def test_slanted_sheet_is_cut_along_its_shorter_diagonals(slant: float) -> None:
    m = cloth_mesh(
        cloth(
            {"kind": "sheet", "corner": (0, 0, 0), "edge_u": (1, 0, 0), "edge_v": (slant, 0.6, 0), "divisions": (3, 3)}
        )
    )
    x = m.nodes[m.triangles]
    longest = max(float(np.linalg.norm(x[:, (k + 1) % 3] - x[:, k], axis=1).max()) for k in range(3))
    assert longest < 0.4  # the longer diagonal of a cell has 0.63


def test_repeated_vertices_are_one_node() -> None:
    item = mesh([*SQUARE, SQUARE[0], SQUARE[2]], [(0, 1, 2), (4, 5, 3)])
    m = cloth_mesh(item)
    assert m.nodes.shape == (4, 3)
    assert m.measure.sum() == pytest.approx(1.0)
    assert set(m.triangles[0]) & set(m.triangles[1]) == {0, 2}


def test_faces_are_turned_to_one_side() -> None:
    m = cloth_mesh(mesh(SQUARE, [(0, 1, 2), (0, 3, 2)]))
    x = m.nodes[m.triangles]
    assert np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])[:, 2] == pytest.approx([1.0, 1.0])


def test_edge_of_three_faces_is_refused() -> None:
    with pytest.raises(ValueError, match=r"1 edges belong to more than two faces.*\[0, 2\].*one layer"):
        cloth_mesh(mesh([*SQUARE, (0.5, 0.5, 1.0)], [(0, 1, 2), (0, 2, 3), (0, 2, 4)]))


def test_face_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match=r"faces \[1\] have no area"):
        cloth_mesh(mesh([*SQUARE, (0.5, 0.5, 0.0)], [(0, 1, 2), (0, 4, 2), (0, 2, 3)]))


def test_vertex_of_no_face_is_refused() -> None:
    with pytest.raises(ValueError, match=r"vertices \[3\] belong to no face"):
        cloth_mesh(mesh(SQUARE, [(0, 1, 2)]))


def test_moebius_band_is_refused() -> None:
    turn = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    vertices: list[tuple[float, float, float]] = []
    for a in turn:
        for side in (-0.2, 0.2):
            r = 1.0 + side * np.cos(a / 2)
            vertices.append((float(r * np.cos(a)), float(r * np.sin(a)), float(side * np.sin(a / 2))))
    faces = []
    for i in range(12):
        a, b = 2 * i, 2 * i + 1
        c, d = (2 * i + 2, 2 * i + 3) if i < 11 else (1, 0)
        faces += [(a, c, b), (b, c, d)]
    with pytest.raises(ValueError, match="no two sides"):
        cloth_mesh(mesh(vertices, faces))
