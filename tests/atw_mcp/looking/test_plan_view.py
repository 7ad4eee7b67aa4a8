"""The plan beside a picture: true to scale, the right way up, and as exact as its pixels."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.looking.overlay import SIMULATED
from atw_mcp.looking.plan_frame import FOOT
from atw_mcp.looking.plan_view import CROWD, EVENT, PlanView, plan_frame, short_names, silhouette
from polyworld.pictures.render import look_at
from polyworld.trajectory import Event, Trajectory
from polyworld.world import World
from polyworld.world.camera import Camera
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
    frame = plan_frame([(world, trajectory)], camera, trajectory.names, [0], HEIGHT)
    return PlanView(world, trajectory, frame, trajectory.names)


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
        assert np.linalg.norm(red - blue) == pytest.approx(plan.frame.pixels_per_metre, abs=2.5)
        assert area == pytest.approx(np.pi * (0.2 * plan.frame.pixels_per_metre) ** 2, rel=0.15)


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
        x, y = np.rint(plan.frame.pixel_points(np.zeros(2))).astype(int)
        between = strip[y, x].astype(int)
        assert (between.max() < 90) == apart


def test_silhouettes_are_shadows_of_the_turned_shape() -> None:
    turn = quaternion_matrix(np.array([np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)]))  # 45 degrees about z
    square = silhouette(Box(half_extents=(0.1, 0.1, 0.3)), turn, np.eye(3))
    assert np.abs(square).max() == pytest.approx(0.1 * np.sqrt(2))
    lying = quaternion_matrix(np.array([np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0]))  # z to x
    capsule = silhouette(Capsule(radius=0.1, half_height=0.2), lying, np.eye(3))
    assert np.ptp(capsule, axis=0) == pytest.approx([0.6, 0.2], rel=1e-2)


def moving(places: np.ndarray) -> tuple[World, Trajectory]:
    """One sphere at places (T, 3), over one second."""
    count = len(places)
    trajectory = Trajectory(
        names=("o0",),
        times=np.linspace(0.0, 1.0, count),
        positions=places[:, None],
        orientations=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1, 1)),
        velocities=np.zeros((count, 1, 3)),
        angular_velocities=np.zeros((count, 1, 3)),
        active=np.ones((count, 1), dtype=bool),
    )
    return spheres([(0.0, 0.0)])[0], trajectory


def ahead() -> Camera:
    return look_at(np.array([0.0, -8.0, 4.0]), np.zeros(3), focal=400.0, width=480, height=320)


def test_paths_have_dots_and_dashes() -> None:
    count = 21
    world, trajectory = moving(np.outer(np.linspace(0.0, 2.0, count), [1.0, 0.0, 0.0]))
    camera = ahead()
    plan = PlanView(world, trajectory, plan_frame([(world, trajectory)], camera, ["o0"], [count - 1], HEIGHT), ["o0"])

    def drawn(marks: list[int], dashed_from: int | None) -> int:
        strip = plan.draw(count - 1, marks, dashed_from, {}).astype(int)
        return int((np.abs(strip - np.array(SIMULATED)).max(axis=2) < 90).sum())

    assert drawn([], 0) < 0.75 * drawn([], None)
    assert drawn([0, 4, 16], None) > drawn([], None) + 12


def test_what_rises_and_falls_is_seen_from_the_side() -> None:
    s = np.linspace(0.0, 1.0, 11)
    throw = np.stack([2.0 * s, 0.3 * s, 4.0 * s * (1.0 - s)], axis=1)
    shown = {}
    for what, places in (
        ("throw", throw),
        ("slide", throw * [1.0, 1.0, 0.0]),
        ("away", throw[:, [1, 0, 2]] * [1, 3, 1]),
    ):
        frame = plan_frame([moving(places)], ahead(), ["o0"], [10], HEIGHT)
        shown[what] = frame.shows.split(",")[0], frame.axis_names
    assert shown == {
        "throw": ("elevation", ("x", "z")),
        "slide": ("plan", ("x", "y")),
        "away": ("plan", ("x", "y")),
    }


def test_collisions_are_stars_where_they_happen_and_hollow_before() -> None:
    world, trajectory = moving(np.outer(np.linspace(0.0, 2.0, 21), [1.0, 0.0, 0.0]))
    plan = PlanView(world, trajectory, plan_frame([(world, trajectory)], ahead(), ["o0"], [20], HEIGHT), ["o0"])
    place = (1.0, 0.4, 0.0)
    event = Event("contact_begin", 0.5, ("o0", "wall"), place, 1.0, 1.0)
    x, y = np.rint(plan.pixel(np.array(place))).astype(int)
    for sample, filled in ((4, False), (10, True), (20, True)):
        strip = plan.draw(sample, [], None, {}, [event]).astype(int)
        assert (np.abs(strip[y, x] - np.array(EVENT)).max() < 60) == filled
        around = np.abs(strip[y - 9 : y + 10, x - 9 : x + 10] - np.array(EVENT)).max(axis=2) < 90
        assert around.any()


def test_crowds_get_short_names() -> None:
    few, many = [f"body_{k:02d}" for k in range(CROWD)], [f"body_{k:02d}" for k in range(50)]
    assert short_names(few)["body_07"] == "body_07"
    assert short_names(many)["body_07"] == "07"
    unlike = [*many[:20], "a_red_cube"]
    assert short_names(unlike)["a_red_cube"] == "21"
    assert len(set(short_names(unlike).values())) == 21
