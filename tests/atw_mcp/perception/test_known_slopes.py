"""Known spheres on the faces of fixed solids: their height follows from the face below them."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.perception.known_scene import KnownScene
from polyworld.pictures.render import look_at
from polyworld.world.shapes import Box, Sphere

RADIUS, SLOPE = 0.06, 0.2
NORMAL = np.array([np.sin(SLOPE), 0.0, np.cos(SLOPE)])
"""A ramp that falls along x: its upper face meets the floor at x = 0."""


def ramp() -> tuple[tuple[float, float, float], ...]:
    along = np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    corners = [s * along + [0.0, y, 0.0] - d * NORMAL for s in (-1.5, 0.1) for y in (-0.5, 0.5) for d in (0.0, 0.04)]
    return tuple((float(x), float(y), float(z)) for x, y, z in corners)


@pytest.fixture
def scene() -> KnownScene:
    camera = look_at(np.array([-0.5, -2.5, 2.5]), np.array([-0.5, 0.0, 0.2]), focal=600.0, width=640, height=480)
    return KnownScene(
        camera, solids={"ball": Sphere(radius=RADIUS), "box": Box(half_extents=(0.1,) * 3)}, fixtures=(ramp(),)
    )


@pytest.mark.parametrize("x", [-1.2, -0.6, -0.1])
def test_a_ball_over_a_ramp_touches_it(scene: KnownScene, x: float) -> None:
    middle = scene.body("ball").middle(np.array([x, 0.1, 0.0, 0.0]))
    assert middle @ NORMAL == pytest.approx(RADIUS, abs=1e-6)  # the face goes through the origin
    assert middle[:2] == pytest.approx([x, 0.1])


@pytest.mark.parametrize("x", [-1.3, -0.7, -0.02, 0.4])
def test_a_pixel_leads_back_to_the_place(scene: KnownScene, x: float) -> None:
    body = scene.body("ball")
    pose = np.array([x, -0.2, 0.0, 0.0])
    found = body.placed(body.centre(pose), np.array([0.5, 0.0, 0.0, 0.0]))
    assert found == pytest.approx(pose, abs=1e-4)


def test_what_does_not_roll_is_taken_to_be_on_the_floor(scene: KnownScene) -> None:
    assert scene.body("box").middle(np.array([-0.6, 0.0, 0.0, 0.0])) == pytest.approx([-0.6, 0.0, 0.1])
