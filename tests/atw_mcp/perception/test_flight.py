"""Places of bodies that leave the floor, against their true paths; masks are drawn by projection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.flight.placing import Surroundings, with_flights
from atw_mcp.perception.flight.sightings import SightingSettings, sightings
from atw_mcp.perception.known_scene import Sized as Solid
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.observation import Cue, ImageObservation, ObservedObject, measure
from atw_mcp.perception.tracks import world_tracks
from atw_mcp.perception.video import VideoInfo
from polyworld.data.tracks import ObservedTracks, without_spread
from polyworld.world.camera import Camera
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.shapes import Cylinder, Sphere

Floats = NDArray[np.float64]

WIDTH, HEIGHT, FRAME = 480, 360, 1.0 / 30.0
G = 9.81
BALL = Sphere(radius=0.1)


def camera_at(place: Sequence[float], target: Sequence[float], focal: float = 420.0) -> Camera:
    """A camera with z up in its image, looking from a place at a target."""
    forward = np.asarray(target, dtype=float) - np.asarray(place, dtype=float)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return Camera(
        width=WIDTH,
        height=HEIGHT,
        intrinsics=((focal, 0, (WIDTH - 1) / 2), (0, focal, (HEIGHT - 1) / 2), (0, 0, 1)),
        rotation=tuple(tuple(row) for row in rotation.tolist()),
        translation=tuple((-rotation @ np.asarray(place, dtype=float)).tolist()),
    )


CAMERA = camera_at((0.0, -4.0, 1.4), (0.0, 0.0, 0.4))


def ball_mask(camera: Camera, place: Floats, radius: float) -> NDArray[np.bool_]:
    """Pixels whose rays meet a ball."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    away = place - camera.centre
    distance = np.linalg.norm(away)
    return np.asarray(
        camera.rays(np.stack([u, v], axis=-1)) @ (away / distance) >= np.sqrt(1 - (radius / distance) ** 2)
    )


def observed(masks: Sequence[NDArray[np.bool_]], motion: Floats | None = None) -> ImageObservation:
    """One object called ball, in full view in all frames."""
    stored = tuple(RunLengthMask.encode(mask) for mask in masks)
    centroid, box, area = measure(stored)
    count, cue = len(masks), Cue("unknown", 0.0, {})
    thing = ObservedObject(
        "ball",
        cue,
        cue,
        cue,
        ("visible",) * count,
        np.ones(count),
        centroid,
        box,
        area,
        stored,
        0,
        count - 1,
        False,
        False,
    )
    info = VideoInfo("", count, WIDTH, HEIGHT, 1.0 / FRAME, "", count)
    return ImageObservation(info, tuple(range(count)), (thing,), camera_motion=motion)


def placed(
    seen: ImageObservation, solid: Solid, about: Surroundings, camera: Camera = CAMERA
) -> tuple[ObservedTracks, dict[str, list[dict[str, object]]]]:
    tracks = world_tracks(seen, camera, {"ball": solid}, seconds_per_frame=FRAME)
    return with_flights(tracks, seen, camera, {"ball": solid}, about)


def bouncing(count: int, start: Floats, velocity: Floats, restitution: float) -> Floats:
    """Path (count, 3) of a ball that bounces on the floor z = 0, in closed form between bounces."""
    place, speed, clock = start.astype(float), velocity.astype(float), 0.0
    path = []
    for t in np.arange(count) * FRAME:
        while True:
            fall = place[2] - BALL.radius
            hit = clock + (speed[2] + np.sqrt(speed[2] ** 2 + 2.0 * G * fall)) / G
            if hit > t:
                break
            place = place + speed * (hit - clock)
            place[2] = BALL.radius
            speed = np.array([speed[0], speed[1], restitution * abs(speed[2] - G * (hit - clock))])
            clock = hit
        dt = t - clock
        path.append(place + speed * dt - np.array([0.0, 0.0, 0.5 * G * dt**2]))
    return np.array(path)


def test_a_ball_that_bounces_is_placed_in_the_air() -> None:
    truth = bouncing(32, np.array([-0.9, 0.5, 0.8]), np.array([1.4, -0.6, 1.0]), 0.75)
    tracks, motions = placed(observed([ball_mask(CAMERA, p, BALL.radius) for p in truth]), BALL, Surroundings())
    assert {part["motion"] for part in motions["ball"]} == {"flight"}
    off = np.linalg.norm(tracks.positions[:, 0] - truth, axis=1)
    assert np.median(off) < 0.01
    assert off.max() < 0.03
    assert tracks.position_spread is not None
    unexplained = without_spread(tracks.positions[:, 0] - truth, tracks.position_spread[:, 0])
    assert np.all(np.linalg.norm(unexplained, axis=1) < 3.0 * tracks.position_sigma[:, 0])
    bounces = [t for t in range(1, 31) if truth[t, 2] < min(truth[t - 1, 2], truth[t + 1, 2])]
    assert len(motions["ball"]) == len(bounces) + 1
    assert abs(int(str(motions["ball"][1]["first"])) - bounces[0]) <= 1


def test_shadows_that_join_the_mask_for_some_frames_do_not_move_the_flight() -> None:
    rng = np.random.default_rng(5)
    truth = bouncing(28, np.array([-0.8, 0.3, 0.6]), np.array([1.5, 0.2, 1.8]), 0.6)
    masks = []
    for t, place in enumerate(truth):
        mask = ball_mask(CAMERA, place + rng.normal(0.0, 0.004, 3), BALL.radius)
        if t % 7 in (3, 4):
            mask = mask | np.roll(mask, (7, 4), axis=(0, 1))
        masks.append(mask)
    tracks, motions = placed(observed(masks), BALL, Surroundings())
    assert "flight" in {part["motion"] for part in motions["ball"]}
    off = np.linalg.norm(tracks.positions[:, 0] - truth, axis=1)[tracks.confidence[:, 0] > 0]
    assert np.median(off) < 0.4 * BALL.radius
    assert len(off) > 20


@pytest.mark.parametrize("place", [(0.0, -4.0, 1.4), (0.5, -2.5, 3.0)])
def test_a_ball_that_rolls_stays_on_the_floor(place: tuple[float, float, float]) -> None:
    camera = camera_at(place, (0.0, 0.0, 0.1))
    t = np.arange(30)[:, None] * FRAME
    truth = np.array([-0.8, -0.3, BALL.radius]) + t * [1.6, 0.5, 0.0] - 0.5 * t**2 * [0.8, 0.25, 0.0]
    seen = observed([ball_mask(camera, p, BALL.radius) for p in truth])
    plain = world_tracks(seen, camera, {"ball": BALL}, seconds_per_frame=FRAME)
    tracks, motions = placed(seen, BALL, Surroundings(), camera)
    assert motions == {}
    np.testing.assert_array_equal(tracks.positions, plain.positions)


def test_from_far_above_where_heights_do_not_show_a_ball_stays_on_the_floor() -> None:
    camera = camera_at((0.0, -0.01, 400.0), (0.0, 0.0, 0.0), focal=40000.0)
    t = np.arange(24)[:, None] * FRAME
    truth = np.array([-0.8, -0.3, BALL.radius]) + t * [1.6, 0.5, 0.0]
    _, motions = placed(observed([ball_mask(camera, p, BALL.radius) for p in truth]), BALL, Surroundings(), camera)
    assert motions == {}


def ramp(angle: float) -> tuple[Callable[[float], Floats], dict[str, tuple[tuple[float, float, float], ...]]]:
    """Centres of a ball at distances down a ramp that falls along x, and the ramp's corners; it ends at the origin."""
    down = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    corners = [
        s * down + np.array([0.0, y, 0.0]) + d * normal for s in (-1.4, 0.0) for y in (-0.3, 0.3) for d in (-0.04, 0)
    ]
    return lambda s: (s - 1.4) * down + BALL.radius * normal, {"ramp": tuple(tuple(c.tolist()) for c in corners)}


def test_a_ball_that_rolls_down_a_ramp_is_placed_on_it_and_then_on_the_floor() -> None:
    angle = np.deg2rad(25.0)
    along, fixtures = ramp(angle)
    pull = 5.0 / 7.0 * G * np.sin(angle)  # a ball rolls down with 5/7 of gravity's pull along the slope
    last = np.sqrt(2.0 * 1.2 / pull)
    truth = []
    for t in np.arange(36) * FRAME:
        if t < last:
            truth.append(along(0.5 * pull * t**2))
        else:
            end = along(1.2)
            truth.append(np.array([end[0] + pull * last * (t - last), 0.0, BALL.radius]))
    seen = observed([ball_mask(CAMERA, p, BALL.radius) for p in truth])
    tracks, motions = placed(seen, BALL, Surroundings(fixtures=fixtures))
    first, *_, rest = motions["ball"]
    assert (first["motion"], rest["motion"]) == ("ramp", "floor")
    away = np.abs(np.arange(36) * FRAME - last) > 2.5 * FRAME
    off = np.linalg.norm(tracks.positions[:, 0] - truth, axis=1)[away & (tracks.confidence[:, 0] > 0)]
    assert len(off) > 28
    assert off.max() < 0.01


def cylinder_mask(camera: Camera, place: Floats, axis: Floats, solid: Cylinder) -> NDArray[np.bool_]:
    one = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    one /= np.linalg.norm(one)
    turns = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)[:, None]
    ring = solid.radius * (np.cos(turns) * one + np.sin(turns) * np.cross(axis, one))
    points = np.concatenate([place + ring + s * solid.half_height * axis for s in (-1.0, 1.0)])
    hull = cv2.convexHull(camera.project(points).astype(np.float32))
    big = np.zeros((8 * HEIGHT, 8 * WIDTH), dtype=np.uint8)
    cv2.fillConvexPoly(big, np.round(hull * 8 + 3.5).astype(np.int32), 1)
    small = cv2.resize(big.astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.asarray(small > 0.5)


@pytest.mark.parametrize("angle", [20.0, 75.0, 140.0])
def test_a_cylinder_on_its_side_is_distinguished_from_one_that_stands(angle: float) -> None:
    solid = Cylinder(radius=0.1, half_height=0.07)
    axis = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0.0])
    t = np.arange(20)[:, None] * FRAME
    rolling = np.array([-0.3, 0.2, solid.radius]) + 0.8 * t * np.cross(axis, [0.0, 0.0, 1.0])
    masks = [cylinder_mask(CAMERA, place, axis, solid) for place in rolling]
    tracks = world_tracks(observed(masks), CAMERA, {"ball": solid}, seconds_per_frame=FRAME)
    np.testing.assert_allclose(tracks.positions[:, 0], rolling, atol=0.01)
    own = np.array([quaternion_matrix(turn)[:, 2] for turn in tracks.orientations[:, 0]])
    assert np.all(np.abs(own @ axis) > np.cos(np.deg2rad(4.0)))
    assert tracks.symmetry == (0,)
    standing = rolling + np.array([0.0, 0.0, solid.half_height - solid.radius])
    masks = [cylinder_mask(CAMERA, place, np.array([0.0, 0.0, 1.0]), solid) for place in standing]
    tracks = world_tracks(observed(masks), CAMERA, {"ball": solid}, seconds_per_frame=FRAME)
    np.testing.assert_allclose(tracks.positions[:, 0], standing, atol=0.012)
    assert np.median(np.abs(tracks.positions[:, 0] - standing)) < 0.002
    assert not tracks.orientation_confidence.any()


def test_places_are_freed_of_the_motion_of_a_camera_held_by_hand() -> None:
    rng = np.random.default_rng(8)
    truth = np.array([0.2, 0.1, BALL.radius]) + np.arange(12)[:, None] * FRAME * [0.5, 0.3, 0.0]
    motion = np.zeros((12, 2, 3))
    masks = []
    for t, place in enumerate(truth):
        turn, shift = (rng.normal(0.0, 0.005), rng.normal(0.0, 4.0, 2)) if t else (0.0, np.zeros(2))
        motion[t] = [[np.cos(turn), -np.sin(turn), shift[0]], [np.sin(turn), np.cos(turn), shift[1]]]
        still = ball_mask(CAMERA, place, BALL.radius).astype(np.float32)
        masks.append(cv2.warpAffine(still, motion[t], (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR) > 0.5)
    shaken = world_tracks(observed(masks), CAMERA, {"ball": BALL}, seconds_per_frame=FRAME)
    assert np.abs(shaken.positions[:, 0] - truth).max() > 0.04
    seen = observed(masks, motion)
    steady = world_tracks(seen, CAMERA, {"ball": BALL}, seconds_per_frame=FRAME)
    np.testing.assert_allclose(steady.positions[:, 0], truth, atol=0.012)  # half a pixel along the floor
    again = ImageObservation.from_dict(seen.to_dict())
    assert again.camera_motion is not None
    np.testing.assert_allclose(again.camera_motion, motion, atol=1e-6)


def test_frames_without_the_body_do_not_make_the_others_vague() -> None:
    """Hidden between its first two frames and the rest, a ball is still seen to a pixel in these."""
    truth = bouncing(24, np.array([-0.9, 0.5, 0.8]), np.array([1.4, -0.6, 1.0]), 0.75)
    seen = observed([ball_mask(CAMERA, p, BALL.radius) for p in truth])
    (ball,) = seen.objects
    status = tuple("hidden" if 2 <= t < 9 else "visible" for t in range(24))
    times = np.arange(24) * FRAME
    whole, parted = (
        sightings(replace(seen, objects=(one,)), "ball", CAMERA, BALL, times, SightingSettings())
        for one in (ball, replace(ball, status=status))
    )
    assert whole is not None
    assert parted is not None
    np.testing.assert_allclose(parted.across, whole.across[[0, 1, *range(9, 24)]], rtol=0.3)
