"""Draw one clip: scene, look, camera and run that show something."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import Rejected, Scene
from .camera import Camera
from .frame import draw_marks, focus_points, measured_points, occluder, place_camera, seen_share
from .kinds import KINDS
from .looks import Look, draw_look, paint
from .physics import Run, simulate
from .render import camera_path

ATTEMPTS = 80


@dataclass
class Clip:
    """A clip ready to render. cameras: one per frame."""

    scene: Scene
    look: Look
    cameras: list[Camera]
    run: Run
    points: list[dict[str, Any]]
    extent: float


def mutual_touches(scene: Scene, run: Run) -> list[float]:
    """Return the times at which two moving bodies begin to touch."""
    names = {b.name for b in scene.bodies}
    return [start for a, b, start, _ in run.touches if a in names and b in names]


def check(rng: Generator, clip: Clip) -> None:
    """Reject a clip in which a body is never seen, nothing moves enough, or nothing meets."""
    scene, look, run, camera = clip.scene, clip.look, clip.run, clip.cameras[0]
    tracks = [run.frame_poses[:, i, :3] for i in range(len(run.names))]
    if run.frame_points is not None:
        tracks.append(run.frame_points[:, -1])
    moved = 0.0
    for name, track in zip([*run.names, "end"], tracks, strict=False):
        inside = camera.inside(track, 2.0)
        if inside.sum() < max(4, 0.15 * len(inside)):
            raise Rejected("a body is hardly seen")
        uvz = camera.project(track)[inside]
        moved = max(moved, float(np.ptp(uvz[:, :2], axis=0).max()))
        body = next((b for b in scene.bodies if b.name == name), None)
        if body and camera.focal * min(body.size[:2]) / float(uvz[:, 2].mean()) < 5.5:
            raise Rejected("a body is too small")
    if moved < 0.14 * min(look.size):
        raise Rejected("too little motion")
    if look.occlude and np.any(seen_share(scene, look, camera, run) < 0.25):
        raise Rejected("the post hides a body")
    if scene.kind in ("floor", "billiard"):
        touches = mutual_touches(scene, run)
        if not touches or min(touches) > look.seconds + 0.5:
            raise Rejected("nothing meets")
        if rng.random() < 0.6 and max(touches) < look.seconds:
            raise Rejected("nothing meets after the clip")
    if scene.kind == "entering":
        first = camera.inside(run.frame_poses[0, :, :3])
        if first.all():
            raise Rejected("nothing enters")


def draw_once(rng: Generator, kind: str, style: str) -> Clip:
    """Draw one clip or reject the draw."""
    return draw_with_look(rng, kind, draw_look(rng, style))


def draw_with_look(rng: Generator, kind: str, look: Look) -> Clip:
    """Draw one clip of a given look or reject the draw."""
    scene = paint(rng, KINDS[kind](rng, look), look)
    if kind == "billiard" and not look.grey and rng.random() < 0.5:
        felt = [(0.12, 0.42, 0.24), (0.15, 0.3, 0.5)][int(rng.integers(2))]
        look = replace(look, floor_rgb=felt, floor="plain" if look.floor == "wood" else look.floor)
    if any(f.name == "board" for f in scene.fixtures):  # the sun shines on the board's face
        look = replace(look, sun=(float(rng.uniform(-150, -30)), look.sun[1]))
    run = simulate(scene, look.seconds, look.fps, keep_states=True)
    points = focus_points(scene, run)
    camera = place_camera(rng, scene, look, points)
    if look.occlude:
        scene = occluder(rng, scene, look, camera, run)
    scene = draw_marks(rng, scene, look, camera, points)
    if look.occlude:
        run = simulate(scene, look.seconds, look.fps, keep_states=True)
    extent = float(np.linalg.norm(np.ptp(points, axis=0))) / 2 + 0.3
    distance = float(camera.project(points.mean(axis=0))[0, 2])
    clip = Clip(scene, look, camera_path(rng, camera, look, distance), run, [], extent)
    check(rng, clip)
    clip.points = measured_points(rng, scene, clip.cameras[0], run)
    return clip


def draw_clip(seed: list[int], kind: str, style: str) -> Clip:
    """Draw until a clip passes."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([*seed, attempt])
        try:
            return draw_once(rng, kind, style)
        except (Rejected, FloatingPointError):
            continue
    raise Rejected(f"no usable draw of {kind} with {style}")


def generator_for(seed: list[int], purpose: int) -> Generator:
    """Return a generator for one purpose of one clip."""
    return np.random.default_rng([*seed, 1_000_000 + purpose])
