"""A world in a plan, true to scale: what touches, and what is only behind; paths with their direction, collisions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import takewhile

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from atw_mcp.looking.legend import draw_arrow, draw_cross, draw_star
from atw_mcp.looking.overlay import DARK, FINE_BITS, OBSERVED, SIMULATED, Canvas, Color, Image, Style
from atw_mcp.looking.plan_frame import PlanFrame, plan_axes, plan_origin
from polyworld.model import mesh_of
from polyworld.probing.readouts.rope_line import rope_line
from polyworld.trajectory import Event, Trajectory
from polyworld.world import Deformable, World, geometry
from polyworld.world.camera import Camera
from polyworld.world.colors import display_color
from polyworld.world.materials import material_of
from polyworld.world.shapes import Plane, TriangleMesh, Wall

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STATIC: Color = (150, 150, 150)  # blue, green, red
EVENT: Color = (66, 228, 240)  # the yellow of Okabe & Ito (2008)
ROUND = 64  # corners of the polygon that stands for a circle
CROWD = 16  # objects with whole names; more have short ones, and paths and collisions of late only
TIMED = 6  # most collisions with their times written beside them
AHEAD = 40.0  # [px] a path is longer than this where it gets an arrow


def plan_frame(
    runs: Sequence[tuple[World, Trajectory]], camera: Camera, names: Sequence[str], samples: Sequence[int], height: int
) -> PlanFrame:
    """Return axes on which `names` are seen at all of the `samples` of every run, and their ways until the last of
    them; `height` pixels high."""
    axes = plan_axes(runs[0][0], [run for _, run in runs], camera)
    origin = plan_origin(runs[0][0], axes)
    empty = PlanFrame(axes, origin, np.zeros((1, 2)), height)
    ways = [
        empty.flat(run.positions[: max(samples) + 1, run.index(name)])[run.active[: max(samples) + 1, run.index(name)]]
        for world, run in runs
        for name in names
        if name in run.names and name not in pathless(world)
    ]
    wheels = [
        empty.flat(np.asarray(pulley.centre)) + pulley.radius * np.array([[-1, -1], [1, 1]])
        for world, _ in runs
        for pulley in world.pulleys
    ]
    places = [
        view.outline(run.index(name), sample)
        for world, run in runs
        for view in [PlanView(world, run, empty, names)]
        for name in names
        if name in run.names
        for sample in samples
        if sample < len(run.times) and run.active[sample, run.index(name)]
    ]
    return PlanFrame(axes, origin, np.concatenate([*ways, *places, *wheels, np.empty((0, 2))]), height)


def pathless(world: World) -> set[str]:
    """Names of ropes and fluids: their centre is nothing that can be seen."""
    return {d.name for d in world.of_form("liquid", "line")}


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Names to write into pictures: as they are; of a crowd what differs, or else numbers from 1 on."""
    if len(names) <= CROWD:
        return {name: name for name in names}
    common = len(list(takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))))
    if all(0 < len(name) - common <= 3 for name in names):
        return {name: name[common:] for name in names}
    return {name: str(k) for k, name in enumerate(names, start=1)}


class PlanView:
    """Draws one run of a world on the axes of a plan."""

    def __init__(self, world: World, trajectory: Trajectory, frame: PlanFrame, names: Sequence[str]) -> None:
        """names: objects that get names and paths."""
        self.world, self.trajectory, self.frame = world, trajectory, frame
        self.names = [name for name in names if name in trajectory.names]
        self.short = short_names(names)
        self.pathless = pathless(world)

    def draw(
        self,
        sample: int,
        marks: Sequence[int],
        dashed_from: int | None,
        observed: dict[str, Array],
        events: Sequence[Event] = (),
        since: int = 0,
    ) -> Image:
        """The plan (h, w, 3) at one sample of the trajectory: paths up to it, and faint those to come.

        marks: samples that get a dot; dashed_from: the sample from which paths are dashed; observed: measured
        positions (3,) [m] by object, drawn as crosses; events: marked where they happen; since: the sample before
        which nothing is drawn.
        """
        canvas = self.frame.ground()
        self.statics(canvas)
        shown, others = self.objects(canvas, sample)
        self.paths(canvas, sample, SIMULATED, marks=marks, dashed_from=dashed_from, since=since)
        stars = self.events(canvas, sample, events, since)
        for name, place in observed.items():
            self.joined(canvas, place, self.trajectory.positions[sample, self.trajectory.index(name)])
            draw_cross(canvas, self.pixel(place), OBSERVED)
        self.frame.finish(canvas)
        self.write_names(canvas, shown, stars, others)
        return canvas.image

    def write_names(self, canvas: Canvas, shown: dict[str, Mask], stars: dict[str, Mask], others: Mask) -> None:
        """Write names of objects beside their masks, and the times of collisions where there are few."""
        others = np.any([others, ~self.frame.inside, *stars.values()], axis=0)
        canvas.names({self.short[name]: mask for name, mask in shown.items()}, OBSERVED, others)
        if len(stars) <= TIMED and len(self.names) <= CROWD:
            canvas.names(stars, EVENT, np.any([others, *shown.values()], axis=0))

    def objects(self, canvas: Canvas, sample: int, edge: Color = OBSERVED) -> tuple[dict[str, Mask], Mask]:
        """Fill the objects; returns the masks of `names` and of all others."""
        shown: dict[str, Mask] = {}
        others = np.zeros((self.frame.height, self.frame.width), bool)
        for soft in self.world.deformables:
            mask = self._deformable_mask(soft, sample)
            if mask is None:
                continue
            material = material_of(soft)
            color = display_color(soft.appearance.color or material.color, self.trajectory.index(soft.name))
            weight = material.opacity
            below = canvas.image[mask]
            canvas.image[mask] = (weight * np.array(color[::-1]) + (1.0 - weight) * below).astype(np.uint8)
            if soft.name in self.names:
                shown[soft.name] = mask
            else:
                others |= mask
        for column, item in enumerate(self.world.objects):
            polygon = self._polygon(column, sample)
            if polygon is None:
                continue
            chosen = item.name in self.names
            color = display_color(item.appearance.color, column)[::-1]
            cv2.fillPoly(canvas.image, [polygon], color, cv2.LINE_AA, FINE_BITS)
            cv2.polylines(canvas.image, [polygon], True, edge if chosen else STATIC, 1, cv2.LINE_AA, FINE_BITS)
            mask = self._filled(polygon)
            if chosen:
                shown[item.name] = mask
            else:
                others |= mask
        return shown, others

    def masks(self, sample: int) -> dict[str, Mask]:
        """Pixels of each of `names` that is there."""
        found: dict[str, Mask] = {}
        for name in self.names:
            column = self.trajectory.index(name)
            if column < len(self.world.objects):
                polygon = self._polygon(column, sample)
                mask = None if polygon is None else self._filled(polygon)
            else:
                mask = self._deformable_mask(self.world.deformable(name), sample)
            if mask is not None and mask.any():
                found[name] = mask
        return found

    def outlines(self, canvas: Canvas, sample: int, color: Color, style: Style) -> None:
        """Draw the outlines of `names` alone."""
        for mask in self.masks(sample).values():
            canvas.outline(mask, color, style)

    def paths(
        self,
        canvas: Canvas,
        sample: int,
        color: Color,
        *,
        marks: Sequence[int] = (),
        dashed_from: int | None = None,
        since: int = 0,
        to_come: bool = True,
    ) -> None:
        """Draw where `names` went from a sample to another, with an arrow, and faintly where they go from there."""
        run = self.trajectory
        for name in [name for name in self.names if name not in self.pathless]:
            column = run.index(name)
            if not run.active[:, column].any():
                continue
            began = max(int(np.argmax(run.active[:, column])), since)
            points = self.frame.pixel_points(self.frame.flat(run.positions[:, column]))
            crowd = len(self.names) > CROWD
            if to_come and not crowd:
                canvas.faint(points[max(sample, began) :], color)
            past = points[began : sample + 1]
            dots = [] if crowd else [m - began for m in marks if began <= m <= sample]
            canvas.path(past, color, dots, None if dashed_from is None else max(dashed_from - began, 0))
            self._direction(canvas, past, color)

    def events(self, canvas: Canvas, sample: int, events: Iterable[Event], since: int = 0) -> dict[str, Mask]:
        """Mark events up to a sample as stars, later ones as hollow stars; returns masks of the former by time."""
        times, stars = self.trajectory.times, {}
        for event in events:
            place = self.place_of(event)
            if place is None or event.time < times[since]:
                continue
            past = event.time <= times[sample] + 1e-9
            if not past and len(self.names) > CROWD:
                continue
            x, y = self.pixel(place)
            draw_star(canvas, (x, y), EVENT, filled=past)
            if past:
                mask = np.zeros((self.frame.height, self.frame.width), np.uint8)
                cv2.circle(mask, (round(x), round(y)), 8, 1, -1)
                stars[f"{event.time:.3g} s"] = mask > 0
        return stars

    def place_of(self, event: Event) -> Array | None:
        """Where an event happens (3,) [m]; None where that is not known."""
        if event.position is not None:
            return np.asarray(event.position, dtype=float)
        known = [name for name in event.participants if name in self.trajectory.names]
        if not known:
            return None
        row = int(np.argmin(np.abs(self.trajectory.times - event.time)))
        place: Array = self.trajectory.positions[row, self.trajectory.index(known[0])]
        return place

    def joined(self, canvas: Canvas, start: Array, end: Array, color: Color = OBSERVED) -> None:
        """Draw a line between two places (3,) [m]."""
        ends = self.frame.pixels(self.frame.flat(np.stack([start, end])))
        if np.all(np.isfinite([start, end])):
            cv2.polylines(canvas.image, [ends], False, DARK, 3, cv2.LINE_AA, FINE_BITS)
            cv2.polylines(canvas.image, [ends], False, color, 1, cv2.LINE_AA, FINE_BITS)

    def pixel(self, place: Array) -> tuple[float, float]:
        """The pixel of a place (3,) [m]."""
        x, y = np.clip(np.nan_to_num(self.frame.pixel_points(self.frame.flat(place)), nan=-1e4), -1e4, 1e4)
        return float(x), float(y)

    def outline(self, column: int, sample: int) -> Array:
        """Corners (k, 2) [m] of an object on the axes of the plan; of a deformable one those of its extent."""
        if column >= len(self.world.objects):
            points = self.frame.flat(self.trajectory.deformables[self.trajectory.names[column]].points[sample])
            points = points[np.all(np.isfinite(points), axis=1)]
            return np.stack([points.min(axis=0), points.max(axis=0)]) if len(points) else np.full((1, 2), np.nan)
        rotation = geometry.quaternion_matrix(self.trajectory.orientations[sample, column])
        place = self.frame.flat(self.trajectory.positions[sample, column])
        if not (np.all(np.isfinite(rotation)) and np.all(np.isfinite(place))):
            return np.full((1, 2), np.nan)
        return place + silhouette(self.world.objects[column].shape, rotation, self.frame.axes)

    def statics(self, canvas: Canvas) -> None:
        """Walls, boxes and the like in outline; planes that stand on edge as lines. Triangle meshes are left out."""
        for static in self.world.statics:
            shape, place = static.shape, np.asarray(static.position, dtype=float)
            rotation = geometry.quaternion_matrix(np.asarray(static.orientation))
            if isinstance(shape, TriangleMesh):
                continue
            if isinstance(shape, Plane):
                normal = rotation @ (np.asarray(shape.normal) / np.linalg.norm(shape.normal))
                across = self.frame.axes[:2] @ normal
                if np.linalg.norm(across) < 0.9:
                    continue
                foot = self.frame.flat(place + normal * shape.offset)
                along = np.array([-across[1], across[0]]) * 1e4 / self.frame.pixels_per_metre
                line = self.frame.pixels(np.stack([foot - along, foot + along]))
                cv2.polylines(canvas.image, [line], False, STATIC, 2, cv2.LINE_AA, FINE_BITS)
                continue
            if isinstance(shape, Wall):
                box, centre, turn = geometry.wall_box(shape)
                place, rotation, shape = place + rotation @ centre, rotation @ turn, box
            polygon = self.frame.pixels(self.frame.flat(place) + silhouette(shape, rotation, self.frame.axes))
            cv2.polylines(canvas.image, [polygon], True, STATIC, 2, cv2.LINE_AA, FINE_BITS)

        for pulley in self.world.pulleys:
            if abs(np.asarray(pulley.axis) @ self.frame.axes[2]) > 0.9 * np.linalg.norm(pulley.axis):
                x, y = self.pixel(np.asarray(pulley.centre))
                radius = round(pulley.radius * self.frame.pixels_per_metre)
                cv2.circle(canvas.image, (round(x), round(y)), radius, STATIC, 2, cv2.LINE_AA)

    def _polygon(self, column: int, sample: int) -> NDArray[np.int32] | None:
        if not self.trajectory.active[sample, column]:
            return None
        corners = self.outline(column, sample)
        return self.frame.pixels(corners) if np.all(np.isfinite(corners)) else None

    def _filled(self, polygon: NDArray[np.int32]) -> Mask:
        mask = np.zeros((self.frame.height, self.frame.width), np.uint8)
        cv2.fillPoly(mask, [polygon], 1, cv2.LINE_8, FINE_BITS)
        return mask > 0

    def _deformable_mask(self, item: Deformable, sample: int) -> Mask | None:
        """A rope as a line, cloth and soft bodies as their triangles, a fluid as the dots of its particles."""
        if not self.trajectory.active[sample, self.trajectory.index(item.name)]:
            return None
        material, mesh = material_of(item), mesh_of(self.world, item)
        flat = self.frame.flat(self.trajectory.deformables[item.name].points[sample])
        mask = np.zeros((self.frame.height, self.frame.width), np.uint8)
        if material.form == "liquid":
            pixels = np.rint(self.frame.pixel_points(flat[np.all(np.isfinite(flat), axis=1)])).astype(int)
            inside = np.all((pixels >= 0) & (pixels < [self.frame.width, self.frame.height]), axis=1)
            mask[pixels[inside, 1], pixels[inside, 0]] = 1
            cell = 0.0 if self.world.fluid_grid is None else self.world.fluid_grid.cell
            wide = max(2, round(1.2 * cell * self.frame.pixels_per_metre))
            mask[:] = cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide)))
        elif material.form == "line":
            wide = max(2, round(2 * float(mesh.radius[0]) * self.frame.pixels_per_metre))
            moment = self.trajectory.select(np.array([sample]))
            flat = self.frame.flat(rope_line(self.world, moment, item.name)[0])  # round pulleys
            cv2.polylines(mask, [self.frame.pixels(flat)], False, 1, wide, cv2.LINE_8, FINE_BITS)
        else:
            for triangle in self.frame.pixels(flat)[mesh.triangles]:
                cv2.fillConvexPoly(mask, triangle, 1, cv2.LINE_8, FINE_BITS)
        return mask > 0

    def _direction(self, canvas: Canvas, path: Array, color: Color) -> None:
        """An arrow half way along a path (k, 2) [px] that is long enough for one."""
        path = path[np.all(np.isfinite(path), axis=1)]
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        if steps.sum() < AHEAD or len(self.names) > CROWD:
            return
        k = int(np.searchsorted(np.cumsum(steps), steps.sum() / 2))
        along = path[k + 1] - path[k]
        if np.linalg.norm(along) > 0:
            draw_arrow(canvas, (float(path[k + 1, 0]), float(path[k + 1, 1])), (along[0], along[1]), color)


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
