"""Known bodies in drawn clips: balls of known paths on a floor seen from above at an angle."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from atw_mcp.perception.known.bodies import KnownBody, fixture_depths, sizes_of
from atw_mcp.perception.known.colour_words import colour_word
from atw_mcp.perception.known.finding import Candidate
from atw_mcp.perception.known.observe import observe_known
from atw_mcp.perception.known.paths import best_path
from atw_mcp.perception.known.unchanged import unchanged
from atw_mcp.perception.observation import ObservationError
from polyworld.world.camera import Camera

WIDTH, HEIGHT, FRAMES, FOCAL, HIGH, RADIUS = 320, 240, 24, 300.0, 2.0, 0.12
PLACES = np.array([[-1.0, -0.7, 0.0], [1.0, -0.7, 0.0], [1.0, 0.7, 0.0], [-1.0, 0.7, 0.0]])


def from_above() -> Camera:
    """A camera that looks straight down on the floor from HIGH [m]."""
    return Camera(
        width=WIDTH,
        height=HEIGHT,
        intrinsics=((FOCAL, 0.0, (WIDTH - 1) / 2), (0.0, FOCAL, (HEIGHT - 1) / 2), (0.0, 0.0, 1.0)),
        rotation=((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        translation=(0.0, 0.0, HIGH),
    )


def from_the_side() -> Camera:
    """A camera 1 m above the floor and 2 m in front of the origin, that looks at it: y away from it, x to the right."""
    forward = np.array([0.0, 2.0, -1.0]) / np.sqrt(5.0)
    right = np.array([1.0, 0.0, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    centre = np.array([0.0, -2.0, 1.0])
    return Camera(
        width=WIDTH,
        height=HEIGHT,
        intrinsics=((FOCAL, 0.0, (WIDTH - 1) / 2), (0.0, FOCAL, (HEIGHT - 1) / 2), (0.0, 0.0, 1.0)),
        rotation=rotation.tolist(),
        translation=(-rotation @ centre).tolist(),
    )


def disc(frame: np.ndarray, centre: np.ndarray, radius: float, colour: tuple[int, int, int]) -> None:
    """Draw a disc at a fraction of a pixel."""
    place = (round(16 * float(centre[0])), round(16 * float(centre[1])))
    cv2.circle(frame, place, round(16 * radius), colour, cv2.FILLED, cv2.LINE_AA, 4)


def write(path: Path, frames: list[np.ndarray]) -> None:
    """Write frames with a camera's noise."""
    rng = np.random.default_rng(11)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 24, (WIDTH, HEIGHT))
    for frame in frames:
        writer.write(np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    writer.release()


def on_floor(x: np.ndarray, y: np.ndarray, radius: float = RADIUS) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (T, 2) and radii (T,) [px] of a ball on the floor at x, y [m], seen from the side."""
    centres = np.stack([x, y, np.full(len(x), radius)], axis=1)
    return from_the_side().project(centres), radius * FOCAL / from_the_side().to_camera(centres)[:, 2]


POST = np.array([[x, y, z] for x in (-0.15, 0.15) for y in (-0.35, -0.25) for z in (0.0, 0.8)])
AROUND = np.array([[-0.8, -0.5, 0.0], [0.8, -0.5, 0.0], [0.8, 0.6, 0.0], [-0.8, 0.6, 0.0]])
RED, GREY = (30, 30, 200), (120, 120, 120)


def past_the_post(path: Path, x: np.ndarray) -> np.ndarray:
    """Write a clip of a red ball at x (T,) [m] behind a grey post; returns its pixels (T, 2) and the visible parts."""
    pixels, radii = on_floor(x, np.full(len(x), 0.2))
    outline = cv2.convexHull(from_the_side().project(POST).astype(np.float32)).round().astype(np.int32)
    frames, seen = [], []
    for place, radius in zip(pixels, radii, strict=True):
        frame, ball = np.full((HEIGHT, WIDTH, 3), (110.0, 140.0, 130.0)), np.zeros((HEIGHT, WIDTH, 1), np.float32)
        disc(frame, place, radius, RED)
        disc(ball, place, radius, (1, 1, 1))
        whole = ball.sum()
        cv2.fillConvexPoly(frame, outline, (90, 90, 90))
        cv2.fillConvexPoly(ball, outline, (0, 0, 0))
        frames.append(frame)
        seen.append(ball.sum() / whole)
    write(path, frames)
    return np.concatenate([pixels, np.array(seen)[:, None]], axis=1)


def drawn(path: Path) -> dict[str, np.ndarray]:
    """Write a clip of a red ball that rolls past a green one at rest, and of a black mark that is neither; returns
    the balls' centres (T, 2) [px]."""
    rng = np.random.default_rng(7)
    floor = np.full((HEIGHT, WIDTH, 3), 120.0) + rng.normal(0, 6, (HEIGHT, WIDTH, 1))
    centres = {
        "runner": np.stack([np.linspace(40, 260, FRAMES), np.full(FRAMES, 80.0)], axis=1),
        "sleeper": np.tile([200.0, 170.0], (FRAMES, 1)),
    }
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 24, (WIDTH, HEIGHT))
    pixels = RADIUS * FOCAL / (HIGH - RADIUS)
    for t in range(FRAMES):
        frame = floor.copy()
        cv2.rectangle(frame, (20, 190), (60, 200), (10, 10, 10), cv2.FILLED)
        for name, colour in (("runner", (30, 30, 200)), ("sleeper", (40, 150, 30))):
            x, y = centres[name][t]
            cv2.circle(frame, (round(16 * x), round(16 * y)), round(16 * pixels), colour, cv2.FILLED, cv2.LINE_AA, 4)
        writer.write(np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    writer.release()
    return centres


def test_known_bodies_are_found_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    centres = drawn(path)
    bodies = [KnownBody("runner", "red", RADIUS, RADIUS), KnownBody("sleeper", "green ball", RADIUS, RADIUS)]
    seen = observe_known(path, bodies, from_above(), PLACES)
    assert seen.names == ("runner", "sleeper")
    diameter = 2 * RADIUS * FOCAL / (HIGH - RADIUS)
    for name, truth in centres.items():
        off = np.linalg.norm(seen.object(name).centroid - truth, axis=1)
        assert np.nanmedian(off) < 0.03 * diameter
        assert np.isfinite(off).all()


def test_a_body_that_is_not_there_is_named_in_the_warnings(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    bodies = [KnownBody("runner", "red", RADIUS, RADIUS), KnownBody("ghost", "purple", RADIUS, RADIUS)]
    seen = observe_known(path, bodies, from_above(), PLACES)
    assert seen.names == ("runner",)
    assert any("ghost" in text for text in seen.warnings)


def test_a_body_that_passes_behind_a_post_is_found_again(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    truth = past_the_post(path, np.linspace(-0.6, 0.6, 31))
    ball = KnownBody("ball", "red", RADIUS, RADIUS)
    seen = observe_known(path, [ball], from_the_side(), AROUND, fixtures=[POST]).object("ball")
    clear, gone = truth[:, 2] == 1.0, truth[:, 2] < 0.02
    assert clear.sum() > 10
    assert gone.sum() >= 3
    diameter = 2 * RADIUS * FOCAL / 2.4
    assert np.linalg.norm(seen.centroid[clear] - truth[clear, :2], axis=1).max() < 0.1 * diameter
    assert {seen.status[t] for t in np.flatnonzero(gone)} == {"hidden"}
    half = (truth[:, 2] > 0.4) & (truth[:, 2] < 1.0)
    assert half.any()
    assert all(seen.masks[t] is not None for t in np.flatnonzero(half))


def test_a_body_at_rest_of_which_a_post_leaves_a_third_is_found(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    truth = past_the_post(path, np.full(12, -0.16))
    assert 0.2 < truth[0, 2] < 0.45
    ball = KnownBody("ball", "red", RADIUS, RADIUS)
    seen = observe_known(path, [ball], from_the_side(), AROUND, fixtures=[POST]).object("ball")
    radius = RADIUS * FOCAL / 2.4
    assert np.isfinite(seen.centroid).all()
    assert np.median(seen.area) == pytest.approx(truth[0, 2] * np.pi * radius**2, rel=0.35)


def test_a_shadow_darker_than_the_body_is_not_part_of_it(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    floor, x = np.array([95.0, 150.0, 100.0]), np.linspace(60.0, 240.0, FRAMES)
    radius = RADIUS * FOCAL / (HIGH - RADIUS)
    frames = []
    for place in np.stack([x, np.full(FRAMES, 110.0)], axis=1):
        frame = np.full((HEIGHT, WIDTH, 3), floor)
        disc(frame, place + radius * np.array([0.9, 0.5]), radius, tuple((0.45 * floor).tolist()))
        disc(frame, place, radius, (30, 140, 30))
        frames.append(frame)
    write(path, frames)
    seen = observe_known(path, [KnownBody("ball", "green", RADIUS, RADIUS)], from_above(), PLACES).object("ball")
    # Half of the shadow can be seen: with it the mask would be 1.5 times as large, its middle off by 0.3 radii.
    assert np.linalg.norm(seen.centroid - np.stack([x, np.full(FRAMES, 110.0)], axis=1), axis=1).max() < 0.1 * radius
    assert np.median(seen.area) == pytest.approx(np.pi * radius**2, rel=0.25)


def two_alike(path: Path, one: np.ndarray, other: np.ndarray) -> None:
    """Write a clip of two equal red balls at pixels (T, 2), the first in front, on a plain floor seen from above."""
    frames = []
    for a, b in zip(one, other, strict=True):
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        for place in (b, a):
            disc(frame, place, RADIUS * FOCAL / (HIGH - RADIUS), RED)
        frames.append(frame)
    write(path, frames)


def line(start: tuple[float, float], end: tuple[float, float], count: int = FRAMES) -> np.ndarray:
    """Places (T, 2) at equal steps."""
    return np.linspace(start, end, count)


def test_look_alikes_that_cross_keep_their_names(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    one, other = line((50, 60), (270, 170)), line((50, 170), (270, 60))
    two_alike(path, one, other)
    bodies = [
        KnownBody("one", "red", RADIUS, RADIUS, (50, 60), 0),
        KnownBody("other", "red", RADIUS, RADIUS, (50, 170), 0),
    ]
    seen = observe_known(path, bodies, from_above(), PLACES)
    for name, truth in (("one", one), ("other", other)):
        off = np.linalg.norm(seen.object(name).centroid - truth, axis=1)
        apart = np.linalg.norm(one - other, axis=1) > 45.0
        assert np.nanmax(off[apart]) < 4.0


@pytest.mark.parametrize("chosen", ["one", "other"])
def test_a_pixel_chooses_between_bodies_of_one_colour(tmp_path: Path, chosen: str) -> None:
    path = tmp_path / "clip.avi"
    paths = {"one": line((60, 60), (250, 60)), "other": line((70, 170), (260, 170))}
    two_alike(path, paths["one"], paths["other"])
    pixel = (float(paths[chosen][0, 0]), float(paths[chosen][0, 1]))
    seen = observe_known(path, [KnownBody("it", "red", RADIUS, RADIUS, pixel)], from_above(), PLACES).object("it")
    assert np.nanmax(np.linalg.norm(seen.centroid - paths[chosen], axis=1)) < 4.0


def test_a_pixel_without_a_frame_is_in_the_first_that_shows_the_body(tmp_path: Path) -> None:
    # Both come in from the left edge; in frame 0 neither can be seen, and the later one passes the pixel in frame 16.
    path = tmp_path / "clip.avi"
    early, late = line((-30, 60), (290, 60), 30), line((-190, 170), (130, 170), 30)
    two_alike(path, early, late)
    where = early[int(np.argmax(early[:, 0] > 5.0))]
    body = KnownBody("it", "red", RADIUS, RADIUS, (float(where[0]), float(where[1])))
    seen = observe_known(path, [body], from_above(), PLACES).object("it")
    assert np.nanmedian(np.abs(seen.centroid[:, 1] - 60.0)) < 3.0


def test_a_frame_is_that_of_the_video_with_any_stride(tmp_path: Path) -> None:
    # One ball passes the pixel in frame 10, the other in frame 20, which is the tenth that is looked at.
    path = tmp_path / "clip.avi"
    one, other = line((50, 110), (270, 110), 31), line((270, 110), (50, 110), 31)
    other[:, 1] += 70.0 * np.abs(np.linspace(-2.0, 1.0, 31))
    one[:, 0] += float(other[20, 0] - one[10, 0])
    assert np.abs(one[10] - other[20]).max() < 1.0
    two_alike(path, one, other)
    body = KnownBody("it", "red", RADIUS, RADIUS, (float(one[10, 0]), float(one[10, 1])), 10)
    seen = observe_known(path, [body], from_above(), PLACES, stride=2)
    assert seen.frames == tuple(range(0, 31, 2))
    assert np.nanmax(np.linalg.norm(seen.object("it").centroid - one[::2], axis=1)[:8]) < 4.0


def test_a_pixel_in_a_frame_that_is_not_looked_at_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    body = KnownBody("runner", "red", RADIUS, RADIUS, (40.0, 80.0), 3)
    with pytest.raises(ObservationError, match="such as 2 or 4"):
        observe_known(path, [body], from_above(), PLACES, stride=2)


def test_a_path_out_of_sight_goes_on_as_it_went() -> None:
    def at(x: float) -> Candidate:
        return Candidate(x, 50.0, 10.0, 4.0)

    frames = [[at(10.0 + 8.0 * t)] for t in range(8)] + [[] for _ in range(6)]
    frames += [[at(70.0), at(10.0 + 8.0 * t), at(300.0)] for t in range(14, 18)]
    _, path = best_path(frames, {})
    assert [None if c is None else c.x for c in path[12:]] == [None, None] + [10.0 + 8.0 * t for t in range(14, 18)]


def test_the_distance_of_a_box_is_that_of_its_top_seen_from_above() -> None:
    box = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (0.0, 0.5)])
    depth = fixture_depths([box], from_above(), (HEIGHT // 2, WIDTH // 2))
    inside = np.isfinite(depth)
    middle = (slice(HEIGHT // 4 - 5, HEIGHT // 4 + 5), slice(WIDTH // 4 - 5, WIDTH // 4 + 5))
    assert depth[middle] == pytest.approx(HIGH - 0.5, rel=1e-5)
    assert inside.sum() == pytest.approx(0.2 * 0.4 * (FOCAL / 2 / (HIGH - 0.5)) ** 2, rel=0.1)


def test_bodies_look_larger_on_a_higher_floor() -> None:
    ball = KnownBody("ball", "red", RADIUS, RADIUS)
    for floor in (0.0, 0.5, -0.3):
        places = PLACES + np.array([0.0, 0.0, floor])
        sizes = sizes_of(ball, from_above(), places, (HEIGHT, WIDTH), floor)
        assert sizes.on_floor == pytest.approx(RADIUS * FOCAL / (HIGH - floor - RADIUS), rel=1e-5)


def test_what_names_no_colour_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    with pytest.raises(ObservationError, match="names no colour"):
        observe_known(path, [KnownBody("a", "heavy", RADIUS, RADIUS)], from_above(), PLACES)


def test_the_longest_colour_in_a_description_is_taken() -> None:
    assert colour_word("a dark grey cube") == "dark grey"
    assert colour_word("gray") == "grey"
    assert colour_word("metal sphere") is None


@pytest.mark.parametrize(("leaves", "light"), [(False, 1.0), (False, 1.2), (True, 1.0), (True, 1.2)])
def test_what_looks_the_same_while_the_body_is_elsewhere_is_no_body(leaves: bool, light: float) -> None:
    """A path that rests on a red spot and then moves: the spot stays, or goes with it; the light may change."""
    rng, radius, rests = np.random.default_rng(3), 8.0, 8
    spot, moving = (200.0, 180.0), line((60, 60), (250, 60), FRAMES - rests)
    places = np.concatenate([np.tile(spot, (rests, 1)), moving])
    frames = []
    for t, place in enumerate(places):
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        if t < rests or not leaves:
            disc(frame, np.array(spot), radius, RED)
        if t >= rests:
            disc(frame, place, radius, RED)
            frame *= light
        frames.append(np.clip(frame + rng.normal(0, 3, frame.shape), 0, 255).astype(np.uint8))
    path = [Candidate(x, y, radius, 1.0) for x, y in places]
    assert [(c.x, c.y) for c in unchanged(path, np.stack(frames))] == ([] if leaves else [spot])


def test_of_two_alike_the_smaller_one_is_known_when_it_lands(tmp_path: Path) -> None:
    """Thrown above the horizon, where nothing on the floor is, a ball has no size to compare until it comes down."""
    path, t = tmp_path / "clip.avi", np.linspace(0.0, 1.0, FRAMES)
    small, large = 0.08, 0.12
    flying = np.stack([-0.7 + 1.4 * t, 0.2 * t, small + np.maximum(4.4 * t * (0.8 - t), 0.0)], axis=1)
    resting = np.array([0.4, 0.4, large])
    forward, right = np.array([0.0, 1.0, -0.1]) / np.sqrt(1.01), np.array([1.0, 0.0, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    translation = -rotation @ np.array([0.0, -2.2, 0.5])
    camera = from_above().model_copy(update={"rotation": rotation.tolist(), "translation": translation.tolist()})
    frames = []
    for place in flying:
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        for centre, radius in ((resting, large), (place, small)):
            disc(frame, camera.project(centre), radius * FOCAL / camera.to_camera(centre)[2], RED)
        frames.append(frame)
    write(path, frames)
    around = np.array([[-0.8, -0.5, 0.0], [0.8, -0.5, 0.0], [0.8, 0.6, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.5, 0.9]])
    for names in (("small", "large"), ("large", "small")):
        sizes = {"small": small, "large": large}
        bodies = [KnownBody(name, "red", sizes[name], sizes[name]) for name in names]
        seen = observe_known(path, bodies, camera, around)
        for name, truth in (
            ("small", camera.project(flying)),
            ("large", np.tile(camera.project(resting), (FRAMES, 1))),
        ):
            assert np.nanmedian(np.linalg.norm(seen.object(name).centroid - truth, axis=1)) < 4.0
