"""Centrelines against curves known in closed form; material points against the affine maps that moved them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.model import DeformableMesh, mesh_of
from polyworld.probing.readouts import Centreline, read
from polyworld.probing.readouts.centreline import nearest_on_polyline, resampled, turning
from polyworld.probing.readouts.material_points import material_points
from polyworld.world import World
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box
from tests.polyworld.synthetic import rollout_of

Array = NDArray[np.float64]


def spiral(count: int, scale: float = 1.0) -> Array:
    """Half a turn of a circle, its points denser towards one end."""
    angle = np.pi * np.linspace(0.0, 1.0, count) ** 2
    return scale * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def test_points_are_evenly_spaced_by_length_however_unevenly_the_polyline_is_divided() -> None:
    found = resampled(np.stack([spiral(4001), spiral(4001, 3.0)]), 9)
    angle = np.linspace(0.0, np.pi, 9)
    expected = np.stack([np.cos(angle), np.sin(angle), np.zeros(9)], axis=1)
    assert found[0] == pytest.approx(expected, abs=1e-4)
    assert found[1] == pytest.approx(3.0 * expected, abs=3e-4)


def test_ends_are_kept_and_a_kink_is_cut_off_by_no_more_than_its_segment() -> None:
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    found = resampled(corner, 5)
    assert found == pytest.approx(np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 0.5], [1.0, 1.0]]))
    assert turning(corner) == pytest.approx(np.pi / 2)


def test_nearest_points_of_a_circle_lie_on_the_ray_from_its_centre() -> None:
    targets = np.array([[2.0, 2.0, 0.0], [0.1, 0.4, 0.0], [3.0, -1.0, 0.0], [np.nan, 0.0, 0.0]])
    found = nearest_on_polyline(np.stack([spiral(4001)] * 2), targets[None])
    assert found.shape == (2, 4, 3)
    on_circle = targets[:2] / np.linalg.norm(targets[:2], axis=1)[:, None]
    assert found[1, :2] == pytest.approx(on_circle, abs=1e-4)
    assert found[0, 2] == pytest.approx([1.0, 0.0, 0.0])  # beyond the end


ROPE = Rope(name="it", points=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), segments=7)
CLOTH = Cloth(
    name="it",
    geometry=Sheet(corner=(0.0, 0.0, 0.0), edge_u=(1.0, 0.0, 0.0), edge_v=(0.0, 0.6, 0.0), divisions=(5, 3)),
)
SOFT = Soft(name="it", shape=Box(half_extents=(0.5, 0.3, 0.2)), position=(0.5, 0.3, 0.2))


def mesh(item: Rope | Cloth | Soft) -> DeformableMesh:
    return mesh_of(World(deformables=(item,)), item)


@pytest.mark.parametrize(
    ("item", "place"),
    [
        (ROPE, (0.3217, 0.0, 0.0)),
        (CLOTH, (0.3217, 0.41, 0.0)),
        (SOFT, (0.3217, 0.41, 0.13)),
        (SOFT, (0.0, 0.02, 0.4)),
    ],
)
def test_a_material_point_follows_an_affine_motion_exactly(
    item: Rope | Cloth | Soft, place: tuple[float, float, float]
) -> None:
    found = material_points(mesh(item), np.array([place]))
    assert found.distance[0] < 1e-9
    rng = np.random.default_rng(3)
    matrix, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    moved = mesh(item).nodes @ matrix.T + shift
    assert found.places(np.stack([moved, 2.0 * moved]))[:, 0] == pytest.approx(
        np.stack([matrix @ place + shift, 2.0 * (matrix @ place + shift)]), abs=1e-9
    )


def test_a_rope_over_a_wheel_is_seen_to_run_round_it() -> None:
    # Seen with the axis, y, at the viewer, x runs to the left: from right to left over the top is counter-clockwise.
    wheel = Pulley(name="wheel", rope="it", centre=(0.0, 0.0, 0.0), radius=0.2, after=0)
    rope = Rope(name="it", points=((-0.2, 0.0, -1.0), (0.2, 0.0, -1.0)), segments=24)
    world = World(deformables=(rope,), pulleys=(wheel,))
    nodes = mesh_of(world, rope).nodes
    motion = rollout_of(world, np.array([0.0, 1.0]), {"it": np.stack([nodes, nodes])}).trajectory
    line = read(Centreline(object="it", count=41), world, motion)[1]
    whole = 2.0 + np.pi * 0.2
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.sum() == pytest.approx(whole, rel=0.003)
    top = line[line[:, 2] > 0.02]
    assert len(top) > 7
    assert np.linalg.norm(top, axis=1) == pytest.approx(np.full(len(top), 0.2), abs=0.004)
