"""Checks the generator of clips against geometry, mechanics and itself."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.benchmarks.video_clips.bodies import Body, Scene
from tests.benchmarks.video_clips.camera import look_at
from tests.benchmarks.video_clips.clip import draw_clip
from tests.benchmarks.video_clips.looks import draw_look
from tests.benchmarks.video_clips.physics import simulate
from tests.benchmarks.video_clips.render import Studio, render
from tests.benchmarks.video_clips.textures import floor_png
from tests.benchmarks.video_clips.write import write_clip
from tests.offscreen_gl import needs_gl


def _ball(**changes: Any) -> Body:
    body = Body("A", "sphere", (0.1, 0.1, 0.1), (0.0, 0.0, 1.0), mass=0.3, rolling=0.01)
    return replace(body, **changes)


def test_a_tossed_ball_obeys_gravity() -> None:
    scene = Scene("tossed", (_ball(vel=(1.0, 0.2, 3.0)),), floor=False)
    run = simulate(scene, 0.6, 30)
    t = np.arange(len(run.frame_poses)) / 30
    wanted = np.stack([t, 0.2 * t, 1.0 + 3.0 * t - 4.905 * t**2], axis=1)
    np.testing.assert_allclose(run.frame_poses[:, 0, :3], wanted, atol=3e-3)
    np.testing.assert_allclose(run.frame_velocities[:, 0, 2], 3.0 - 9.81 * t, atol=1e-6)


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.85])
def test_a_dropped_ball_rebounds_by_its_restitution(restitution: float) -> None:
    scene = Scene("bouncing", (_ball(restitution=restitution),))
    run = simulate(scene, 1.0, 60)
    vertical = run.frame_velocities[:, 0, 2]
    rebound = float(vertical.max()) + 9.81 * float(np.argmax(vertical) / 60 - run.touches[0][3])
    impact = np.sqrt(2 * 9.81 * 0.95)
    assert rebound / impact == pytest.approx(restitution, abs=0.04)


def test_a_sliding_box_stops_where_friction_says() -> None:
    box = Body("A", "box", (0.1, 0.1, 0.06), (0.0, 0.0, 0.03), vel=(1.2, 0.0, 0.0), friction=0.25, restitution=0.1)
    run = simulate(Scene("floor", (box,)), 1.0, 30)
    assert run.frame_poses[-1, 0, 0] == pytest.approx(1.2**2 / (2 * 0.25 * 9.81), rel=0.03)


def test_colliding_balls_keep_momentum_and_part_by_their_restitution() -> None:
    a = _ball(pos=(0.0, 0.0, 1.0), vel=(1.0, 0.0, 0.0))
    b = _ball(name="B", pos=(0.3, 0.0, 1.0), mass=0.6)
    run = simulate(Scene("floor", (a, b), floor=False, mutual_restitution=0.7, gravity=1e-9), 0.5, 30)
    va, vb = run.frame_velocities[-1, :, 0]
    assert 0.3 * va + 0.6 * vb == pytest.approx(0.3, abs=1e-3)
    assert vb - va == pytest.approx(0.7, abs=0.04)
    assert [(p, q) for p, q, *_ in run.touches] == [("A", "B")]


def test_a_pendulum_swings_with_the_period_of_its_length() -> None:
    bob = _ball(pos=(0.0, 0.0, 0.5), joint="arm", pivot=(0.0, 0.0, 1.2), angle=0.1, mass=1.0)
    run = simulate(Scene("pendulum", (bob,)), 3.0, 60)
    x = run.frame_poses[:, 0, 0]
    crossings = np.flatnonzero(np.diff(np.sign(x))) / 60
    assert x[0] == pytest.approx(0.7 * np.sin(0.1), abs=1e-6)
    assert 2 * np.diff(crossings).mean() == pytest.approx(2 * np.pi * np.sqrt(0.7 / 9.81), rel=0.03)


def test_measured_points_lie_where_the_true_camera_projects_them() -> None:
    clip = draw_clip([5, 2], "entering", "camera_shake")
    assert len(clip.points) >= 6
    wanted = clip.cameras[0].project(np.array([p["position"] for p in clip.points]))[:, :2]
    off = np.linalg.norm(wanted - np.array([p["pixel"] for p in clip.points]), axis=1)
    assert off.max() < 2.0


@needs_gl
def test_a_point_projects_to_where_the_renderer_draws_it() -> None:
    look = replace(
        draw_look(np.random.default_rng(1), "no_shadow"), size=(320, 240), marks=False, floor="plain", reflectance=0.0
    )
    dot = Body("A", "sphere", (0.03, 0.03, 0.03), (0.21, 0.13, 0.4), rgb=(1.0, 0.0, 0.0))
    scene = Scene("floor", (dot,))
    studio = Studio(scene, look, floor_png(np.random.default_rng(0), look), 1.0)
    camera = look_at(np.array([0.1, 0.0, 0.2]), -60.0, 30.0, 1.5, 40.0, look.size)
    studio.pose(simulate(scene, 0.1, 30, keep_states=True).states[0], camera)
    picture, labels = studio.picture().astype(float), studio.labels(scene, ["A"])
    studio.close()
    for mask in ((picture[..., 0] - picture[..., 2]) > 100, labels == 1):
        rows, columns = np.nonzero(mask)
        u, v, _ = camera.project(np.array([dot.pos]))[0]
        assert (columns.mean(), rows.mean()) == pytest.approx((u, v), abs=0.35)


@needs_gl
def test_masks_cover_the_centres_of_visible_balls() -> None:
    clip = draw_clip([2, 4], "bouncing", "no_shadow")
    look = replace(clip.look, seconds=0.2, shutter=0.0, shadow="none")
    cameras = clip.cameras[: look.frames]
    film = render(np.random.default_rng(0), clip.scene, look, clip.run, cameras, clip.extent)
    for n, camera in enumerate(cameras):
        depths = camera.project(clip.run.frame_poses[n, :, :3])
        nearest = int(np.argmin(depths[:, 2]))
        u, v, _ = depths[nearest]
        if camera.inside(clip.run.frame_poses[n, nearest, :3][None], 2.0)[0]:
            assert film.labels[n, round(float(v)), round(float(u))] == nearest + 1
    assert np.any(film.labels > 0)


@needs_gl
def test_equal_seeds_write_equal_json(tmp_path: Path) -> None:
    seed = [30, 6, 0, 0]
    for folder in ("one", "two"):
        write_clip(tmp_path / folder, "clip", seed, "tossed", "no_shadow")
    for part in ("public/clip/known.json", "private/clip.json"):
        assert (tmp_path / "one" / part).read_bytes() == (tmp_path / "two" / part).read_bytes()
    public = (tmp_path / "one/public/clip/known.json").read_text()
    assert not any(word in public for word in ("friction", "restitution", "mass", "velocity"))
    facts = json.loads(public)
    assert len(facts["camera_points"]["points"]) >= 6
    assert (tmp_path / "one/public/clip" / facts["video"]).stat().st_size > 1000
