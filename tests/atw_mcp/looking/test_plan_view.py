"""The plan beside a picture: true to scale, the right way up, and as exact as its pixels."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.looking.overlay import SIMULATED
from atw_mcp.looking.plan_view import FOOT, PlanView, round_length, silhouette
from polyworld.pictures.render import look_at
from polyworld.trajectory import Trajectory
from polyworld.world import World
from polyworld.world.description import Appearance
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Sphere

HEIGHT = 400


def spheres(places: list[tuple[float, float]], radius: float = 0.2) -> tuple[World, Trajectory]:
    objects = tuple(
        RigidObject(
            name=f"o{k}", shape=Sphere(radius=radius), position=(*place, 0.2), appearance=Appearance(color=color)
        )
        for k, (place, color) in enumerate(zip(places, ("red", "blue", "lime"), strict=False))
    )
    n = len(places)
    positions = np.zeros((1, n, 3))
    positions[0, :, :2] = places
    trajectory = Trajectory(
        names=tuple(o.name for o in objects),
        times=np.zeros(1),
        positions=positions,
        orientations=np.tile([1.0, 0.0, 0.0, 0.0], (1, n, 1)),
        velocities=np.zeros((1, n, 3)),
        angular_velocities=np.zeros((1, n, 3)),
        active=np.ones((1, n), dtype=bool),
    )
    return World(objects=objects), trajectory


def plan_of(places: list[tuple[float, float]], eye: tuple[float, float, float] = (0.0, -8.0, 4.0)) -> PlanView:
    world, trajectory = spheres(places)
    camera = look_at(np.array(eye), np.zeros(3), focal=400.0, width=480, height=320)
    return PlanView(world, trajectory, camera, list(trajectory.names), [0], HEIGHT)


def middles(strip: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Where the red and the blue disc are, and the area of the blue one."""
    image = strip[: HEIGHT - FOOT].astype(int)
    blue, green, red = image[..., 0], image[..., 1], image[..., 2]
    reds, blues = (red > 150) & (green < 80) & (blue < 80), (blue > 180) & (red < 80) & (green < 110)
    return (
        np.argwhere(reds).mean(axis=0)[::-1],
        np.argwhere(blues).mean(axis=0)[::-1],
        float(blues.sum()),
    )


def test_plan_is_true_to_scale_in_both_directions() -> None:
    for places in ([(-0.5, 0.0), (0.5, 0.0)], [(0.0, -0.5), (0.0, 0.5)]):
        plan = plan_of(places)
        red, blue, area = middles(plan.draw(0, [], None, {}))
        # Names and paths may hide a few pixels: a disc's middle is good to a pixel or two.
        assert np.linalg.norm(red - blue) == pytest.approx(plan.pixels_per_metre, abs=2.5)
        assert area == pytest.approx(np.pi * (0.2 * plan.pixels_per_metre) ** 2, rel=0.15)


def test_up_is_away_from_the_camera_and_right_is_right() -> None:
    near_far = [(0.0, -0.5), (0.3, 0.5)]
    red, blue, _ = middles(plan_of(near_far, eye=(0.0, -8.0, 4.0)).draw(0, [], None, {}))
    assert blue[1] < red[1] - 50
    assert blue[0] > red[0]
    red, blue, _ = middles(plan_of(near_far, eye=(0.0, 8.0, 4.0)).draw(0, [], None, {}))
    assert blue[1] > red[1] + 50
    assert blue[0] < red[0]


def test_a_gap_is_seen_and_a_touch_is_seen() -> None:
    """What lies between two discs is ground where they are apart, and their edges where they touch."""
    for gap, apart in ((0.1, True), (0.0, False)):
        plan = plan_of([(-0.2 - gap / 2, 0.0), (0.2 + gap / 2, 0.0)])
        strip = plan.draw(0, [], None, {})
        x, y = np.rint(plan._pixel_points(np.zeros(2))).astype(int)
        between = strip[y, x].astype(int)
        assert (between.max() < 90) == apart


def test_silhouettes_are_shadows_of_the_turned_shape() -> None:
    turn = quaternion_matrix(np.array([np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)]))  # 45 degrees about z
    square = silhouette(Box(half_extents=(0.1, 0.1, 0.3)), turn, np.eye(3))
    assert np.abs(square).max() == pytest.approx(0.1 * np.sqrt(2))
    lying = quaternion_matrix(np.array([np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0]))  # z to x
    capsule = silhouette(Capsule(radius=0.1, half_height=0.2), lying, np.eye(3))
    assert np.ptp(capsule, axis=0) == pytest.approx([0.6, 0.2], rel=1e-2)


def test_paths_have_dots_and_dashes() -> None:
    world, _ = spheres([(0.0, 0.0)])
    count = 21
    positions = np.zeros((count, 1, 3))
    positions[:, 0, 0] = np.linspace(0.0, 2.0, count)
    trajectory = Trajectory(
        names=("o0",),
        times=np.linspace(0.0, 1.0, count),
        positions=positions,
        orientations=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1, 1)),
        velocities=np.zeros((count, 1, 3)),
        angular_velocities=np.zeros((count, 1, 3)),
        active=np.ones((count, 1), dtype=bool),
    )
    camera = look_at(np.array([0.0, -8.0, 4.0]), np.zeros(3), focal=400.0, width=480, height=320)
    plan = PlanView(world, trajectory, camera, ["o0"], [0, count - 1], HEIGHT)

    def drawn(marks: list[int], dashed_from: int | None) -> int:
        strip = plan.draw(count - 1, marks, dashed_from, {}).astype(int)
        return int((np.abs(strip - np.array(SIMULATED)).max(axis=2) < 90).sum())

    assert drawn([], 0) < 0.75 * drawn([], None)
    assert drawn([0, 5, 10], None) > drawn([], None) + 15


@pytest.mark.parametrize(("longest", "length"), [(0.99, 0.5), (1.0, 1.0), (4.0, 2.0), (0.07, 0.05), (730.0, 500.0)])
def test_scale_bars_have_round_lengths(longest: float, length: float) -> None:
    assert round_length(longest) == pytest.approx(length)
