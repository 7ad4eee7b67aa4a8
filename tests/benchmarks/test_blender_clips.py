"""Checks the geometry of the clips filmed by Blender, without Blender."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from tests.benchmarks.blender_clips import __main__ as command
from tests.benchmarks.blender_clips.hand import hand_solid, sleeve_solid, withdrawal
from tests.benchmarks.blender_clips.motion import label_names, read_motion
from tests.benchmarks.blender_clips.optics import blender_camera, quaternion
from tests.benchmarks.blender_clips.place import covers_path, covers_point, find_room, path_points
from tests.benchmarks.blender_clips.setting import STYLES, draw_style
from tests.benchmarks.blender_clips.solids import Solid, box, capsule, cylinder, sheet, smooth_path, sphere, tube
from tests.benchmarks.video_clips.bodies import Array, Body, Rejected, Scene
from tests.benchmarks.video_clips.camera import look_at, turned
from tests.benchmarks.video_clips.clip import Clip, draw_with_look
from tests.benchmarks.video_clips.kinds import KINDS
from tests.benchmarks.video_clips.looks import draw_look
from tests.benchmarks.video_clips.physics import simulate


def _clip(kind: str, style: str = "window_light", seed: int = 4) -> Clip:
    rng = np.random.default_rng(seed)
    for _ in range(60):
        look, _ = draw_style(rng, style, kind)
        try:
            return draw_with_look(rng, kind, look)
        except (Rejected, FloatingPointError):
            continue
    raise AssertionError("no usable draw")


@pytest.mark.parametrize("size", [(480, 270), (270, 480), (480, 360)])
def test_blender_projects_points_where_the_clip_camera_does(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(size[1])
    camera = look_at(np.array([0.1, -0.2, 0.3]), 37.0, 21.0, 2.4, 41.0, size)
    camera = turned(camera, 0.05, -0.03, 0.08, np.array([0.02, 0.01, -0.03]))
    points = rng.uniform(-0.6, 0.6, (50, 3))
    np.testing.assert_allclose(blender_camera(camera).project(points), camera.project(points)[:, :2], atol=1e-9)


def test_quaternions_turn_as_their_matrices_do() -> None:
    turns = [*Rotation.random(40, random_state=1), *(Rotation.from_rotvec(np.pi * v) for v in np.eye(3))]
    for turn in turns:
        w, *xyz = quaternion(turn.as_matrix())
        np.testing.assert_allclose(Rotation.from_quat([*xyz, w]).as_matrix(), turn.as_matrix(), atol=1e-12)


def _mesh(solid: Solid) -> trimesh.Trimesh:
    triangles = [(f[0], f[k], f[k + 1]) for f in solid.faces for k in range(1, len(f) - 1)]
    return trimesh.Trimesh(solid.vertices, triangles, process=False)


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (box((0.1, 0.2, 0.3)), 0.006),
        (sphere(0.2), np.pi / 6 * 0.2**3),
        (cylinder(0.1, 0.3), np.pi / 4 * 0.1**2 * 0.3),
        (capsule(0.1, 0.3), np.pi / 4 * 0.1**2 * 0.3 + np.pi / 6 * 0.1**3),
        (tube(np.linspace([0, 0, 0], [0.0, 0.3, 0.4], 9), 0.02, 64), np.pi / 4 * 0.02**2 * 0.5),
    ],
)
def test_solids_are_closed_and_face_outwards(solid: Solid, volume: float) -> None:
    mesh = _mesh(solid)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.02)


def test_a_sheet_has_its_area_and_a_rope_passes_its_joints() -> None:
    grid = np.array([[0.1 * i, 0.0, 0.05 * k] for i in range(5) for k in range(4)])
    assert _mesh(sheet(grid, (5, 4), (0.4, 0.15))).area == pytest.approx(0.4 * 0.15)
    joints = np.array([[0.0, 0, 0], [0.1, 0, -0.1], [0.1, 0.1, -0.2], [0.0, 0.1, -0.3]])
    path = smooth_path(joints, 301)
    for p in joints:
        assert np.linalg.norm(path - p, axis=1).min() < 1e-9


def test_poses_at_the_ends_of_the_shutter_lie_on_the_parabola() -> None:
    look = replace(draw_look(np.random.default_rng(0), "no_shadow"), fps=30, seconds=0.4, shutter=0.5)
    ball = Body("A", "sphere", (0.1, 0.1, 0.1), (0.0, 0.0, 1.0), vel=(1.0, 0.2, 2.0), spin=(0.0, 30.0, 0.0))
    scene = Scene("tossed", (ball,), floor=False)
    motion = read_motion(scene, look, simulate(scene, look.seconds, look.fps, keep_states=True))
    (part,) = motion.parts
    assert (part.label, label_names(scene)) == (1, ["A"])
    inside = (motion.times >= 0) & (motion.times <= look.frames - 1)
    t = motion.times[inside] / look.fps
    wanted = np.stack([t, 0.2 * t, 1.0 + 2.0 * t - 4.905 * t**2], axis=1)
    np.testing.assert_allclose(part.poses[inside, :3], wanted, atol=2e-3)
    turned_by = 2 * np.unwrap(np.arctan2(part.poses[inside, 5], part.poses[inside, 3]))
    np.testing.assert_allclose(turned_by, 30.0 * t, atol=1e-2)
    assert np.all(np.sum(part.poses[1:, 3:] * part.poses[:-1, 3:], axis=1) > 0)


def test_wheels_bear_the_label_of_their_cart_and_rods_none() -> None:
    for kind, count in (("cart", 4), ("pendulum", 0)):
        clip = _clip(kind)
        motion = read_motion(clip.scene, clip.look, clip.run)
        unnamed = [p.label for p in motion.parts if not p.name]
        carts = sum(b.joint == "track" for b in clip.scene.bodies)
        assert unnamed == ([k + 1 for k in range(carts) for _ in range(count)] if kind == "cart" else [0])


def _posed(solid: Solid, pose: Array) -> Array:
    w, *xyz = pose[3:]
    return np.asarray(Rotation.from_quat([*xyz, w]).apply(solid.vertices) + pose[:3])


@pytest.mark.parametrize("seed", [1, 2])
def test_the_hand_withdraws_without_passing_through_a_ball(seed: int) -> None:
    clip = _clip("billiard", "hand", seed)
    path = withdrawal(np.random.default_rng(seed), clip)
    if path is None:
        pytest.skip("the moving ball starts out of view")
    radius = clip.scene.bodies[0].size[0] / 2
    moving = int(np.argmax([np.linalg.norm(b.vel) for b in clip.scene.bodies]))
    solids = hand_solid(), sleeve_solid()
    for n in range(0, clip.look.frames, 3):
        pose = path.poses[list(path.times).index(n)]
        skin = np.vstack([_posed(s, pose) for s in solids])
        assert np.linalg.norm(skin - clip.run.frame_poses[n, moving, :3], axis=1).min() > 0.95 * radius
    assert np.linalg.norm(path.poses[-1, :3] - path.poses[0, :3]) > 0.3


@pytest.mark.parametrize("kind", ["floor", "pendulum", "tossed"])
def test_the_back_wall_stands_behind_all_motion(kind: str) -> None:
    clip = _clip(kind)
    _, setting = draw_style(np.random.default_rng(0), "window_light", kind)
    room = find_room(clip, setting)
    assert ((path_points(clip) - room.centre) @ room.ahead).max() < room.back
    assert (np.asarray(clip.cameras[0].pos) - room.centre) @ room.ahead < 0
    assert room.ahead @ room.across == pytest.approx(0, abs=1e-12)


def test_things_before_measured_points_and_paths_are_noticed() -> None:
    clip = _clip("floor")
    eye = np.asarray(clip.cameras[0].pos)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.03
    point, on_path = np.array(clip.points[0]["position"]), path_points(clip)[0]
    assert covers_point(clip, eye + 0.6 * (point - eye) + corners)
    assert covers_path(clip, eye + 0.6 * (on_path - eye) + corners)
    behind = eye + 3.0 * (point - eye) + corners
    assert not covers_point(clip, behind)
    assert not covers_path(clip, behind)


def test_a_round_of_clips_has_every_kind_and_style_and_hands_only_where_something_is_pushed() -> None:
    for seed in range(20):
        pairs = command.plan(seed, 12, list(KINDS))
        assert {s for _, s in pairs} == set(STYLES)
        assert {k for k, _ in pairs} == set(KINDS)
        assert all(k in command.PUSHED for k, s in pairs if s == "hand")


def test_the_command_names_the_group_that_brings_blender(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "find_spec", lambda _: None)
    monkeypatch.setattr("sys.argv", ["blender_clips", "somewhere"])
    with pytest.raises(SystemExit, match="bench-blender"):
        command.main()
