"""How ropes are divided, and how they are threaded over pulleys."""

from typing import Any

import numpy as np
import pytest

from polyworld import World
from polyworld.model.rope import rope_mesh, threading
from tests.verification.rope_world import rope, world


def over_wheel(segments: int = 20, **more: Any) -> World:
    cord = rope([[-0.1, 0, -1], [0.1, 0, -1]], segments, **more)
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": 0.1, "after": 0}
    return world(cord, pulleys=[wheel])


def mesh(scene: World) -> Any:
    return rope_mesh(scene, scene.deformables[0])


def test_nodes_lie_at_equal_distances_along_the_points() -> None:
    made = mesh(world(rope([[0, 0, 0], [1, 0, 0], [1, 0, 1]], 8)))
    np.testing.assert_allclose(np.linalg.norm(np.diff(made.nodes, axis=0), axis=1), 0.25)
    np.testing.assert_allclose(made.measure.sum(), 2.0)
    np.testing.assert_allclose(made.nodes[[0, 4, -1]], [[0, 0, 0], [1, 0, 0], [1, 0, 1]])


def test_given_length_is_shared_by_the_segments() -> None:
    scene = world(rope([[0, 0, 0], [1, 0, 0]], 10, length=1.5))
    np.testing.assert_allclose(threading(scene, scene.deformables[0]).rest, 0.15)
    assert mesh(scene).measure.sum() == pytest.approx(1.5)


def test_rope_lies_on_the_upper_half_of_a_wheel_between_vertical_parts() -> None:
    scene = over_wheel()
    thread = threading(scene, scene.deformables[0])
    assert thread.wrap[0] == pytest.approx(np.pi)
    assert thread.rest.sum() == pytest.approx(2.0 + 0.1 * np.pi)
    np.testing.assert_allclose(np.abs(thread.nodes[:, 0]), 0.1)
    assert thread.nodes[:, 2].max() <= 0.0
    # One of the twenty segments runs over the wheel: ten nodes before it, and the one next to it moved off it.
    assert list(thread.order).index(-1) == 11


def test_point_inside_a_wheel_is_refused() -> None:
    cord = rope([[0.05, 0, 0.0], [0.1, 0, -1]], 10)
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": 0.1, "after": 0}
    with pytest.raises(ValueError, match="inside the wheel of pulley 'wheel'"):
        mesh(world(cord, pulleys=[wheel]))


def test_two_wheels_on_one_segment_are_refused_with_the_number_that_would_do() -> None:
    cord = rope([[-1, 0, 0], [0, 0, 0], [1, 0, 0]], 3)
    wheels = [
        {"name": f"p{k}", "rope": "rope", "centre": [x, 0, 0.1], "radius": 0.05, "after": k}
        for k, x in enumerate((-0.1, 0.1))
    ]
    with pytest.raises(ValueError, match=r"two of its pulleys .* give it at least \d+ segments"):
        mesh(world(cord, pulleys=wheels))


def test_a_rope_that_would_run_through_itself_is_refused_with_the_pulley_to_turn() -> None:
    cord = rope([[-0.6, 0, 0.5], [-0.2, 0, 1.0], [0.2, 0, 1.0], [0.6, 0, 0.5]], 40)

    def over(*senses: bool) -> World:
        places = ((-0.4, 1.5), (0.0, 0.8), (0.4, 1.5))
        wheels = [
            {"name": f"p{k}", "rope": "rope", "centre": [x, 0, z], "radius": 0.1, "after": k, "turns_positive": sense}
            for k, ((x, z), sense) in enumerate(zip(places, senses, strict=True))
        ]
        return world(cord, pulleys=wheels)

    assert len(mesh(over(True, False, True)).nodes) == 41
    with pytest.raises(ValueError, match=r"runs through itself at .* 311 degrees on pulley 'p1'.*turns_positive"):
        mesh(over(True, True, True))
    with pytest.raises(ValueError, match="pulley 'p0'"):
        mesh(over(False, False, True))
