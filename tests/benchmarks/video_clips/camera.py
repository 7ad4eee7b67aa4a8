"""Place a pinhole camera and project world points to pixels (centre of the top-left pixel at 0, 0)."""

from dataclasses import dataclass, replace

import numpy as np

from .bodies import Array, vec


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion. right, up: unit vectors of the image axes; fovy in degrees."""

    pos: tuple[float, float, float]
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    fovy: float
    width: int
    height: int

    @property
    def focal(self) -> float:
        """Return the focal length in pixels."""
        return 0.5 * self.height / float(np.tan(np.radians(self.fovy) / 2))

    def project(self, points: Array) -> Array:
        """Project world points (n, 3) to pixels u, v and depth in m (n, 3)."""
        right, up = np.asarray(self.right), np.asarray(self.up)
        rel = np.atleast_2d(points) - np.asarray(self.pos)
        depth = rel @ -np.cross(right, up)
        safe = np.where(depth > 1e-6, depth, np.nan)
        u = self.width / 2 - 0.5 + self.focal * (rel @ right) / safe
        v = self.height / 2 - 0.5 - self.focal * (rel @ up) / safe
        return np.stack([u, v, depth], axis=1)

    def inside(self, points: Array, margin: float = 0.0) -> np.ndarray:
        """Return which points lie in the frame, margin pixels from its edges."""
        uvz = self.project(points)
        with np.errstate(invalid="ignore"):
            return (
                (uvz[:, 2] > 0)
                & (uvz[:, 0] >= margin)
                & (uvz[:, 0] <= self.width - 1 - margin)
                & (uvz[:, 1] >= margin)
                & (uvz[:, 1] <= self.height - 1 - margin)
            )

    def axes(self) -> Array:
        """Return the matrix whose columns are right, up and backward."""
        right, up = np.asarray(self.right), np.asarray(self.up)
        return np.stack([right, up, np.cross(right, up)], axis=1)


def look_at(
    target: Array, azimuth: float, elevation: float, distance: float, fovy: float, size: tuple[int, int]
) -> Camera:
    """Place a camera around a target. azimuth: of the camera from the target, degrees from x; size: width, height."""
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.cross(back, right)
    return Camera(vec(target + distance * back), vec(right), vec(up), fovy, *size)


def move_back(camera: Camera, by: float) -> Camera:
    """Move the camera back along its axis by a length in m."""
    pos = np.asarray(camera.pos) + by * camera.axes()[:, 2]
    return replace(camera, pos=vec(pos))


def fit(points: Array, azimuth: float, elevation: float, fovy: float, size: tuple[int, int], fill: float) -> Camera:
    """Place the camera so that the points fill the given share of the frame in its tighter direction."""
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    for _ in range(3):
        low, high = 0.05, 60.0
        for _ in range(40):
            mid = (low + high) / 2
            camera = look_at(target, azimuth, elevation, mid, fovy, size)
            uvz = camera.project(points)
            half = fill * np.array(size) / 2
            off = np.abs(uvz[:, :2] - (np.array(size) - 1) / 2)
            good = bool(np.all(uvz[:, 2] > 0.02) and np.all(off <= half))
            low, high = (low, mid) if good else (mid, high)
        camera = look_at(target, azimuth, elevation, high, fovy, size)
        uvz = camera.project(points)
        shift = (uvz[:, :2].min(axis=0) + uvz[:, :2].max(axis=0)) / 2 - (np.array(size) - 1) / 2
        metres = shift * high / camera.focal
        target = target + metres[0] * np.asarray(camera.right) - metres[1] * np.asarray(camera.up)
    return camera


def turned(camera: Camera, pan: float, tilt: float, roll: float, shift: Array) -> Camera:
    """Turn the camera by small angles (rad) about its own axes and move it by a world vector (m)."""
    axes = camera.axes()
    cp, sp, ct, st, cr, sr = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    about_up = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_right = np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    about_back = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    axes = axes @ about_up @ about_right @ about_back
    pos = np.asarray(camera.pos) + shift
    return replace(
        camera,
        pos=vec(pos),
        right=vec(axes[:, 0]),
        up=vec(axes[:, 1]),
    )
