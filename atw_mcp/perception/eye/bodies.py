"""Bodies with a silhouette: solids on a plane of motion seen by a camera, and outlines that move in the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.surfaces import Surface, within
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.geometry import plane_axes

Floats = NDArray[np.float64]
FLOOR = MotionPlane()
FAR = 1e6  # [m] depth of nothing that hides
CIRCLE = np.stack([np.cos(np.arange(64) * np.pi / 32), np.sin(np.arange(64) * np.pi / 32)], axis=1)


@dataclass(frozen=True)
class Contour:
    """Points of a silhouette at equal distances: places (N, 2) [px], outward unit normals (N, 2), and the rate at which
    each moves along its normal with each free component of the pose (N, 4) and with two nuisances (N, 2): all edges
    farther out [px], and upper rims rounded [by their radius over the body's]; spacing [px]."""

    points: Floats
    normals: Floats
    rates: Floats
    nuisances: Floats
    spacing: float


class Body(Protocol):
    """A body whose silhouette follows from a pose of four numbers.

    free (4,): which components are unknown; unit (4,): size of each component that moves the silhouette by about a
    radius. A higher depth lies behind. nuisance(border, rims): standard deviations of what all edges may
    lie farther out than the silhouette says [px], and of the radius of rounded rims [radii], of solids as they are
    given.
    """

    @property
    def name(self) -> str: ...
    @property
    def free(self) -> NDArray[np.bool_]: ...
    @property
    def unit(self) -> Floats: ...
    def polygon(self, pose: Floats) -> Floats: ...
    def contour(self, pose: Floats, most: int) -> Contour: ...
    def centre(self, pose: Floats) -> Floats: ...
    def radius(self, pose: Floats) -> float: ...
    def depth(self, pose: Floats) -> float: ...
    def placed(self, pixel: Floats, like: Floats) -> Floats: ...
    def local(self, pose: Floats, points: Floats) -> Floats: ...
    def angles(self) -> list[float]: ...
    def nuisance(self, border: float, rims: float) -> tuple[float, float]: ...


@dataclass(frozen=True)
class Solid:
    """A sphere, box or cylinder on a plane of motion: pose (x, y, angle, height) in the plane's axes [m, rad].

    half (3,): half extents along its own axes [m]. On a plane that supports it, as a floor, it stands with its own z
    along the normal, or lies with it along the plane's x at angle 0; height is the rise of its lowest point, unknown
    only with `rises`. In an upright plane that does not, as of a side view, its centre is in the plane and its own z
    along the plane's y, or along the normal where it lies. faces: of fixed solids, on which a sphere over them rolls in
    place of a level plane. floor: z [m] below which no centre in an upright plane is.
    """

    name: str
    kind: Literal["sphere", "box", "cylinder"]
    half: tuple[float, float, float]
    camera: Camera
    plane: MotionPlane = FLOOR
    rises: bool = False
    lies: bool = False
    faces: tuple[Surface, ...] = ()
    floor: float | None = None

    @cached_property
    def _axes(self) -> Floats:
        """Axes (3, 3) of the plane: two along it and its normal."""
        return plane_axes(self.plane)

    @property
    def upright(self) -> bool:
        """Whether the plane is an upright one in which bodies rotate as a side view shows."""
        return not (self.plane.supports or abs(self._axes[2, 2]) > 0.7)

    @property
    def free(self) -> NDArray[np.bool_]:
        return np.array([True, True, len(self.angles()) > 1, self.rises])

    def nuisance(self, border: float, rims: float) -> tuple[float, float]:
        """Boxes are sharper than turned cylinders."""
        return (border, rims if self.kind == "cylinder" else 0.2 * rims)

    @property
    def unit(self) -> Floats:
        size = float(np.mean(self.half))
        return np.array([size, size, 1.0, size])

    def _above(self, pose: Floats) -> float:
        """Height [m] of the centre above the plane."""
        return float((self.half[0 if self.lies else 2] if self.plane.supports else 0.0) + pose[3])

    def middle(self, pose: Floats) -> Floats:
        """Centre (3,) in the world [m]."""
        found = np.asarray(self.plane.point) + np.array([*pose[:2], self._above(pose)]) @ self._axes
        level = found[2]
        for face in self.faces:  # the highest that is below it bears it
            lift = self.half[0] + pose[3]
            there = np.array([found[0], found[1], 0.0])
            there[2] = face.point[2] + (lift - (there - face.point)[:2] @ face.normal[:2]) / face.normal[2]
            if there[2] > level and within(there - lift * face.normal, face, 0.0):
                found, level = there, there[2]
        return np.asarray(found)

    def _surface(self, pose: Floats) -> Floats:
        """Points (V, 3) in the world whose projection's hull is the silhouette."""
        middle = self.middle(pose)
        if self.kind == "sphere":
            away = self.camera.centre - middle
            distance, radius = float(np.linalg.norm(away)), self.half[0]
            axis = away / distance
            across = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
            across /= np.linalg.norm(across)
            ring = CIRCLE @ np.stack([across, np.cross(axis, across)])
            return np.asarray(
                middle + axis * radius**2 / distance + radius * np.sqrt(1 - (radius / distance) ** 2) * ring
            )
        flat = CIRCLE if self.kind == "cylinder" else np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        own = np.concatenate([np.c_[flat, np.full(len(flat), z)] for z in (-1.0, 1.0)]) * self.half
        if self.upright and not self.lies:  # own y points away along the normal
            own = own[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
        elif self.lies and not self.upright:
            own = own[:, [2, 1, 0]] * [1.0, 1.0, -1.0]
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        turned = own @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(middle + turned @ self._axes)

    def polygon(self, pose: Floats) -> Floats:
        """Silhouette (V, 2) [px]."""
        points = self.camera.project(self._surface(pose))
        return points if self.kind == "sphere" else points[_hull(points)]

    def contour(self, pose: Floats, most: int) -> Contour:
        """Points of the silhouette with their rates by finite differences."""
        points = self.camera.project(self._surface(pose))
        used = np.arange(len(points)) if self.kind == "sphere" else _hull(points)
        small = 1e-4
        moved = np.zeros((4, len(used), 2))
        for k in np.flatnonzero(self.free):
            moved[k] = (self.camera.project(self._surface(pose + small * np.eye(4)[k])) - points)[used] / small
        found = sampled_contour(points[used], moved, most)
        if self.kind == "sphere" or self.upright or self.lies:
            return found
        # A rim rounded by r lies r (|w_xy| + w_z - 1) farther in than a sharp one, w the normal of the tangent plane
        # through the camera. Of lower rims a dark gap is left, which is seen as the body's.
        lines = np.c_[found.normals, -(found.normals * found.points).sum(axis=1)]
        across = lines @ np.asarray(self.camera.intrinsics) @ np.asarray(self.camera.rotation)
        across = across @ self._axes.T
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        inset = np.where(across[:, 2] > 0, np.hypot(across[:, 0], across[:, 1]) + across[:, 2] - 1, 0.0)
        return replace(found, nuisances=np.c_[np.ones(len(inset)), -inset * self.radius(pose)])

    def centre(self, pose: Floats) -> Floats:
        """Projection (2,) of the centre [px]."""
        return self.camera.project(self.middle(pose))

    def radius(self, pose: Floats) -> float:
        """Radius [px] of a ball of the body's mean half extent."""
        return float(self.camera.intrinsics[0][0] * np.mean(self.half) / max(self.depth(pose), 1e-6))

    def depth(self, pose: Floats) -> float:
        """Distance along the viewing direction [m]."""
        return float(self.camera.to_camera(self.middle(pose))[2])

    def placed(self, pixel: Floats, like: Floats) -> Floats:
        """Pose whose centre is seen at a pixel (2,), angle and height those of `like`: on the surface met first."""
        axes, lift = self._axes, self.half[0] + like[3]
        places = [self.camera.onto_plane(pixel, np.asarray(self.plane.point) + self._above(like) * axes[2], axes[2])]
        for face in self.faces:
            there = self.camera.onto_plane(pixel, face.point + lift * face.normal, face.normal)
            if within(there - lift * face.normal, face, 0.0):
                places.append(there)
        nearest = min(places, key=lambda p: float(np.nan_to_num(self.camera.to_camera(p)[2], nan=np.inf)))
        place = nearest - np.asarray(self.plane.point)
        return np.array([place @ axes[0], place @ axes[1], like[2], like[3]])

    def about(self, middle: Floats, angle: float = 0.0) -> Floats | None:
        """Pose whose silhouette's box has its middle at a pixel (2,); None where there is no such place."""
        aim, pose = middle.copy(), np.zeros(4)
        for _ in range(3):
            pose = self.placed(aim, np.array([0.0, 0.0, angle, 0.0]))
            if not np.isfinite(pose).all() or self.depth(pose) <= 0 or self.under_floor(pose):
                return None
            polygon = self.polygon(pose)
            if not np.isfinite(polygon).all():
                return None
            aim = aim + middle - 0.5 * (polygon.min(axis=0) + polygon.max(axis=0))
        return pose

    def under_floor(self, pose: Floats) -> bool:
        """Whether the centre is below the floor, as of a shadow that is taken for the body."""
        return self.upright and self.floor is not None and bool(self.middle(pose)[2] < self.floor)

    def local(self, pose: Floats, points: Floats) -> Floats:
        """Places (..., 2) on the body, its silhouette about within -1..1: light and view do not rotate with it."""
        return np.asarray((points - self.centre(pose)) / (1.5 * self.radius(pose)))

    def angles(self) -> list[float]:
        """Angles from which a search begins; one where the silhouette does not show it."""
        if self.kind == "box":
            return [0.0, np.pi / 8, np.pi / 4, 3 * np.pi / 8]
        turns = self.kind == "cylinder" and self.upright != self.lies
        return [0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4] if turns else [0.0]


@dataclass(frozen=True)
class Outline:
    """A flat shape that moves, rotates and changes in size in the image: pose (u, v, angle, log scale) [px, rad].

    shape (V, 2): its polygon about its centroid [px]. layer: depth; round: whether rotation is not to be seen.
    """

    name: str
    shape: Floats
    layer: float = 0.0
    round: bool = False
    scales: bool = False

    @property
    def free(self) -> NDArray[np.bool_]:
        return np.array([True, True, not self.round, self.scales])

    def nuisance(self, border: float, rims: float) -> tuple[float, float]:
        """Allow for a pixel by which a drawn outline is off; a free scale does that itself."""
        del border, rims
        return (1e-3 if self.scales else 1.0, 1e-3)

    @property
    def unit(self) -> Floats:
        size = self._size
        return np.array([size, size, 1.0, 1.0])

    @cached_property
    def _size(self) -> float:
        return float(np.sqrt(abs(_area(self.shape)) / np.pi))

    def rotation(self, pose: Floats) -> Floats:
        """Matrix (2, 2) from the shape to the image."""
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[cosine, -sine], [sine, cosine]])

    def polygon(self, pose: Floats) -> Floats:
        """Silhouette (V, 2) [px]."""
        return np.asarray(np.exp(pose[3]) * self.shape @ self.rotation(pose).T + pose[:2])

    def contour(self, pose: Floats, most: int) -> Contour:
        """Points of the silhouette with their rates."""
        points = self.polygon(pose)
        arm = points - pose[:2]
        one = np.ones(len(points))
        moved = [np.c_[one, 0 * one], np.c_[0 * one, one], np.c_[-arm[:, 1], arm[:, 0]], arm]
        return sampled_contour(points, np.stack(moved), most)

    def centre(self, pose: Floats) -> Floats:
        """Centroid (2,) [px]."""
        return np.asarray(pose[:2])

    def radius(self, pose: Floats) -> float:
        """Radius [px] of the circle of the same area."""
        return float(self._size * np.exp(pose[3]))

    def depth(self, pose: Floats) -> float:
        """The layer."""
        del pose
        return self.layer

    def placed(self, pixel: Floats, like: Floats) -> Floats:
        """Pose with its centroid at a pixel (2,), angle and scale those of `like`."""
        return np.array([pixel[0], pixel[1], like[2], like[3]])

    def local(self, pose: Floats, points: Floats) -> Floats:
        """Places (..., 2) on the body, its silhouette within -1..1."""
        reach = float(np.abs(self.shape).max()) * np.exp(pose[3])
        return np.asarray((points - pose[:2]) @ self.rotation(pose) / reach)

    def angles(self) -> list[float]:
        """Angles from which a search begins."""
        return [0.0]


def outline_of(name: str, polygon: Floats, *, round: bool = False) -> tuple[Outline, Floats]:
    """Outline body of a polygon (V, 2) [px] in the image, and its pose there."""
    middle = _centroid(polygon)
    return Outline(name, polygon - middle, round=round), np.array([middle[0], middle[1], 0.0, 0.0])


def _hull(points: Floats) -> NDArray[np.intp]:
    return np.asarray(cv2.convexHull(points.astype(np.float32), returnPoints=False)).ravel().astype(np.intp)


def _area(polygon: Floats) -> float:
    x, y = polygon.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _centroid(polygon: Floats) -> Floats:
    x, y = polygon.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    total = cross.sum()
    if abs(total) < 1e-9:
        return np.asarray(polygon.mean(axis=0))
    moments = np.array([((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()])
    return np.asarray(moments / (3 * total))


def sampled_contour(polygon: Floats, moved: Floats, most: int) -> Contour:
    """Points at equal distances along a polygon (V, 2) whose vertices move at rates (P, V, 2)."""
    after = np.append(np.arange(1, len(polygon)), 0)
    edge = polygon[after] - polygon
    length = np.maximum(np.linalg.norm(edge, axis=1), 1e-12)
    total = np.concatenate([[0.0], np.cumsum(length)])
    count = int(np.clip(total[-1], 24, most))
    along = (np.arange(count) + 0.5) / count * total[-1]
    index = np.clip(np.searchsorted(total, along) - 1, 0, len(polygon) - 1)
    share = ((along - total[index]) / length[index])[:, None]
    points = polygon[index] * (1 - share) + polygon[after[index]] * share
    outward = edge[index][:, ::-1] * [1.0, -1.0] / length[index][:, None] * np.sign(_area(polygon))
    rates = ((moved[:, index] * (1 - share) + moved[:, after[index]] * share) * outward).sum(axis=2).T
    none = np.stack([np.ones(count), np.zeros(count)], axis=1)
    return Contour(points, outward, rates, none, float(total[-1] / count))
