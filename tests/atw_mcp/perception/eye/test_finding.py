"""Known solids among regions of drawn clips: by the names of their colours, their sizes and their shapes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from matplotlib.colors import CSS4_COLORS, to_rgb

from atw_mcp.perception.eye import EyeSettings, Solid
from atw_mcp.perception.eye.colour_names import log_look, log_name
from atw_mcp.perception.eye.finding import find_solids
from atw_mcp.perception.eye.observe import observe
from atw_mcp.perception.eye.seeds import Seed
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
BALL = (0.12, 0.12, 0.12)


def camera() -> Camera:
    """A camera 1 m above the floor and 2 m in front of the origin, that looks at it."""
    forward = np.array([0.0, 2.0, -1.0]) / np.sqrt(5.0)
    rotation = np.stack([[1.0, 0.0, 0.0], np.cross(forward, [1.0, 0.0, 0.0]), forward])
    return Camera(
        width=WIDTH,
        height=HEIGHT,
        intrinsics=((FOCAL, 0.0, (WIDTH - 1) / 2), (0.0, FOCAL, (HEIGHT - 1) / 2), (0.0, 0.0, 1.0)),
        rotation=rotation.tolist(),
        translation=(-rotation @ np.array([0.0, -2.0, 1.0])).tolist(),
    )


def chequered() -> np.ndarray:
    """A ground of brown and grey squares."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.where(((u // 24 + v // 24) % 2 == 0)[..., None], (60.0, 90.0, 120.0), (110.0, 115.0, 120.0))


def film(parts: list[tuple[list[np.ndarray], tuple[float, float, float]]]) -> np.ndarray:
    """Frames (T, H, W, 3) of polygons (V, 2) [px] in BGR colours on the ground, with noise."""
    rng, frames = np.random.default_rng(3), []
    for k in range(len(parts[0][0])):
        frame = chequered()
        for polygons, colour in parts:
            cv2.fillPoly(frame, [np.round(polygons[k] * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
        frames.append(np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    return np.stack(frames)


def silhouettes(body: Solid, x: np.ndarray, y: np.ndarray, height: np.ndarray | float = 0.0) -> list[np.ndarray]:
    """Polygons (T) of a body at places x, y [m], lifted by a height [m]."""
    heights = np.broadcast_to(height, len(x))
    return [body.polygon(np.array([a, b, 0.0, c])) for a, b, c in zip(x, y, heights, strict=True)]


@pytest.mark.parametrize("name", ["red", "green", "blue", "yellow", "orange", "purple", "pink", "saddlebrown", "white"])
def test_colours_of_a_style_sheet_are_called_by_their_names(name: str) -> None:
    levels = np.array([np.round(np.array(to_rgb(CSS4_COLORS[name])[::-1]) * 255)], np.uint8)
    words = ["red", "green", "blue", "yellow", "orange", "purple", "pink", "brown", "white", "grey", "black", "cyan"]
    name = name.removeprefix("saddle")
    assert name in sorted(words, key=lambda word: -float(log_name(levels, word)[0]))[:2]  # orange is nearly yellow


def test_light_and_dark_greys_are_told_by_their_lightness() -> None:
    light, dark = (np.full((10, 3), level, np.uint8) for level in (200, 70))
    assert log_look(light, "light grey") - log_look(light, "dark grey") > 0.5
    assert log_look(dark, "dark grey") - log_look(dark, "light grey") > 0.5


def test_bodies_of_one_colour_are_distinguished_by_their_shapes() -> None:
    ball = Solid("ball", "sphere", BALL, camera())
    box = Solid("box", "box", (0.2, 0.06, 0.06), camera())
    x = np.linspace(-0.6, 0.5, 16)
    red = (30.0, 30.0, 200.0)
    frames = film([(silhouettes(ball, x, 0 * x + 0.4), red), (silhouettes(box, -x, 0 * x - 0.3), red)])
    for order in ([ball, box], [box, ball]):
        found = find_solids(frames, order, {"ball": "red", "box": "red"}, {}, EyeSettings())
        for body, place, y in ((ball, x, 0.4), (box, -x, -0.3)):
            seed = found[body.name].seed
            assert seed.frame is not None
            true = body.polygon(np.array([place[seed.frame], y, 0.0, 0.0]))
            assert np.linalg.norm(seed.points().mean(axis=0) - true.mean(axis=0)) < 4.0
            assert found[body.name].on_plane


def test_body_at_rest_is_found_by_its_colour_and_one_that_is_not_there_is_not() -> None:
    still, runner = Solid("still", "sphere", BALL, camera()), Solid("runner", "sphere", BALL, camera())
    x = np.linspace(-0.6, 0.5, 16)
    frames = film(
        [
            (silhouettes(still, 0 * x, 0 * x + 0.5), (200.0, 90.0, 30.0)),
            (silhouettes(runner, x, 0 * x - 0.4), (40.0, 160.0, 40.0)),
        ]
    )
    ghost = Solid("ghost", "sphere", BALL, camera())
    words = {"still": "blue", "runner": "green", "ghost": "yellow"}
    found = find_solids(frames, [still, runner, ghost], words, {}, EyeSettings())
    assert not len(found["still"].others)
    assert not len(found["runner"].others)
    assert "ghost" not in found or len(found["ghost"].others)  # squares of the ground are no worse than one another
    true = still.polygon(np.array([0.0, 0.5, 0.0, 0.0]))
    assert np.linalg.norm(found["still"].seed.points().mean(axis=0) - true.mean(axis=0)) < 4.0


def test_body_in_flight_is_not_on_the_floor() -> None:
    ball = Solid("ball", "sphere", BALL, camera())
    t = np.linspace(0.0, 0.8, 20)
    path = silhouettes(ball, -0.7 + 1.4 * t, 0 * t, 3.9 * t - 4.9 * t**2)
    found = find_solids(film([(path, (30.0, 30.0, 200.0))]), [ball], {"ball": "red"}, {}, EyeSettings())
    assert not found["ball"].on_plane


def shaded(frame: np.ndarray, ball: Solid, x: float, y: float, level: float) -> None:
    """Draw a matt ball, darker on its lower side, and its shadow beside it, over a frame (H, W, 3) of levels."""
    shadow = ball.polygon(np.array([x + 0.16, y, 0.0, 0.0])) * [1.0, 0.6]
    shadow += [0.0, ball.polygon(np.array([x, y, 0.0, 0.0]))[:, 1].max() - shadow[:, 1].max()]
    mask = np.zeros(frame.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.round(shadow).astype(np.int32)], 1)
    frame[mask > 0] *= 0.6
    pose = np.array([x, y, 0.0, 0.0])
    (u, v), radius = ball.centre(pose), ball.radius(pose)
    across, down = np.meshgrid(np.arange(WIDTH) - u, np.arange(HEIGHT) - v)
    inside = np.hypot(across, down) < radius
    frame[inside] = (level * (0.75 - 0.45 * down / radius))[inside][:, None]


def test_grey_ball_at_rest_on_a_grey_ground_is_found_by_its_silhouette_and_not_its_shadow() -> None:
    ball = Solid("ball", "sphere", BALL, camera())
    rng = np.random.default_rng(5)
    ground = 110 + 6 * cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)), (0, 0), 3.0)[..., None] * np.ones(3) * 3
    frames = []
    for _ in range(12):
        frame = ground.copy()
        shaded(frame, ball, 0.2, 0.3, 130.0)
        frames.append(np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    found = find_solids(np.stack(frames), [ball], {"ball": "grey"}, {}, EyeSettings())["ball"]
    true = ball.centre(np.array([0.2, 0.3, 0.0, 0.0]))
    assert np.linalg.norm(found.seed.points().mean(axis=0) - true) < 2.0
    assert found.on_plane
    assert not len(found.others)


def test_shaded_ball_at_rest_is_followed_from_the_one_frame_in_which_it_has_moved_a_little() -> None:
    ball = Solid("ball", "sphere", BALL, camera())
    x = np.r_[np.zeros(14), 0.07]
    whole = silhouettes(ball, x, 0 * x + 0.3)
    middles = [p.mean(axis=0) for p in whole]
    smaller = [
        [m + s * (p - m) - [s, 2 - 2 * s] for p, m in zip(whole, middles, strict=True)] for s in np.arange(1, 0, -0.1)
    ]
    frames = film([(p, (20.0, 25.0 + 15 * k, 20.0)) for k, p in enumerate(smaller)])
    (track,), _ = observe(frames, [ball], [Seed.outlined("ball", 14, whole[14])])
    true = [ball.centre(np.array([a, 0.3, 0.0, 0.0])) for a in x]
    assert np.linalg.norm(track.centres - true, axis=1).max() < 1.5  # px, of a radius of 17


def test_what_moves_under_the_floor_of_a_side_view_is_not_the_ball() -> None:
    side = MotionPlane(normal=(0.0, -1.0, 0.0), supports=False)
    free, ball = (Solid("ball", "sphere", BALL, camera(), side, floor=floor) for floor in (None, 0.0))
    x = np.linspace(-0.6, 0.5, 16)
    moving = camera().project(np.stack([x, 0 * x - 0.7, 0 * x], axis=1))  # on the floor, in front of the plane
    still = camera().project(np.tile([0.3, 0.0, BALL[0]], (16, 1)))
    grey = [[free.polygon(free.placed(p, np.zeros(4))) for p in pixels] for pixels in (moving, still)]
    frames = film([(grey[0], (140.0, 140.0, 140.0)), (grey[1], (150.0, 170.0, 190.0))])
    for body, place in ((free, moving), (ball, still)):
        seed = find_solids(frames, [body], {"ball": "grey"}, {}, EyeSettings())["ball"].seed
        assert seed.frame is not None
        assert np.linalg.norm(seed.points().mean(axis=0) - place[seed.frame]) < 4.0


def test_one_of_two_like_balls_is_not_chosen_but_both_are_offered() -> None:
    ball = Solid("ball", "sphere", BALL, camera())
    rng = np.random.default_rng(5)
    frame = np.full((HEIGHT, WIDTH, 3), 110.0)
    for x in (-0.4, 0.4):
        shaded(frame, ball, x, 0.3, 130.0)
    frames = np.clip(frame + rng.normal(0, 2, (12, *frame.shape)), 0, 255).astype(np.uint8)
    found = find_solids(frames, [ball], {"ball": "grey"}, {}, EyeSettings())["ball"]
    offered = [found.seed.points().mean(axis=0), *found.others]
    true = [ball.centre(np.array([x, 0.3, 0.0, 0.0])) for x in (-0.4, 0.4)]
    assert len(offered) == 2
    assert all(min(np.linalg.norm(place - t) for place in offered) < 2.0 for t in true)
