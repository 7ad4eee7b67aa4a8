"""Find the axes and the free space of the room around a clip's motion."""

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.video_clips.bodies import Array, vec
from tests.benchmarks.video_clips.clip import Clip

from .setting import Setting


@dataclass(frozen=True)
class Room:
    """Axes and extents of the room. centre: middle of the motion on the floor; ahead: horizontal unit vector towards
    the back wall; across: unit vector to the right; back: distance from the centre to the back wall in m, measured
    along ahead; half: half width seen at the back wall in m; yaw: of across from x in rad.
    """

    centre: Array
    ahead: Array
    across: Array
    back: float
    half: float

    @property
    def yaw(self) -> float:
        """Return the angle of the wall from the x axis in rad."""
        return float(np.arctan2(self.across[1], self.across[0]))

    def at(self, x: float, y: float, z: float) -> Array:
        """Return the world point at x to the right of the centre, y towards the wall and height z."""
        return np.asarray(self.centre + x * self.across + y * self.ahead + np.array([0.0, 0.0, z]))


def path_points(clip: Clip) -> Array:
    """Return the places that things pass during the clip and the corners of what stands (n, 3)."""
    rows = [clip.run.frame_poses[:, i, :3] for i in range(len(clip.run.names))]
    if clip.run.frame_points is not None:
        rows.append(clip.run.frame_points.reshape(-1, 3))
    for f in clip.scene.fixtures:
        if f.name != "board":
            half = np.asarray(f.size) / 2
            rows.append(np.array([f.pos]) + np.array([[s * half[0], t * half[1], 0] for s in (-1, 1) for t in (-1, 1)]))
    return np.vstack(rows)


def find_room(clip: Clip, setting: Setting) -> Room:
    """Put the back wall behind the motion, as the camera sees it, or at the board if there is one."""
    camera, points = clip.cameras[0], path_points(clip)
    board = next((f for f in clip.scene.fixtures if f.name == "board"), None)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    centre[2] = 0.0
    ahead = -camera.axes()[:, 2]
    ahead[2] = 0.0
    ahead /= np.linalg.norm(ahead)
    if board is not None:
        ahead = np.array([0.0, 1.0, 0.0])
    else:
        a = np.radians(setting.wall_turn)
        ahead = np.array([np.cos(a) * ahead[0] - np.sin(a) * ahead[1], np.sin(a) * ahead[0] + np.cos(a) * ahead[1], 0])
    across = np.array([ahead[1], -ahead[0], 0.0])
    reach = max((b.reach for b in clip.scene.bodies), default=0.1)
    back = float(((points - centre) @ ahead).max()) + reach + setting.wall_gap
    if board is not None:
        back = board.pos[1] - board.size[1] / 2 - float(centre[1])
    else:
        marks = [p["position"] for p in clip.points]
        back = max(back, float(((np.array(marks) - centre) @ ahead).max()) + 0.1)
    eye = np.asarray(camera.pos)
    depth = float((centre - eye) @ ahead) + back
    half = depth * camera.width / (2 * camera.focal)
    return Room(centre, ahead, across, back, half)


def far_from_path(clip: Clip, point: Array, radius: float) -> bool:
    """Return whether a place keeps a distance from all paths, seen from above."""
    reach = max((b.reach for b in clip.scene.bodies), default=0.1)
    apart = np.linalg.norm((path_points(clip) - point)[:, :2], axis=1)
    return bool(apart.min() > radius + reach + 0.02)


def covers_point(clip: Clip, points: Array) -> bool:
    """Return whether a thing within the hull of points (n, 3) may hide a measured point of the clip."""
    camera = clip.cameras[0]
    seen = camera.project(points)
    if np.isnan(seen).any() or seen[:, 2].min() < 0.3:
        return True
    low, high = seen[:, :2].min(axis=0) - 4, seen[:, :2].max(axis=0) + 4
    for p in clip.points:
        pixel = camera.project(np.array([vec(p["position"])]))[0]
        inside = np.all(pixel[:2] > low) and np.all(pixel[:2] < high)
        if inside and pixel[2] > seen[:, 2].min():
            return True
    return False


def covers_path(clip: Clip, points: Array) -> bool:
    """Return whether a thing may stand between the camera and a path."""
    camera = clip.cameras[0]
    seen, path = camera.project(points), camera.project(path_points(clip))
    low, high = seen[:, :2].min(axis=0) - 15, seen[:, :2].max(axis=0) + 15
    inside = np.all((path[:, :2] > low) & (path[:, :2] < high), axis=1)
    return bool(np.any(inside & (path[:, 2] > seen[:, 2].min() - 0.1)))
