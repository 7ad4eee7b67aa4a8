"""Stretches of known deformations; folds of sheets folded by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polyworld.model import DeformableMesh, mesh_of
from polyworld.probing.readouts.deformation import (
    extent,
    folded_share,
    principal_stretches,
    reach,
)
from polyworld.world import World
from polyworld.world.representations.cloth import Cloth, Sheet

TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()


def cloth(divisions: int = 20) -> DeformableMesh:
    sheet = Sheet(
        corner=(0.0, 0.0, 0.0), edge_u=(1.0, 0.0, 0.0), edge_v=(0.0, 1.0, 0.0), divisions=(divisions, divisions)
    )
    item = Cloth(name="c", geometry=sheet)
    return mesh_of(World(deformables=(item,)), item)


def test_principal_stretches_do_not_depend_on_how_the_body_turns() -> None:
    rest = np.random.default_rng(0).normal(size=(200, 3))
    weights = np.linspace(1.0, 2.0, 200)
    moved = np.stack([rest * [1.3, 0.7, 1.1], (rest * [1.3, 0.7, 1.1]) @ TURN.T + 5.0, rest])
    found = principal_stretches(moved, rest, weights)
    assert found == pytest.approx(np.array([[1.3, 1.1, 0.7], [1.3, 1.1, 0.7], [1.0, 1.0, 1.0]]), abs=1e-9)


def test_reach_and_extent_are_those_of_an_ellipsoid() -> None:
    ball = np.random.default_rng(1).normal(size=(40_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    axes = np.array([0.3, 0.2, 0.1])
    directions = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, -1.0]])
    support = np.sqrt(((directions * axes) ** 2).sum(axis=1))  # support function of an ellipsoid about the origin
    moved = ball * axes + [1.0, 2.0, 3.0]
    assert reach(moved, directions) == pytest.approx(support + directions @ [1.0, 2.0, 3.0], abs=1e-3)
    assert extent(moved, directions) == pytest.approx(2.0 * support, abs=2e-3)


@pytest.mark.parametrize("divisions", [10, 30])
def test_a_sheet_folded_in_half_lies_on_itself_and_a_spread_or_draped_one_does_not(divisions: int) -> None:
    mesh = cloth(divisions)
    x, y = mesh.nodes[:, 0], mesh.nodes[:, 1]
    half = np.stack([np.abs(x - 0.5), y, np.where(x > 0.5, 0.01, 0.0)], axis=1)
    corner = mesh.nodes.copy()
    over = x + y > 1.5  # a corner turned over the line x + y = 1.5
    corner[over] = np.stack([1.5 - y[over], 1.5 - x[over], np.full(over.sum(), 0.01)], axis=1)
    radius = 1.0 / np.pi  # bent over a cylinder, half way round
    draped = np.stack([radius * np.sin((x - 0.5) / radius), y, radius * np.cos((x - 0.5) / radius)], axis=1)
    folded = folded_share(np.stack([mesh.nodes, half, corner, draped]), mesh)
    assert folded[0] == 0.0
    assert folded[1] > 0.7
    assert 0.05 < folded[2] < 0.35  # twice an eighth of the sheet, less what is near the crease
    assert folded[3] == 0.0
