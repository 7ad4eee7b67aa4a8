"""Axes of a plan: the plane that it shows, true to scale, with ticks in metres and a scale bar."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.looking.overlay import DARK, FONT, OBSERVED, Canvas, Color, fine
from polyworld.trajectory import Trajectory
from polyworld.world import World, geometry
from polyworld.world.camera import Camera

Array = NDArray[np.float64]

GROUND: Color = (64, 58, 54)  # blue, green, red
AROUND: Color = (44, 40, 38)
GRID: Color = (84, 78, 74)
TICKS: Color = (200, 200, 200)
LEFT, TOP, RIGHT, FOOT = 48, 24, 10, 38  # [px] about the axes, for ticks and titles
MARGIN = 30  # [px] free inside the axes, for names
NARROWEST, WIDEST = 0.6, 1.0  # width of the axes per height
TICKS_ALONG = 4  # at least, along the shorter side
FLAT = 0.1  # of the largest extent; what rises less moves on a plane
ALIGNED = 0.999  # cosine of an angle between axes that are the same


class PlanFrame:
    """Where places of the world are in a plan.

    Planar worlds are shown in their plane of motion, others from above, or from the side where they rise and fall more
    than they move away from the camera. Axes are those of the world: the one nearest to the camera's right points
    right.
    """

    def __init__(self, axes: Array, origin: Array, places: Array, height: int) -> None:
        """axes (3, 3): right, up, towards the viewer; origin (3,) [m]; places (k, 2) [m] on the first two, all of which
        are seen; height [px]."""
        self.axes, self.origin = axes, origin
        finite = places[np.all(np.isfinite(places), axis=1)]
        finite = finite if len(finite) else np.array([[-0.5, -0.5], [0.5, 0.5]])
        lower, upper = finite.min(axis=0), finite.max(axis=0)
        extent = np.maximum(upper - lower, 1e-3)
        inside = height - TOP - FOOT
        across = round(float(np.clip(extent[0] / extent[1], NARROWEST, WIDEST)) * inside)
        self.height, self.width = height, LEFT + across + RIGHT
        self.box = (LEFT, TOP, LEFT + across, TOP + inside)
        self.pixels_per_metre = float(((np.array([across, inside]) - 2 * MARGIN) / extent).min())
        self.centre = (lower + upper) / 2

    @property
    def shows(self) -> str:
        """The plane in words."""
        normal = abs(float(self.axes[2, 2]))
        if normal > ALIGNED:
            return "plan, seen from above" if self.axes[2, 2] > 0 else "plan, seen from below"
        return "elevation, seen from the side" if normal < 1.0 - ALIGNED else "plane of motion"

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Pixels (h, w) within the axes."""
        left, top, right, bottom = self.box
        found = np.zeros((self.height, self.width), bool)
        found[top:bottom, left:right] = True
        return found

    @property
    def axis_names(self) -> tuple[str, str]:
        """Names of the axes to the right and up: x, y, z, or u, v in a plane that is inclined."""
        found = []
        for axis, other in zip(self.axes[:2], "uv", strict=True):
            k = int(np.argmax(np.abs(axis)))
            found.append("xyz"[k] if abs(axis[k]) > ALIGNED else other)
        return found[0], found[1]

    def flat(self, points: Array) -> Array:
        """World points (..., 3) [m] on the axes (..., 2) [m]."""
        flat: Array = (np.asarray(points) - self.origin) @ self.axes[:2].T
        return flat

    def pixel_points(self, flat: Array) -> Array:
        """Points (..., 2) on the axes [m] to pixels."""
        left, top, right, bottom = self.box
        middle = np.array([(left + right) / 2, (top + bottom) / 2])
        points: Array = middle + (flat - self.centre) * self.pixels_per_metre * np.array([1.0, -1.0])
        return points

    def pixels(self, flat: Array) -> NDArray[np.int32]:
        """Points (..., 2) on the axes [m] as OpenCV takes them."""
        return fine(np.clip(self.pixel_points(flat), -1e4, 1e4))

    def ground(self) -> Canvas:
        """An empty plan with a grid."""
        canvas = Canvas(np.full((self.height, self.width, 3), AROUND, np.uint8), 1.0)
        left, top, right, bottom = self.box
        canvas.image[top:bottom, left:right] = GROUND
        for axis in (0, 1):
            for _, at in self._ticks(axis):
                ends = ((at, top), (at, bottom - 1)) if axis == 0 else ((left, at), (right - 1, at))
                cv2.line(canvas.image, *ends, GRID, 1, cv2.LINE_8)
        return canvas

    def finish(self, canvas: Canvas) -> None:
        """Cover what reaches out of the axes, and draw ticks, a scale bar and the title."""
        left, top, right, bottom = self.box
        image = canvas.image
        image[:top], image[bottom:], image[:, :left], image[:, right:] = AROUND, AROUND, AROUND, AROUND
        cv2.rectangle(image, (left, top), (right - 1, bottom - 1), TICKS, 1)
        for axis in (0, 1):
            for text, at in self._ticks(axis):
                (wide, high), _ = cv2.getTextSize(text, FONT, 0.4, 1)
                if axis == 0:
                    cv2.line(image, (at, bottom), (at, bottom + 4), TICKS, 1)
                    place = (min(max(at - wide // 2, 0), self.width - wide), bottom + 7 + high)
                else:
                    cv2.line(image, (left - 4, at), (left, at), TICKS, 1)
                    place = (max(left - 7 - wide, 0), at + high // 2)
                cv2.putText(image, text, place, FONT, 0.4, TICKS, 1, cv2.LINE_AA)
        across, up = self.axis_names
        canvas.write(f"{across} [m]", ((left + right) / 2 - 12, self.height - 6))
        canvas.write(f"{up} [m]", (4, 16))
        canvas.write(f"{self.shows}, to scale", (left + 4, 16))
        length = round_length((right - left) / 5 / self.pixels_per_metre)
        start = right - 8 - round(length * self.pixels_per_metre)
        for color, thickness in ((DARK, 5), (OBSERVED, 2)):
            cv2.line(image, (start, bottom - 8), (right - 8, bottom - 8), color, thickness, cv2.LINE_8)
        canvas.write(f"{length:g} m", (start, bottom - 14))

    def _ticks(self, axis: int) -> list[tuple[str, int]]:
        """Ticks of an axis: what is written there, and the pixel."""
        left, top, right, bottom = self.box
        low, high = (left, right) if axis == 0 else (top, bottom)
        step = round_length(min(right - left, bottom - top) / TICKS_ALONG / self.pixels_per_metre)
        half = (high - low) / 2 / self.pixels_per_metre
        sign = -1.0 if self.axes[axis].min() < -ALIGNED else 1.0
        first = np.ceil((self.centre[axis] - half) / step)
        found = []
        for k in np.arange(first, np.floor((self.centre[axis] + half) / step) + 1):
            point = np.array(self.centre)
            point[axis] = k * step
            found.append((f"{sign * k * step + 0.0:.6g}", round(float(self.pixel_points(point)[axis]))))
        return found


def round_length(longest: float) -> float:
    """The longest of 1, 2 or 5 times a power of ten that is no longer than `longest`."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= longest * (1 + 1e-9)))


def plan_axes(world: World, trajectories: list[Trajectory], camera: Camera) -> Array:
    """Rows right, up, towards the viewer (3, 3) of the plane in which a plan shows these motions."""
    own = geometry.plane_axes(world.environment.motion_plane)
    flat = _turned(own, camera)
    if world.planar or abs(own[2, 2]) < ALIGNED:
        return flat
    ranges = np.zeros(3)  # the longest way of any object to the right, away from the camera, and up [m]
    for run in trajectories:
        places = np.where(run.active[..., None], run.positions @ flat.T, np.nan)
        known = places[:, np.isfinite(places).all(axis=-1).any(axis=0)]
        if known.size:
            ranges = np.maximum(ranges, (np.nanmax(known, axis=0) - np.nanmin(known, axis=0)).max(axis=0))
    if ranges[2] <= max(ranges[1], FLAT * ranges.max()):
        return flat
    upward = np.array([0.0, 0.0, 1.0])
    return np.stack([flat[0], upward, np.cross(flat[0], upward)])


def plan_origin(world: World, axes: Array) -> Array:
    """The point (3,) [m] at which the axes of a plan are 0: the world's, but in a plane that is inclined its own."""
    inclined = np.any(np.abs(axes).max(axis=1) < ALIGNED)
    return np.asarray(world.environment.motion_plane.point, dtype=float) if inclined else np.zeros(3)


def _turned(own: Array, camera: Camera) -> Array:
    """Turn axes by quarters about the third, so that the first is as near as can be to the camera's right."""
    right, up, normal = own
    choices = [right, up, -right, -up]
    best = max(choices, key=lambda axis: float(axis @ np.asarray(camera.rotation, dtype=float)[0]))
    return np.stack([best, np.cross(normal, best), normal])
