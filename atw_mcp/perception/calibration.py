"""Cameras from what is known of a scene: points, a homography, a length, or the camera itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from polyworld.world.camera import Camera

Floats = NDArray[np.float64]

CONVERGED = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 400, 1e-14)


class CalibrationError(ValueError):
    """Input that does not determine a camera; the message says what is needed."""


@dataclass(frozen=True)
class Calibration:
    """A camera and how well it explains what it was made from.

    errors (k,): distance of each given pixel from its point's projection [px], empty where none were given;
    rms: their root mean square [px]; method: how it was found; warnings: what to be careful about.
    """

    camera: Camera
    errors: tuple[float, ...]
    rms: float | None
    method: str
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "camera": self.camera.model_dump(mode="json"),
            "errors": [round(e, 4) for e in self.errors],
            "rms": self.rms,
            "method": self.method,
            "warnings": list(self.warnings),
        }


def calibrate_from_points(
    world_points: Sequence[Sequence[float]] | Floats,
    pixels: Sequence[Sequence[float]] | Floats,
    image_size: tuple[int, int],
    intrinsics: Sequence[Sequence[float]] | Floats | None = None,
) -> Calibration:
    """Camera from world points (k, 3) [m] and their pixels (k, 2); image_size is (width, height).

    Points in one plane: at least 4, no three of them in a line. Points not in one plane: at least 6, or 4 when
    the intrinsics are given. Without intrinsics, pixels are taken as square and the principal point as the
    image centre: ((width - 1) / 2, (height - 1) / 2), since (0, 0) is the centre of the first pixel. Raises
    CalibrationError for input that does not determine the camera.
    """
    points, image = _correspondences(world_points, pixels)
    width, height = _size(image_size)
    known = None if intrinsics is None else _intrinsics(intrinsics)
    axes, spread = _principal_axes(points)
    if spread[1] < 1e-3 * spread[0]:
        raise CalibrationError("all world points lie on one line: give points that span a plane or a volume")
    planar = bool(spread[2] < 1e-3 * spread[0])
    need = 4 if planar or known is not None else 6
    if len(points) < need:
        kind = "in one plane" if planar else "not in one plane"
        raise CalibrationError(
            f"{len(points)} points {kind} do not determine a camera: give at least {need}"
            + ("" if planar or known is not None else ", or the intrinsics and at least 4")
        )
    if planar:
        plane = ((points - points.mean(axis=0)) @ axes.T)[:, :2]
        _require_general_position(plane, 1e-3)
        _require_general_position(image, 1e-6)
    if known is not None:
        camera, method = _posed(points, image, width, height, known), "pose from points (perspective-n-point)"
    elif planar:
        matrix, _ = cv2.findHomography(plane, image)
        focal = _focal_of_homography(np.asarray(matrix, dtype=float), width, height)
        camera = _calibrated(points, image, width, height, focal)
        method = "homography of coplanar points, refined by reprojection"
    else:
        camera = _calibrated(points, image, width, height, _focal_of_points(points, image, width, height))
        method = "pose at the best of a range of focal lengths, refined by reprojection"
    errors = _errors(camera, points, image)
    return Calibration(camera, tuple(errors), _rms(errors), method, _cautions(camera, errors, len(points), need, known))


def calibrate_from_homography(
    homography: Sequence[Sequence[float]] | Floats,
    image_size: tuple[int, int],
    *,
    plane_z: float = 0.0,
    intrinsics: Sequence[Sequence[float]] | Floats | None = None,
) -> Calibration:
    """Camera from the 3 x 3 map of (x, y, 1) in the plane z = plane_z [m] to pixels (up to scale).

    Square pixels and a central principal point are assumed unless intrinsics are given. The reprojection
    error is over a grid of the image's own pixels.
    """
    matrix = _array(homography, (3, 3), "homography")
    if abs(np.linalg.det(matrix)) < 1e-12 * np.linalg.norm(matrix) ** 3:
        raise CalibrationError("the homography is singular: it maps the plane to a line")
    width, height = _size(image_size)
    u, v = np.meshgrid(np.linspace(0.05, 0.95, 7) * width, np.linspace(0.05, 0.95, 7) * height)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    plane = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(matrix).T
    # Where the third coordinate changes sign lies the horizon; the image centre is taken to see the plane.
    reference = (np.linalg.inv(matrix) @ np.array([(width - 1) / 2, (height - 1) / 2, 1.0]))[2]
    seen = plane[:, 2] * np.sign(reference) > 1e-3 * np.abs(plane[:, 2]).max()
    points = plane[seen, :2] / plane[seen, 2:3]
    near = np.hypot(*(points - np.median(points, axis=0)).T)
    keep = near <= 4 * np.median(near)
    points, pixels = points[keep], pixels[seen][keep]
    if len(points) < 6:
        raise CalibrationError("the plane is hardly visible in this image: check the homography and the image size")
    world = np.column_stack([points, np.full(len(points), plane_z)])
    found = calibrate_from_points(world, pixels, image_size, intrinsics)
    return replace(found, method="homography of a plane, refined")


def calibrate_from_known_length(
    first_pixel: Sequence[float],
    second_pixel: Sequence[float],
    length: float,
    image_size: tuple[int, int],
    *,
    view: Literal["side", "top"] = "side",
) -> Calibration:
    """Return a camera for motion in one plane parallel to the image, from one known length [m] in that plane.

    view "side": the plane is x (right), z (up) at y = 0, seen along +y. view "top": the plane is x (right),
    y (up in the image) at z = 0, seen from above. The world's origin is at the image's lower left corner. The
    camera stands 40 image widths away, so that perspective within an object's depth is below 2%; distances
    out of the plane are not measured.
    """
    width, height = _size(image_size)
    ends = np.stack([_array(first_pixel, (2,), "first_pixel"), _array(second_pixel, (2,), "second_pixel")])
    if not np.isfinite(length) or length <= 0:
        raise CalibrationError(f"the known length must be a positive number of metres, got {length}")
    distance = float(np.hypot(*(ends[1] - ends[0])))
    if distance < 2.0:
        raise CalibrationError("the two pixels of the known length must be at least 2 px apart")
    if view not in ("side", "top"):
        raise CalibrationError(f'view must be "side" or "top", got {view!r}')
    pixels_per_metre = distance / length
    away = 40.0 * width / pixels_per_metre
    focal = pixels_per_metre * away
    middle = np.array([(width - 1) / 2, (height - 1) / 2]) / pixels_per_metre
    if view == "side":
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        centre = np.array([middle[0], -away, middle[1]])
    else:
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
        centre = np.array([middle[0], middle[1], away])
    camera = _camera_of(_square_pixels(focal, width, height), rotation, -rotation @ centre, width, height)
    relative = 0.5 * np.sqrt(2) / distance
    warnings = [
        f"the view is taken as exactly {'from the side' if view == 'side' else 'from above'}, without perspective",
        f"half a pixel at each end makes the scale uncertain by {100 * relative:.1f}%",
    ]
    return Calibration(camera, (0.0, 0.0), 0.0, f"known length of {length:g} m, {view} view", tuple(warnings))


def calibrate_given(
    intrinsics: Sequence[Sequence[float]] | Floats,
    rotation: Sequence[Sequence[float]] | Floats,
    translation: Sequence[float] | Floats,
    image_size: tuple[int, int],
) -> Calibration:
    """Return a camera given by K (3, 3) [px], R (3, 3) world to camera, and t (3,) [m]."""
    width, height = _size(image_size)
    matrix = _intrinsics(intrinsics)
    turn = _array(rotation, (3, 3), "rotation")
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise CalibrationError("rotation must be orthonormal with determinant +1 (rows: camera axes in the world)")
    left, _, right = np.linalg.svd(turn)
    shift = _array(translation, (3,), "translation")
    camera = Camera(
        width=width,
        height=height,
        intrinsics=_rows(matrix),
        rotation=_rows(left @ right),
        translation=(float(shift[0]), float(shift[1]), float(shift[2])),
    )
    return Calibration(camera, (), None, "given intrinsics and pose")


# --- parts -----------------------------------------------------------------------------------------


def _require_general_position(places: Floats, flat: float) -> None:
    """Refuse points (k, 2) that do not determine a homography: all on a line, or all but one, to a relative width."""
    for left_out in range(len(places)):
        others = np.delete(np.arange(len(places)), left_out)
        values = np.linalg.svd(places[others] - places[others].mean(axis=0), compute_uv=False)
        if values[1] < flat * values[0]:
            if len(places) > 4:
                raise CalibrationError("the points are degenerate: give 4 or more with no three in a line")
            i, j, k = others
            raise CalibrationError(f"points {i}, {j} and {k} lie in a line: of 4 points no three may")


def _focal_of_homography(matrix: Floats, width: int, height: int) -> float:
    """Focal length [px] of a homography K [r1 r2 t] of a plane, by the conditions on r1 and r2 (Zhang 2000).

    `cv2.initCameraMatrix2D` solves the same conditions, but does not say where they determine nothing.
    """
    cx, cy = (width - 1) / 2, (height - 1) / 2
    h = np.array([[1, 0, -cx], [0, 1, -cy], [0, 0, 1.0]]) @ matrix
    # w = 1/f^2 solves two linear conditions: r1 . r2 = 0 and |r1| = |r2|; weighted least squares.
    a = np.array([h[0, 0] * h[0, 1] + h[1, 0] * h[1, 1], (h[:2, 0] ** 2).sum() - (h[:2, 1] ** 2).sum()])
    b = -np.array([h[2, 0] * h[2, 1], h[2, 0] ** 2 - h[2, 1] ** 2])
    strength = float((a**2).sum())
    inverse_square = float(a @ b) / strength if strength > 0 else 0.0
    focal = float(1 / np.sqrt(inverse_square)) if inverse_square > 0 else np.inf
    if not 0.1 * width < focal < 100 * width:
        raise CalibrationError(
            "the plane is seen head-on, so its points do not determine the focal length: give intrinsics, points "
            "outside the plane, or use a known length"
        )
    return focal


def _focal_of_points(points: Floats, image: Floats, width: int, height: int) -> float:
    """Focal length [px], of a range, at which the pose of points in space leaves the least reprojection error."""
    focals = np.geomspace(0.4 * width, 12 * width, 24)
    costs = [_pose(points, image, _square_pixels(f, width, height))[0] for f in focals]
    if not np.isfinite(min(costs)):
        raise CalibrationError(
            "no camera sees these points in front of it at these pixels: check the pairs and that v grows downwards"
        )
    return float(focals[int(np.argmin(costs))])


def _calibrated(points: Floats, image: Floats, width: int, height: int, focal: float) -> Camera:
    """Return the camera with square pixels and central principal point of least reprojection error.

    focal: where the search begins. `cv2.calibrateCamera` takes single precision and begins at a pose of its own, which
    for few noisy points may be behind them; so the pose is OpenCV's at each focal length.
    """

    def cost(logarithm: float) -> float:
        return _pose(points, image, _square_pixels(float(np.exp(logarithm)), width, height))[0]

    begin = float(np.log(focal))
    found = minimize_scalar(cost, bracket=(begin, begin + 0.1))
    return _posed(points, image, width, height, _square_pixels(float(np.exp(found.x)), width, height))


def _posed(points: Floats, image: Floats, width: int, height: int, matrix: Floats) -> Camera:
    """Return the camera with given intrinsics of least reprojection error."""
    straight = image.copy()  # as seen without skew, which OpenCV's cameras do not have
    straight[:, 0] -= matrix[0, 1] / matrix[1, 1] * (image[:, 1] - matrix[1, 2])
    cost, rotation, translation = _pose(points, straight, matrix * np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1.0]]))
    if not np.isfinite(cost):
        raise CalibrationError("the points come out behind the camera: check the pairs and that v grows downwards")
    return _camera_of(matrix, rotation, translation, width, height)


def _pose(points: Floats, image: Floats, matrix: Floats) -> tuple[float, Floats, Floats]:
    """Least sum of squared reprojection errors [px^2], with the rotation (3, 3) and translation (3,) that give it;
    infinite where no pose is found, or points are behind the camera."""
    try:
        _, turn, shift = cv2.solvePnP(points, image, matrix, None, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:
        return np.inf, np.eye(3), np.zeros(3)
    turn, shift = cv2.solvePnPRefineLM(points, image, matrix, None, turn, shift, criteria=CONVERGED)
    rotation, translation = np.asarray(cv2.Rodrigues(turn)[0], dtype=float), np.ravel(shift).astype(float)
    projected = np.asarray(cv2.projectPoints(points, turn, shift, matrix, None)[0])[:, 0]
    seen = bool(((points @ rotation.T + translation)[:, 2] > 0).all())
    return (float(((projected - image) ** 2).sum()) if seen else np.inf), rotation, translation


def _errors(camera: Camera, points: Floats, image: Floats) -> list[float]:
    return [float(e) for e in np.hypot(*(camera.project(points) - image).T)]


def _square_pixels(focal: float, width: int, height: int) -> Floats:
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


def _camera_of(k: Floats, rotation: Floats, translation: Floats, width: int, height: int) -> Camera:
    t = [float(v) for v in translation]
    return Camera(
        width=width, height=height, intrinsics=_rows(k), rotation=_rows(rotation), translation=(t[0], t[1], t[2])
    )


def _rows(m: Floats) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    a, b, c = ((float(r[0]), float(r[1]), float(r[2])) for r in m)
    return a, b, c


def _correspondences(world_points: object, pixels: object) -> tuple[Floats, Floats]:
    points, image = np.asarray(world_points, dtype=float), np.asarray(pixels, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise CalibrationError(f"world_points must have shape (k, 3), got {points.shape}")
    if image.shape != (len(points), 2):
        raise CalibrationError(f"pixels must have shape ({len(points)}, 2), one for each point, got {image.shape}")
    if not np.all(np.isfinite(points)) or not np.all(np.isfinite(image)):
        raise CalibrationError("points and pixels must be finite numbers")
    if len(points) < 4:
        raise CalibrationError(f"{len(points)} points do not determine a camera: give at least 4")
    for name, values in (("world point", points), ("pixel", image)):
        _, index, counts = np.unique(values.round(9), axis=0, return_inverse=True, return_counts=True)
        if counts.max() > 1:
            rows = np.flatnonzero(index.ravel() == int(np.argmax(counts)))
            raise CalibrationError(f"the same {name} is given more than once, in rows {rows.tolist()}")
    return points, image


def _principal_axes(points: Floats) -> tuple[Floats, Floats]:
    """Right-handed axes (3, 3) of a point cloud, longest first, and its extent along each."""
    _, values, vectors = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)
    spread = np.zeros(3)
    spread[: len(values)] = values
    if np.linalg.det(vectors) < 0:
        vectors = vectors * np.array([[1.0], [1.0], [-1.0]])
    return vectors, spread


def _array(values: object, shape: tuple[int, ...], name: str) -> Floats:
    array = np.asarray(values, dtype=float)
    if array.shape != shape:
        raise CalibrationError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise CalibrationError(f"{name} must hold finite numbers")
    return array


def _intrinsics(values: object) -> Floats:
    k = _array(values, (3, 3), "intrinsics")
    if k[0, 0] <= 0 or k[1, 1] <= 0 or not np.allclose(k[2], [0, 0, 1]) or abs(k[1, 0]) > 1e-9:
        raise CalibrationError("intrinsics must be [[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0 in pixels")
    return k


def _size(image_size: tuple[int, int]) -> tuple[int, int]:
    if len(image_size) != 2 or not all(0 < int(s) <= 16384 for s in image_size):
        raise CalibrationError(f"image_size must be (width, height) in pixels, got {image_size}")
    return int(image_size[0]), int(image_size[1])


def _rms(errors: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _cautions(camera: Camera, errors: list[float], count: int, need: int, known: Floats | None) -> tuple[str, ...]:
    warnings = []
    if count == need:
        warnings.append(f"with {count} points there is nothing left over to check the camera against: give more")
    if _rms(errors) > 3.0:
        worst = int(np.argmax(errors))
        warnings.append(
            f"large reprojection error ({_rms(errors):.1f} px rms; worst: row {worst}, {errors[worst]:.1f} px)"
        )
    if camera.centre[2] <= 0:
        warnings.append("the camera comes out below z = 0: check that world z is up")
    if known is None:
        warnings.append("square pixels and a principal point at the image centre were assumed")
    return tuple(warnings)
