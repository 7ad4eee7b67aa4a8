"""A world seen straight down on its plane of motion, true to scale: what touches, and what is only behind."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from atw_mcp.looking.overlay import DARK, FINE_BITS, OBSERVED, SIMULATED, Canvas, Image, fine
from polyworld.model import mesh_of
from polyworld.trajectory import Trajectory
from polyworld.world import Deformable, World, geometry
from polyworld.world.camera import Camera
from polyworld.world.colors import display_color
from polyworld.world.materials import material_of
from polyworld.world.shapes import Plane, TriangleMesh, Wall

Array = NDArray[np.float64]

GROUND = (64, 58, 54)
STATIC = (150, 150, 150)
ROUND = 64  # corners of the polygon that stands for a circle
MARGIN, FOOT = 34, 26  # [px] free at the sides; kept at the bottom for the scale bar
NARROWEST, WIDEST = 0.5, 0.95  # width of the strip per height


class PlanView:
    """A strip beside a picture. It is turned so that up is away from the camera and right is right."""

    def __init__(
        self, world: World, trajectory: Trajectory, camera: Camera, names: list[str], samples: list[int], height: int
    ) -> None:
        """The strip shows `names` at all of the trajectory's `samples`; it is `height` pixels high."""
        self.world, self.trajectory, self.names = world, trajectory, names
        self.axes = _axes(world, camera)
        self.origin = np.asarray(world.environment.motion_plane.point, dtype=float)
        corners = [
            self._outline(trajectory.index(name), sample)
            for name in names
            for sample in samples
            if trajectory.active[sample, trajectory.index(name)]
        ]
        finite = [c for c in corners if np.all(np.isfinite(c))] or [np.array([[-0.5, -0.5], [0.5, 0.5]])]
        lower, upper = np.concatenate(finite).min(axis=0), np.concatenate(finite).max(axis=0)
        extent = np.maximum(upper - lower, 1e-3)
        shape = float(np.clip(extent[0] / extent[1], NARROWEST, WIDEST))
        self.height, self.width = height, 2 * round(shape * height / 2)
        room = np.array([self.width - 2 * MARGIN, height - 2 * MARGIN - FOOT], dtype=float)
        self.pixels_per_metre = float((room / extent).min())
        self.centre = (lower + upper) / 2

    def draw(self, sample: int, marks: Sequence[int], dashed_from: int | None, observed: dict[str, Array]) -> Image:
        """The strip (height, width, 3) at one sample of the trajectory, with the paths up to it.

        marks: samples that get a dot; dashed_from: the sample from which paths are dashed; observed: measured
        positions (3,) [m] by object, drawn as crosses.
        """
        canvas = Canvas(np.full((self.height, self.width, 3), GROUND, np.uint8), 1.0)
        self._draw_statics(canvas)
        shown: dict[str, NDArray[np.bool_]] = {}
        others = np.zeros((self.height, self.width), np.uint8)
        for soft in self.world.deformables:
            self._draw_deformable(canvas, soft, sample, shown, others)
        for column, item in enumerate(self.world.objects):
            if not self.trajectory.active[sample, column]:
                continue
            outline = self._outline(column, sample)
            if not np.all(np.isfinite(outline)):
                continue
            polygon = self._pixels(outline)
            chosen = item.name in self.names
            color = display_color(item.appearance.color, column)[::-1]
            cv2.fillPoly(canvas.image, [polygon], color, cv2.LINE_AA, FINE_BITS)
            edge = OBSERVED if chosen else STATIC
            cv2.polylines(canvas.image, [polygon], True, edge, 1, cv2.LINE_AA, FINE_BITS)
            mask = np.zeros_like(others)
            cv2.fillPoly(mask, [polygon], 1, cv2.LINE_8, FINE_BITS)
            if chosen:
                shown[item.name] = mask > 0
            else:
                others |= mask
        pathless = {d.name for d in self.world.of_form("liquid", "line")}
        for name in [name for name in shown if name not in pathless]:
            column = self.trajectory.index(name)
            began = int(np.argmax(self.trajectory.active[:, column]))
            points = self._pixel_points(self._flat(self.trajectory.positions[began : sample + 1, column]))
            dashed = None if dashed_from is None else max(dashed_from - began, 0)
            canvas.path(points, SIMULATED, [m - began for m in marks if began <= m <= sample], dashed)
        for name, place in observed.items():
            self._draw_observed(canvas, place, self.trajectory.positions[sample, self.trajectory.index(name)])
        canvas.names(shown, OBSERVED, others > 0)
        self._draw_scale(canvas)
        return canvas.image

    def _draw_deformable(
        self,
        canvas: Canvas,
        item: Deformable,
        sample: int,
        shown: dict[str, NDArray[np.bool_]],
        others: NDArray[np.uint8],
    ) -> None:
        """A rope as a line, cloth and soft bodies as their filled triangles, a fluid as the dots of its particles."""
        column = self.trajectory.index(item.name)
        if not self.trajectory.active[sample, column]:
            return
        material, mesh = material_of(item), mesh_of(self.world, item)
        color = display_color(item.appearance.color or material.color, column)
        flat = self._flat(self.trajectory.deformables[item.name].points[sample])
        mask = np.zeros_like(others)
        wide = 1
        if material.form == "liquid":
            pixels = np.rint(self._pixel_points(flat[np.all(np.isfinite(flat), axis=1)])).astype(int)
            inside = np.all((pixels >= 0) & (pixels < [self.width, self.height]), axis=1)
            mask[pixels[inside, 1], pixels[inside, 0]] = 1
            cell = 0.0 if self.world.fluid_grid is None else self.world.fluid_grid.cell
            wide = max(2, round(1.2 * cell * self.pixels_per_metre))
            mask[:] = cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide)))
        elif material.form == "line":
            wide = max(2, round(2 * float(mesh.radius[0]) * self.pixels_per_metre))
            cv2.polylines(mask, [self._pixels(flat)], False, 1, wide, cv2.LINE_8, FINE_BITS)
        else:
            corners = self._pixels(flat)[mesh.triangles]
            for triangle in corners:
                cv2.fillConvexPoly(mask, triangle, 1, cv2.LINE_8, FINE_BITS)
        covered = mask > 0
        weight = material.opacity
        canvas.image[covered] = (weight * np.array(color[::-1]) + (1.0 - weight) * canvas.image[covered]).astype(
            np.uint8
        )
        if item.name in self.names:
            shown[item.name] = covered
        else:
            others |= mask

    def _draw_observed(self, canvas: Canvas, observed: Array, simulated: Array) -> None:
        """A cross where an object was observed, and a line from there to where it is simulated."""
        if not np.all(np.isfinite([observed, simulated])):
            return
        line = fine(self._pixel_points(self._flat(np.stack([observed, simulated]))))
        cv2.polylines(canvas.image, [line], False, DARK, 3, cv2.LINE_AA, FINE_BITS)
        cv2.polylines(canvas.image, [line], False, OBSERVED, 1, cv2.LINE_AA, FINE_BITS)
        x, y = (round(float(v)) for v in self._pixel_points(self._flat(observed)))
        cv2.drawMarker(canvas.image, (x, y), DARK, cv2.MARKER_TILTED_CROSS, 9, 3, cv2.LINE_AA)
        cv2.drawMarker(canvas.image, (x, y), OBSERVED, cv2.MARKER_TILTED_CROSS, 8, 1, cv2.LINE_AA)

    def _flat(self, points: Array) -> Array:
        """World points (..., 3) [m] in the strip's axes (..., 2) [m]."""
        flat: Array = (np.asarray(points) - self.origin) @ self.axes[:2].T
        return flat

    def _pixel_points(self, flat: Array) -> Array:
        """Points (..., 2) of the strip's axes [m] to its pixels."""
        middle = np.array([self.width / 2, (self.height - FOOT) / 2 + 8])
        points: Array = middle + (flat - self.centre) * self.pixels_per_metre * np.array([1.0, -1.0])
        return points

    def _pixels(self, flat: Array) -> NDArray[np.int32]:
        return fine(np.clip(self._pixel_points(flat), -1e4, 1e4))

    def _outline(self, column: int, sample: int) -> Array:
        if column >= len(self.world.objects):
            points = self._flat(self.trajectory.deformables[self.trajectory.names[column]].points[sample])
            points = points[np.all(np.isfinite(points), axis=1)]
            return np.stack([points.min(axis=0), points.max(axis=0)]) if len(points) else np.full((1, 2), np.nan)
        rotation = geometry.quaternion_matrix(self.trajectory.orientations[sample, column])
        place = self._flat(self.trajectory.positions[sample, column])
        if not (np.all(np.isfinite(rotation)) and np.all(np.isfinite(place))):
            return np.full((1, 2), np.nan)
        return place + silhouette(self.world.objects[column].shape, rotation, self.axes)

    def _draw_statics(self, canvas: Canvas) -> None:
        """Walls, boxes and the like in outline; planes that stand on edge as lines. Triangle meshes are left out."""
        for static in self.world.statics:
            shape, place = static.shape, np.asarray(static.position, dtype=float)
            rotation = geometry.quaternion_matrix(np.asarray(static.orientation))
            if isinstance(shape, TriangleMesh):
                continue
            if isinstance(shape, Plane):
                normal = rotation @ (np.asarray(shape.normal) / np.linalg.norm(shape.normal))
                across = self.axes[:2] @ normal
                if np.linalg.norm(across) < 0.9:
                    continue
                foot = self._flat(place + normal * shape.offset)
                along = np.array([-across[1], across[0]]) * 1e4 / self.pixels_per_metre
                line = self._pixels(np.stack([foot - along, foot + along]))
                cv2.polylines(canvas.image, [line], False, STATIC, 2, cv2.LINE_AA, FINE_BITS)
                continue
            if isinstance(shape, Wall):
                box, centre, turn = geometry.wall_box(shape)
                place, rotation, shape = place + rotation @ centre, rotation @ turn, box
            polygon = self._pixels(self._flat(place) + silhouette(shape, rotation, self.axes))
            cv2.polylines(canvas.image, [polygon], True, STATIC, 2, cv2.LINE_AA, FINE_BITS)

    def _draw_scale(self, canvas: Canvas) -> None:
        """Draw the strip's caption, a bar of a round length, and the world axes that lie in the plane."""
        canvas.write("plan, to scale", (8, 16))
        length = round_length(self.width / 4 / self.pixels_per_metre)
        y, left = self.height - 12, 10
        right = left + round(length * self.pixels_per_metre)
        for color, thickness in ((DARK, 5), (OBSERVED, 2)):
            cv2.line(canvas.image, (left, y), (right, y), color, thickness, cv2.LINE_8)
        canvas.write(f"{length:g} m", (right + 8, y + 4))
        foot = np.array([self.width - 44.0, self.height - 44.0])
        for name, axis in zip("xyz", np.eye(3), strict=True):
            flat = self.axes[:2] @ axis * np.array([1.0, -1.0])
            if np.linalg.norm(flat) < 0.5:
                continue
            start, tip = (tuple(np.rint(p).astype(int).tolist()) for p in (foot, foot + 18.0 * flat))
            cv2.arrowedLine(canvas.image, start, tip, STATIC, 1, cv2.LINE_AA, 0, 0.3)
            canvas.write(name, tuple((foot + 27.0 * flat + np.array([-4.0, 4.0])).tolist()), STATIC)


def silhouette(shape: geometry.Solid, rotation: Array, axes: Array) -> Array:
    """The outline (k, 2) [m] of a turned shape about its origin, seen along the third of `axes` (3, 3)."""
    points, radius = geometry.planar_outline(shape, rotation, axes)
    if radius == 0.0:
        return points
    angle = np.arange(ROUND) * (2 * np.pi / ROUND)
    disc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    swept = (points[:, None] + disc).reshape(-1, 2)
    corners: Array = swept[ConvexHull(swept).vertices]
    return corners


def round_length(longest: float) -> float:
    """The longest of 1, 2 or 5 times a power of ten that is no longer than `longest`."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= longest * (1 + 1e-9)))


def _axes(world: World, camera: Camera) -> Array:
    """Rows right, up, towards the viewer (3, 3): the motion plane's normal, and the camera's right laid into it."""
    own = geometry.plane_axes(world.environment.motion_plane)
    normal = own[2]
    right = np.asarray(camera.rotation, dtype=float)[0]
    right = right - (right @ normal) * normal
    if np.linalg.norm(right) < 0.2:
        return own
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(normal, right), normal])
