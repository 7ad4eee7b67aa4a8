"""Motion in space from depth: exact depth of solids in known places gives those places back."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.perception.depth_tracks import centre_offset, depth_tracks, shape_of_area, surface_area
from atw_mcp.perception.import_images import DepthMaps, observation_of_masks
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.video import VideoInfo
from polyworld.pictures.render import render
from polyworld.world import World
from polyworld.world.camera import Camera
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, ConvexMesh, Cylinder, Sphere

CAMERA = Camera(
    width=320,
    height=240,
    intrinsics=((400.0, 0.0, 159.5), (0.0, 400.0, 119.5), (0.0, 0.0, 1.0)),
    rotation=((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    translation=(0.0, 1.0, 4.0),
)
BALL, CUBE = Sphere(radius=0.2), Box(half_extents=(0.15, 0.15, 0.15))
STEP = 0.04


def throw(t: np.ndarray) -> np.ndarray:
    """Centres (T, 3) of a ball thrown through the view, and towards the camera."""
    return np.stack([-0.9 + 1.5 * t, 0.6 - 0.8 * t, 0.7 + 2.6 * t - 0.5 * 9.81 * t**2], axis=1)


@pytest.fixture(scope="module")
def scene() -> tuple[ImageObservation, DepthMaps, np.ndarray]:
    """What an exact depth camera sees of the thrown ball and of a turning cube at rest."""
    times = np.arange(16) * STEP
    ball = throw(times)
    cube = np.tile([0.5, 0.0, 0.6], (16, 1))
    world = World(
        objects=(
            RigidObject(name="ball", shape=BALL, position=(0, 0, 0)),
            RigidObject(name="cube", shape=CUBE, position=(1, 0, 0)),
        )
    )
    masks: dict[str, list[np.ndarray]] = {"ball": [], "cube": []}
    depth, frames = [], []
    for t in range(16):
        turned = [[1, 0, 0, 0], [np.cos(0.05 * t), 0, 0, np.sin(0.05 * t)]]
        seen = render(world, np.stack([ball[t], cube[t]]), np.array(turned, dtype=float), CAMERA)
        masks["ball"].append(seen.mask(0))
        masks["cube"].append(seen.mask(1))
        objects = seen.mask(0) | seen.mask(1)
        depth.append(np.where(objects, seen.depth, np.nan))
        frames.append(seen.color[..., ::-1])
    info = VideoInfo("x.mp4", 16, 320, 240, 25.0, "0", 16)
    seen_all = observation_of_masks(masks, np.stack(frames), ImageObservation(info, tuple(range(16)), ()))
    return seen_all, DepthMaps(np.stack(depth).astype(np.float32), tuple(range(16))), ball


def test_a_thrown_ball_is_found_in_space(scene: tuple[ImageObservation, DepthMaps, np.ndarray]) -> None:
    seen, depth, ball = scene
    shapes = {"ball": BALL, "cube": CUBE}
    tracks, _ = depth_tracks(seen, CAMERA, depth, shapes, seconds_per_frame=STEP)
    error = np.linalg.norm(tracks.positions[:, tracks.index("ball")] - ball, axis=1)
    assert error.max() < 0.02 * BALL.radius + 0.004  # the silhouette is a cone's, not a cylinder's
    fall = np.polyfit(tracks.times, tracks.positions[:, tracks.index("ball"), 2], 2)[0]
    assert fall == pytest.approx(-0.5 * 9.81, rel=0.02)
    cube = tracks.positions[:, tracks.index("cube")]
    error = np.linalg.norm(cube - [0.5, 0.0, 0.6], axis=1)
    assert np.all(error < 3 * tracks.position_sigma[:, tracks.index("cube")])


def test_sizes_follow_from_projected_areas(scene: tuple[ImageObservation, DepthMaps, np.ndarray]) -> None:
    seen, depth, _ = scene
    _, shapes = depth_tracks(seen, CAMERA, depth, {"cube": CUBE}, seconds_per_frame=STEP)
    assert shapes["cube"] == CUBE
    kind = seen.object("ball").shape.name
    if kind != "sphere":
        pytest.skip(f"the rendered ball looks like a {kind} to the shape cue")
    ball = shapes["ball"]
    assert isinstance(ball, Sphere)
    assert ball.radius == pytest.approx(0.2, rel=0.06)


def test_surface_areas_agree_with_those_of_their_hulls() -> None:
    corners = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)]
    mesh = ConvexMesh(vertices=tuple(corners))
    assert surface_area(Box(half_extents=(0.1, 0.2, 0.3))) == pytest.approx(surface_area(mesh))
    ring = np.linspace(0, 2 * np.pi, 121)[:-1]
    points = [(float(np.cos(a)), float(np.sin(a)), z) for a in ring for z in (-0.5, 0.5)]
    drum = ConvexMesh(vertices=tuple(points))
    assert surface_area(Cylinder(radius=1.0, half_height=0.5)) == pytest.approx(surface_area(drum), rel=2e-3)
    assert centre_offset(Sphere(radius=0.3))[0] == pytest.approx(0.2)  # mean height of a hemisphere over its disc


def test_a_solid_of_an_area_has_that_mean_projected_area() -> None:
    for kind in ("sphere", "cube", "cylinder"):
        assert surface_area(shape_of_area(kind, 0.37)) / 4.0 == pytest.approx(0.37)


def test_depth_of_another_size_or_other_frames_is_refused(
    scene: tuple[ImageObservation, DepthMaps, np.ndarray],
) -> None:
    seen, depth, _ = scene
    small = DepthMaps(depth.depth[:, ::2, ::2], depth.frames)
    with pytest.raises(ObservationError, match="160 x 120"):
        depth_tracks(seen, CAMERA, small, seconds_per_frame=STEP)
    late = DepthMaps(depth.depth, tuple(range(100, 116)))
    with pytest.raises(ObservationError, match=r"100\.\.115"):
        depth_tracks(seen, CAMERA, late, seconds_per_frame=STEP)
