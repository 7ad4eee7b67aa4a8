"""Which nodes an attachment holds, and the nearest point of what it is held to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from polyworld.model import DeformableMesh, mesh_of
from polyworld.solver.coupled.attachment_targets import held_nodes, nearest_on
from polyworld.world import World
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.rope import Rope

CLOTH = Cloth(
    name="cloth", geometry=Sheet(corner=(0, 0, 0), edge_u=(1, 0, 0), edge_v=(0.3, 0.8, 0.4), divisions=(3, 2))
)
ROPE = Rope(name="rope", points=((0, 0, 0), (1, 0, 0), (1, 1, 0.5)), segments=7)
WORLD = World(deformables=(CLOTH, ROPE))
MESHES = {item.name: mesh_of(WORLD, item) for item in WORLD.deformables}


def test_ends_of_a_rope_are_its_first_and_last_node() -> None:
    assert held_nodes(MESHES, Attachment(name="a", object="rope", end="start")).tolist() == [0]
    assert held_nodes(MESHES, Attachment(name="a", object="rope", end="end")).tolist() == [7]


def test_region_holds_the_nodes_in_it() -> None:
    edge = Attachment(name="a", object="cloth", region=Region(lower=(-1, -0.01, -0.01), upper=(2, 0.01, 0.01)))
    held = held_nodes(MESHES, edge)
    assert len(held) == 4
    assert MESHES["cloth"].nodes[held][:, 1] == pytest.approx(0.0)


def test_empty_region_and_missing_nodes_are_refused_with_what_there_is() -> None:
    nowhere = Attachment(name="a", object="cloth", region=Region(lower=(5, 5, 5), upper=(6, 6, 6)))
    with pytest.raises(ValueError, match=r"no node of 'cloth' is in its region .* the nodes lie in"):
        held_nodes(MESHES, nowhere)
    with pytest.raises(ValueError, match=r"'rope' has nodes 0\.\.7, not \[8\]"):
        held_nodes(MESHES, Attachment(name="a", object="rope", nodes=(1, 8)))


@pytest.mark.parametrize("seed", range(8))
def test_nearest_point_of_cloth_and_rope_is_what_a_search_finds(seed: int) -> None:
    p = np.random.default_rng(seed).uniform(-0.5, 1.5, 3)
    for name in ("cloth", "rope"):
        mesh = MESHES[name]
        nodes, weights, offset = nearest_on(mesh, p)
        used = nodes[nodes >= 0]
        point = weights[: len(used)] @ mesh.nodes[used]
        assert weights.sum() == pytest.approx(1.0)
        assert np.linalg.norm(offset) == pytest.approx(np.linalg.norm(p - point))
        assert np.linalg.norm(p - point) == pytest.approx(_least_distance(mesh, p), abs=1e-6)


def _least_distance(mesh: DeformableMesh, p: np.ndarray) -> float:
    """Distance to the nearest element, each minimised over its barycentric coordinates by SciPy."""
    best = np.inf
    for element in mesh.triangles if len(mesh.triangles) else mesh.segments:
        corners = mesh.nodes[element]

        def distance(t: np.ndarray, corners: np.ndarray = corners) -> float:
            return float(((corners[0] + t @ (corners[1:] - corners[0]) - p) ** 2).sum())

        found = minimize(
            distance,
            np.full(len(corners) - 1, 0.25),
            bounds=[(0, 1)] * (len(corners) - 1),
            constraints={"type": "ineq", "fun": lambda t: 1.0 - t.sum()},
            method="SLSQP",
            options={"ftol": 1e-15, "maxiter": 200},
        )
        best = min(best, float(np.sqrt(found.fun)))
    return best
