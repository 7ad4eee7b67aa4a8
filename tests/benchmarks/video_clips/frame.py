"""Frame a simulated scene: choose the camera, the marks on surfaces, an occluding post."""

from dataclasses import replace
from itertools import product
from typing import Any

import mujoco
import numpy as np
from numpy.random import Generator

from .bodies import DT, Array, Fixture, Rejected, Scene, Vec
from .camera import Camera, fit, move_back
from .looks import Look
from .mjcf import build
from .physics import Run

FAR = 1.5  # m from the origin beyond which motion is not framed


def corners(fixture: Fixture) -> Array:
    """Return the eight corners of a box fixture."""
    out = np.array([[sx, sy, sz] for sx, sy, sz in product((-0.5, 0.5), repeat=3)]) * np.asarray(fixture.size)
    turned = np.zeros(3)
    rows = []
    for row in out:
        mujoco.mju_rotVecQuat(turned, row, np.array(fixture.quat))
        rows.append(turned + np.asarray(fixture.pos))
    return np.array(rows)


def focus_points(scene: Scene, run: Run) -> Array:
    """Return the points that the camera should hold in view."""
    if scene.focus:
        return np.array(scene.focus)
    rows: list[Array] = []
    for i, name in enumerate(run.names):
        reach = next((b.size[0] / 2 for b in scene.bodies if b.name == name), 0.02)
        path = np.clip(run.frame_poses[:, i, :3], -FAR, FAR)
        for off in product((-reach, reach), repeat=3):
            rows.append(path + np.array(off))
    if run.frame_points is not None:
        rows.append(run.frame_points.reshape(-1, 3))
    for f in scene.fixtures:
        if f.name in ("ramp", "track"):
            rows.append(corners(f))
    for b in scene.bodies:
        if b.joint == "arm":
            rows.append(np.array([b.pivot]))
    points = np.vstack(rows)
    points[:, 2] = np.maximum(points[:, 2], 0.0)
    if scene.kind in ("tossed", "bouncing"):
        points = np.vstack([points, [points[0, 0], 0.0, 0.0]])
    return points


def place_camera(rng: Generator, scene: Scene, look: Look, points: Array) -> Camera:
    """Draw the direction of view and fit the distance; small bodies move the camera away."""
    low, high, down, up = scene.view
    azimuth, elevation = float(rng.uniform(low, high)), float(rng.uniform(down, up))
    if look.size[0] < look.size[1] and scene.kind == "billiard":
        azimuth += 90.0
    camera = fit(points, azimuth, elevation, look.fovy, look.size, float(rng.uniform(0.72, 0.96)))
    sizes = [b.size[2] if b.joint == "track" else b.size[0] for b in scene.bodies]
    if look.small and sizes:
        wanted = float(rng.uniform(7.5, 11.5))
        depth = camera.project(points.mean(axis=0))[0, 2]
        camera = move_back(camera, float(camera.focal * max(sizes) / wanted - depth))
    return camera


def draw_marks(rng: Generator, scene: Scene, look: Look, camera: Camera, points: Array) -> Scene:
    """Put marks on the floor and the board around the framed points, on whole centimetres."""
    low, high = points.min(axis=0), points.max(axis=0)
    depth = float(camera.project(points.mean(axis=0))[0, 2])
    if scene.kind not in ("floor", "entering", "billiard"):  # seen from the side: spread over most of the width
        middle, half = (low[0] + high[0]) / 2, 0.38 * look.size[0] * depth / camera.focal
        low[0], high[0] = min(low[0], middle - half), max(high[0], middle + half)
    behind = next((f for f in scene.fixtures if f.name == "board"), None)
    marks: list[Vec] = []
    facing: list[Vec] = []
    y_low, y_high = (low[1], high[1]) if high[1] - low[1] > 0.4 else (-0.25, 0.3)
    if "room_x" in scene.contents:
        low[0], high[0] = -0.45 * scene.contents["room_x"], 0.45 * scene.contents["room_x"]
        y_low, y_high = -0.42 * scene.contents["room_y"], 0.42 * scene.contents["room_y"]
    for x, y in product(np.linspace(low[0], high[0], 5), np.linspace(y_low, y_high, 3)):
        jitter = rng.normal(0, 0.03, 2)
        marks.append((round(float(x + jitter[0]), 2), round(float(y + jitter[1]), 2), 0.0))
        facing.append((0.0, 0.0, 1.0))
    if behind is not None:
        y = behind.pos[1] - behind.size[1] / 2
        for x, z in product(np.linspace(low[0], high[0], 4), np.linspace(0.1, max(high[2], 0.5), 3)):
            jitter = rng.normal(0, 0.03, 2)
            marks.append((round(float(x + jitter[0]), 2), y, max(0.05, round(float(z + jitter[1]), 2))))
            facing.append((0.0, -1.0, 0.0))
    radius = float(np.clip((1.5 if look.small else 2.4) * depth / camera.focal, 0.004, 0.03))
    contents = {**scene.contents, "mark_radius": round(radius, 4)}
    return replace(scene, marks=tuple(marks), mark_facing=tuple(facing), contents=contents)


class Sight:
    """Cast rays in a state of the scene to see what hides a point."""

    def __init__(self, scene: Scene, state: Array | None = None) -> None:
        self.model = build(scene)
        self.data = mujoco.MjData(self.model)
        self.place(self.data.qpos if state is None else state)

    def place(self, state: Array) -> None:
        """Set the joints."""
        self.data.qpos[:] = state
        mujoco.mj_kinematics(self.model, self.data)

    def clear(self, eye: Array, point: Array, tolerance: float = 0.004) -> bool:
        """Return whether nothing stands between the eye and the point."""
        way = point - eye
        geom = np.zeros(1, dtype=np.int32)
        arguments: list[Any] = [self.model, self.data, eye, way, None, 1, -1, geom]
        hit = mujoco.mj_ray(*arguments)
        return bool(hit < 0 or hit >= 1.0 - tolerance / float(np.linalg.norm(way)))


def occluder(rng: Generator, scene: Scene, look: Look, camera: Camera, run: Run) -> Scene:
    """Put a post between the camera and a place that a body passes."""
    eye = np.asarray(camera.pos)
    if not run.names:
        raise Rejected("nothing to hide")
    points = run.frame_poses[:, :, :3].reshape(-1, 3)
    sizes = [b.size[0] for b in scene.bodies] or [0.05]
    for _ in range(30):
        i, k = int(rng.integers(len(run.names))), int(rng.integers(len(run.frame_poses)))
        target = run.frame_poses[k, i, :3]
        if not camera.inside(target[None], 0.15 * min(look.size))[0]:
            continue
        foot, width = None, float(np.clip(rng.uniform(0.5, 1.2) * max(sizes), 0.03, 0.12))
        for share in np.linspace(0.1, 0.5, 12):
            p = target + share * (eye - target)
            apart = np.hypot(points[:, 0] - p[0], points[:, 1] - p[1]).min()
            inside_room = abs(p[0]) < scene.contents.get("room_x", 0) / 2 + 0.15 and abs(p[1]) < (
                scene.contents.get("room_y", 0) / 2 + 0.15
            )
            on_ramp = any(f.name in ("ramp", "track") and abs(p[1]) < f.size[1] / 2 + 0.08 for f in scene.fixtures)
            if apart > max(sizes) + width and not inside_room and not on_ramp:
                foot = p
                break
        if foot is None:
            continue
        height = float(np.clip(foot[2] + rng.uniform(0.0, 0.15), 0.1, 1.8))
        shade = float(rng.uniform(0.15, 0.75))
        rgb = (shade, shade, shade) if look.grey or rng.random() < 0.5 else (0.55, 0.4, 0.25)
        shape = str(rng.choice(["box", "cylinder"]))
        post = Fixture(
            "post",
            shape,
            (width, width, height),
            (round(float(foot[0]), 3), round(float(foot[1]), 3), height / 2),
            rgb=rgb,
            color="grey" if rgb[0] == rgb[1] else "brown",
        )
        if any(np.hypot(f.pos[0] - foot[0], f.pos[1] - foot[1]) < width for f in scene.fixtures if f.name != "board"):
            continue
        return replace(scene, fixtures=(*scene.fixtures, post))
    raise Rejected("no place for a post")


def seen_share(scene: Scene, look: Look, camera: Camera, run: Run) -> Array:
    """Return for each body the share of frames in which its centre is in the frame and nothing stands before it."""
    sight, eye, every = Sight(scene), np.asarray(camera.pos), round(1 / (look.fps * DT))
    seen = np.zeros(len(scene.bodies))
    for n in range(look.frames):
        sight.place(run.states[n * every])
        for i, b in enumerate(scene.bodies):
            centre = run.frame_poses[n, i, :3]
            seen[i] += camera.inside(centre[None])[0] and sight.clear(eye, centre, 1.01 * b.reach)
    return seen / look.frames


def measured_points(rng: Generator, scene: Scene, camera: Camera, run: Run) -> list[dict[str, Any]]:
    """Return the visible marks and corners with the pixels that a user would click in the first frame."""
    sight, eye = Sight(scene, run.states[0]), np.asarray(camera.pos)
    candidates = [(f"mark {i + 1}", np.array(p)) for i, p in enumerate(scene.marks)]
    for f in scene.fixtures:
        if f.name.startswith(("ramp", "track", "cushion")):
            top = corners(f)[[1, 3, 5, 7]]
            candidates.extend((f"{f.name} corner {k + 1}", p) for k, p in enumerate(top[:2]))
    out = []
    for name, p in candidates:
        if camera.inside(p[None], 3.0)[0] and sight.clear(eye, p):
            pixel = camera.project(p[None])[0, :2] + rng.normal(0, 0.35, 2)
            out.append(
                {
                    "name": name,
                    "position": [round(float(c), 4) for c in p],
                    "pixel": [round(float(c), 1) for c in pixel],
                }
            )
    if len(out) > 14:
        keep = sorted(rng.choice(len(out), 14, replace=False))
        out = [out[int(k)] for k in keep]
    if len(out) < 6:
        raise Rejected("too few camera points")
    return out
