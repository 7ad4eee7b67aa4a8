"""Known bodies in drawn clips: balls of known paths on a floor seen from above at an angle."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from atw_mcp.perception.eye.colour_names import colour_word
from atw_mcp.perception.known_bodies import KnownBody, observe_known
from atw_mcp.perception.known_scene import KnownScene, fixture_depths
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.tracks import world_tracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.shapes import Box, Cylinder, Sphere
from tests.atw_mcp.clips import write_film

WIDTH, HEIGHT, FRAMES, FOCAL, HIGH, RADIUS = 320, 240, 16, 300.0, 2.0, 0.12
BALL = Sphere(radius=RADIUS)
SIDE = MotionPlane(point=(0.0, 0.0, 0.0), normal=(0.0, -1.0, 0.0), supports=False)


def looked_for(
    path: Path, bodies: list[KnownBody], camera: Camera, *, posts: tuple[np.ndarray, ...] = (), stride: int = 1
) -> ImageObservation:
    """Look for balls of RADIUS on the floor."""
    corners = tuple(tuple((float(x), float(y), float(z)) for x, y, z in post) for post in posts)
    scene = KnownScene(camera, solids={body.name: BALL for body in bodies}, fixtures=corners)
    return observe_known(path, bodies, scene, stride=stride)


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
    write_film(path, (frame + rng.normal(0, 2, frame.shape) for frame in frames), rate=24, code="MJPG")


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


def test_known_bodies_are_found_and_nothing_else_and_what_is_not_there_is_named(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    centres = drawn(path)
    bodies = [KnownBody("runner", "red"), KnownBody("sleeper", "green ball"), KnownBody("ghost", "purple")]
    seen = looked_for(path, bodies, from_above())
    assert seen.names == ("runner", "sleeper")
    assert any("ghost was not found" in text for text in seen.notes)
    diameter = 2 * RADIUS * FOCAL / (HIGH - RADIUS)
    for name, truth in centres.items():
        off = np.linalg.norm(seen.object(name).centroid - truth, axis=1)
        assert np.nanmedian(off) < 0.03 * diameter
        assert np.isfinite(off).all()


def test_a_body_that_passes_behind_a_post_is_found_again(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    truth = past_the_post(path, np.linspace(-0.6, 0.6, 25))
    ball = KnownBody("ball", "red")
    seen = looked_for(path, [ball], from_the_side(), posts=(POST,)).object("ball")
    clear, gone = truth[:, 2] == 1.0, truth[:, 2] < 0.02
    assert clear.sum() > 8
    assert gone.sum() >= 2
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
    ball = KnownBody("ball", "red", (136.0, 96.0), 0)
    seen = looked_for(path, [ball], from_the_side(), posts=(POST,)).object("ball")
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
    seen = looked_for(path, [KnownBody("ball", "green")], from_above()).object("ball")
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
        KnownBody("one", "red", (50, 60), 0),
        KnownBody("other", "red", (50, 170), 0),
    ]
    seen = looked_for(path, bodies, from_above())
    for name, truth in (("one", one), ("other", other)):
        off = np.linalg.norm(seen.object(name).centroid - truth, axis=1)
        apart = np.linalg.norm(one - other, axis=1) > 45.0
        assert np.nanmax(off[apart]) < 4.0


def test_a_pixel_chooses_between_bodies_of_one_colour(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    paths = {"one": line((60, 60), (250, 60)), "other": line((70, 170), (150, 190))}
    two_alike(path, paths["one"], paths["other"])
    pixel = (float(paths["other"][0, 0]), float(paths["other"][0, 1]))
    seen = looked_for(path, [KnownBody("it", "red", pixel)], from_above()).object("it")
    assert np.nanmax(np.linalg.norm(seen.centroid - paths["other"], axis=1)) < 4.0


def test_a_pixel_without_a_frame_is_in_the_first_that_shows_the_body(tmp_path: Path) -> None:
    # Both come in from the left edge; in frame 0 neither can be seen, and the later one passes the pixel in frame 16.
    path = tmp_path / "clip.avi"
    early, late = line((-30, 60), (290, 60), 30), line((-190, 170), (130, 170), 30)
    two_alike(path, early, late)
    where = early[int(np.argmax(early[:, 0] > 5.0))]
    body = KnownBody("it", "red", (float(where[0]), float(where[1])))
    seen = looked_for(path, [body], from_above()).object("it")
    assert np.nanmedian(np.abs(seen.centroid[:, 1] - 60.0)) < 3.0


def test_a_frame_is_that_of_the_video_with_any_stride(tmp_path: Path) -> None:
    # One ball passes the pixel in frame 10, the other in frame 20, which is the tenth that is looked at.
    path = tmp_path / "clip.avi"
    one, other = line((50, 110), (270, 110), 31), line((270, 110), (50, 110), 31)
    other[:, 1] += 70.0 * np.abs(np.linspace(-2.0, 1.0, 31))
    one[:, 0] += float(other[20, 0] - one[10, 0])
    assert np.abs(one[10] - other[20]).max() < 1.0
    two_alike(path, one, other)
    body = KnownBody("it", "red", (float(one[10, 0]), float(one[10, 1])), 10)
    seen = looked_for(path, [body], from_above(), stride=2)
    assert seen.frames == tuple(range(0, 31, 2))
    assert np.nanmax(np.linalg.norm(seen.object("it").centroid - one[::2], axis=1)[:8]) < 4.0


def test_a_pixel_in_a_frame_that_is_not_looked_at_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    body = KnownBody("runner", "red", (40.0, 80.0), 3)
    with pytest.raises(ObservationError, match="such as 2 or 4"):
        looked_for(path, [body], from_above(), stride=2)


def test_the_distance_of_a_box_is_that_of_its_top_seen_from_above() -> None:
    box = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (0.0, 0.5)])
    depth = fixture_depths([box], from_above(), (HEIGHT, WIDTH))
    middle = (slice(HEIGHT // 2 - 10, HEIGHT // 2 + 10), slice(WIDTH // 2 - 10, WIDTH // 2 + 10))
    assert depth[middle] == pytest.approx(HIGH - 0.5, rel=1e-5)
    assert np.isfinite(depth).sum() == pytest.approx(0.2 * 0.4 * (FOCAL / (HIGH - 0.5)) ** 2, rel=0.1)


def test_what_names_no_colour_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    with pytest.raises(ObservationError, match="names no colour"):
        looked_for(path, [KnownBody("a", "heavy")], from_above())


def test_the_longest_colour_in_a_description_is_taken() -> None:
    assert colour_word("a dark grey cube") == "grey"
    assert colour_word("gray_box") == "grey"
    assert colour_word("navy blue ball on a red mat") == "blue"
    assert colour_word("teal") == "cyan"
    assert colour_word("chocolate") == "brown"
    assert colour_word("metal sphere") is None


def side_camera() -> Camera:
    """A camera 3 m before the upright plane y = 0, 1 m above the floor, that looks along +y."""
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return from_above().model_copy(
        update={
            "rotation": rotation.tolist(),
            "translation": (-rotation @ np.array([0.0, -3.0, 1.0])).tolist(),
        }
    )


def test_places_in_a_side_view_are_those_in_its_plane_of_motion(tmp_path: Path) -> None:
    """A ball on a parabola and a rod that rotates, both with sizes in metres: nothing is a distance from a floor."""
    path, t = tmp_path / "clip.avi", np.linspace(0.0, 0.8, FRAMES)
    camera = side_camera()
    ball = np.stack([-1.2 + 2.4 * t, 0 * t, 0.5 + 4.0 * t - 4.905 * t**2], axis=1)
    angle = 0.3 + 1.5 * t
    half = np.array([0.3, 0.05, 0.05])
    frames = []
    for place, turn in zip(ball, angle, strict=True):
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        cosine, sine = np.cos(turn), np.sin(turn)
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
        rotated = corners @ np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]) + [0.5, 0.0, 0.45]
        hull = cv2.convexHull((camera.project(rotated) * 16).astype(np.float32)).round().astype(np.int32)
        cv2.fillConvexPoly(frame, hull, (150, 60, 20), cv2.LINE_AA, 4)
        depth = camera.to_camera(place)[2]
        disc(frame, camera.project(place), 0.06 * FOCAL / depth, RED)
        frames.append(frame)
    write(path, frames)
    solids = {"ball": Sphere(radius=0.06), "rod": Box(half_extents=(0.3, 0.05, 0.05))}
    seen = observe_known(path, [KnownBody("ball", "red"), KnownBody("rod", "blue")], KnownScene(camera, SIDE, solids))
    tracks = world_tracks(seen, camera, solids, SIDE, seconds_per_frame=0.04)
    off = np.linalg.norm(tracks.positions[:, 0] - ball, axis=1)
    assert np.nanmedian(off) < 0.003
    assert np.nanmax(off) < 0.01
    assert tracks.confidence[:, 0].min() > 0.8
    off = np.linalg.norm(tracks.positions[:, 1] - [0.5, 0.0, 0.45], axis=1)
    assert np.nanmedian(off) < 0.005
    turns = tracks.orientations[:, 1]
    found = np.unwrap(2 * np.arctan2(-turns[:, 2], turns[:, 0]), period=np.pi)
    assert np.abs(found - found[0] - (angle - angle[0])).max() < 0.05
    assert tracks.symmetry == (0, 2)


def test_tracks_take_the_places_that_were_followed_with_errors_that_hold(tmp_path: Path) -> None:
    path, x = tmp_path / "clip.avi", np.linspace(-0.6, 0.6, FRAMES)
    pixels, radii = on_floor(x, np.full(FRAMES, 0.3))
    frames = []
    for place, radius in zip(pixels, radii, strict=True):
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        disc(frame, place, radius, RED)
        frames.append(frame)
    write(path, frames)
    seen = looked_for(path, [KnownBody("ball", "red")], from_the_side())
    again = ImageObservation.from_dict(seen.to_dict())
    tracks = world_tracks(again, from_the_side(), {"ball": BALL}, seconds_per_frame=0.04)
    truth = np.stack([x, np.full(FRAMES, 0.3), np.full(FRAMES, RADIUS)], axis=1)
    off = np.linalg.norm(tracks.positions[:, 0] - truth, axis=1)
    assert np.median(off) < 0.01
    assert np.median(off / tracks.position_sigma[:, 0]) < 1.5
    other = MotionPlane(point=(0.0, 0.0, 0.2))
    higher = world_tracks(again, from_the_side(), {"ball": BALL}, other, seconds_per_frame=0.04)
    assert np.nanmedian(higher.positions[:, 0, 2]) == pytest.approx(0.2 + RADIUS)


def test_ball_that_leaves_the_floor_is_followed_in_the_image_and_said_to(tmp_path: Path) -> None:
    path, t = tmp_path / "clip.avi", np.linspace(0.0, 0.8, FRAMES)
    flying = np.stack([-0.7 + 1.4 * t, 0 * t, RADIUS + 3.924 * t - 4.905 * t**2], axis=1)
    camera, frames = from_the_side(), []
    for place in flying:
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        disc(frame, camera.project(place), RADIUS * FOCAL / camera.to_camera(place)[2], RED)
        frames.append(frame)
    write(path, frames)
    seen = looked_for(path, [KnownBody("ball", "red")], camera)
    ball = seen.object("ball")
    whole = np.array(ball.status) == "visible"
    assert whole.sum() > FRAMES // 3
    off = np.linalg.norm(ball.centroid - camera.project(flying), axis=1)[whole]
    assert np.median(off) < 0.3
    assert off.max() < 2.0
    assert ball.places is None
    assert any("ball is" in note and "leaves that" in note for note in seen.notes)


@pytest.mark.parametrize(("lies", "half"), [(True, 0.25), (False, 0.1)])
def test_cylinder_is_seen_to_stand_or_to_lie(tmp_path: Path, lies: bool, half: float) -> None:
    path, x, camera = tmp_path / "clip.avi", np.linspace(-0.5, 0.3, 11), from_the_side()
    can = Cylinder(radius=0.1, half_height=half)
    ring = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    own = np.concatenate([np.c_[0.1 * np.cos(ring), 0.1 * np.sin(ring), np.full(40, z)] for z in (-half, half)])
    turn = 0.6
    if lies:
        own = own[:, [2, 1, 0]] @ np.array(
            [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        )
    frames = []
    for place in x:
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        points = camera.project(own + np.array([place, 0.2, 0.1 if lies else half]))
        hull = cv2.convexHull((points * 16).astype(np.float32)).round().astype(np.int32)
        cv2.fillConvexPoly(frame, hull, (150, 60, 20), cv2.LINE_AA, 4)
        frames.append(frame)
    write(path, frames)
    seen = observe_known(path, [KnownBody("can", "blue")], KnownScene(camera, solids={"can": can}))
    tracks = world_tracks(seen, camera, {"can": can}, seconds_per_frame=0.04)
    truth = np.stack([x, np.full(11, 0.2), np.full(11, 0.1 if lies else half)], axis=1)
    assert np.nanmedian(np.linalg.norm(tracks.positions[:, 0] - truth, axis=1)) < 0.01
    assert (tracks.orientation_confidence[:, 0] > 0).all() == lies
    if lies:
        axis = quaternion_matrix(tracks.orientations[:, 0])[:, :, 2]
        assert np.abs(axis @ [np.cos(turn), np.sin(turn), 0.0]).min() > 0.998


def test_cylinder_across_a_side_view_is_followed_as_the_disc_that_it_shows(tmp_path: Path) -> None:
    """A roller of 0.1 m in radius and 0.4 m long, whose axis is along the view: places in the plane through its middle,
    and an axis across the plane in every frame."""
    path, x = tmp_path / "clip.avi", np.linspace(-0.5, 0.3, 16)
    camera = Camera.model_validate(side_camera().model_dump(warnings=False))
    roller, angle = Cylinder(radius=0.1, half_height=0.2), np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    own = np.concatenate([np.c_[0.1 * np.cos(angle), np.full(40, y), 0.1 * np.sin(angle)] for y in (-0.2, 0.2)])
    frames = []
    for place in x:
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        hull = cv2.convexHull((camera.project(own + np.array([place, 0.0, 0.1])) * 16).astype(np.float32))
        cv2.fillConvexPoly(frame, hull.round().astype(np.int32), (150, 60, 20), cv2.LINE_AA, 4)
        frames.append(frame)
    write(path, frames)
    scene = KnownScene(camera, SIDE, {"roller": roller}, across=frozenset({"roller"}))
    seen = observe_known(path, [KnownBody("roller", "blue")], KnownScene.from_dict(scene.to_dict()))
    tracks = world_tracks(seen, camera, {"roller": roller}, SIDE, seconds_per_frame=0.04)
    truth = np.stack([x, np.zeros(16), np.full(16, 0.1)], axis=1)
    assert np.nanmax(np.linalg.norm(tracks.positions[:, 0] - truth, axis=1)) < 0.01
    assert np.abs(quaternion_matrix(tracks.orientations[:, 0])[:, 1, 2]).min() > 0.999
    assert tracks.symmetry == (0,)


def test_black_and_white_bodies_are_not_exchanged_and_the_horizon_stops_nothing(tmp_path: Path) -> None:
    """A camera that looks nearly level: one body rolls away towards the horizon, the other is thrown over it."""
    path, t = tmp_path / "clip.avi", np.linspace(0.0, 1.0, FRAMES)
    forward, right = np.array([0.0, 1.0, -0.1]) / np.sqrt(1.01), np.array([1.0, 0.0, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    translation = -rotation @ np.array([0.0, -2.2, 0.5])
    camera = from_above().model_copy(update={"rotation": rotation.tolist(), "translation": translation.tolist()})
    places = {
        "black": np.stack([-0.5 + 0.2 * t, 1.5 * t, np.full(FRAMES, RADIUS)], axis=1),
        "white": np.stack([0.1 + 0.4 * t, 0 * t, RADIUS + np.maximum(4.4 * t * (1.0 - t), 0.0)], axis=1),
    }
    frames = []
    for k in range(FRAMES):
        frame = np.full((HEIGHT, WIDTH, 3), GREY, dtype=float)
        for name, colour in (("black", (25, 25, 25)), ("white", (230, 230, 230))):
            place = places[name][k]
            disc(frame, camera.project(place), RADIUS * FOCAL / camera.to_camera(place)[2], colour)
        frames.append(frame)
    write(path, frames)
    seen = looked_for(path, [KnownBody("white", "white"), KnownBody("black", "black")], camera)
    for name, truth in places.items():
        found = seen.object(name)
        off = np.linalg.norm(found.centroid - camera.project(truth), axis=1)
        radius = np.sqrt(found.area / np.pi)
        assert not ((off > 0.5 * radius) & (found.confidence > 0.8) & (np.array(found.status) == "visible")).any()
        assert np.nanmedian(off) < 1.0
