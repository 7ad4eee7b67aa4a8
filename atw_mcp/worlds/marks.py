"""Small marks on a picture for what has no body of its own: joints, springs, fastenings, nozzles, measured boxes."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.looking.overlay import DARK, Canvas, Color, fine
from polyworld.model import mesh_of
from polyworld.trajectory import Trajectory
from polyworld.world import World, geometry
from polyworld.world.camera import Camera
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.joint import Hinge, Joint, Slider, Spring

Array = NDArray[np.float64]

JOINT: Color = (90, 220, 255)  # blue, green, red
FASTENING: Color = (255, 255, 255)
BOX: Color = (90, 200, 90)
TANK: Color = (150, 150, 150)
NOZZLE: Color = (255, 190, 60)
AXIS = 18.0  # [px] half the length of a hinge's axis
MOST_NODES = 12  # marks for one fastening
COILS = 12  # of a spring
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]
LEGEND = (
    "yellow: joints (ring: hinge or ball, with its axis; zigzag: spring), white dots: fastenings; green boxes: "
    "containers; grey boxes: walls of the fluid grid, drains; blue rings: emitters"
)


class WorldMarks:
    """Draws the marks of a world at any sample of a trajectory of it."""

    def __init__(self, world: World, trajectory: Trajectory, camera: Camera) -> None:
        self.world, self.trajectory, self.camera = world, trajectory, camera
        self.held = {a.name: held_nodes(world, a) for a in world.attachments}
        parts = ("joints", "attachments", "containers", "fluid_grid", "emitters", "drains")
        self.any = any(getattr(world, part) for part in parts)

    def draw(self, canvas: Canvas, sample: int) -> None:
        """All marks of the world on a picture by this camera."""
        grid = self.world.fluid_grid
        if grid is not None and grid.closed:
            self._box(canvas, np.asarray(grid.lower), np.asarray(grid.upper), TANK)
        for drain in self.world.drains:
            self._box(canvas, np.asarray(drain.lower), np.asarray(drain.upper), TANK)
        for container in self.world.containers:
            lower, upper = np.asarray(container.lower), np.asarray(container.upper)
            self._box(canvas, lower, upper, BOX, container.object, sample)
        for emitter in self.world.emitters:
            self._nozzle(canvas, np.asarray(emitter.position), np.asarray(emitter.direction), emitter.radius)
        for joint in self.world.joints:
            self._joint(canvas, joint, sample)
        for attachment in self.world.attachments:
            if attachment.release is None or self.trajectory.times[sample] < attachment.release:
                self._fastening(canvas, attachment, sample)

    def _carried(self, points: Array, name: str | None, sample: int) -> Array:
        """Where points (k, 3), given as the world starts, are with the rigid object they belong to."""
        if name is None:
            return points
        item, column = self.world.object(name), self.trajectory.index(name)
        start = geometry.quaternion_matrix(np.asarray(item.orientation))
        now = geometry.quaternion_matrix(self.trajectory.orientations[sample, column])
        moved: Array = (
            self.trajectory.positions[sample, column] + (points - np.asarray(item.position)) @ (now @ start.T).T
        )
        return moved

    def _line(self, canvas: Canvas, points: Array, color: Color, thickness: int = 1) -> None:
        pixels = self.camera.project(points) * canvas.scale
        for a, b in pairwise(pixels):
            if np.all(np.isfinite([a, b])) and np.abs([a, b]).max() < 1e5:
                line = fine(np.stack([a, b]))
                cv2.polylines(canvas.image, [line], False, DARK, thickness + 2, cv2.LINE_AA, 4)
                cv2.polylines(canvas.image, [line], False, color, thickness, cv2.LINE_AA, 4)

    def _dot(self, canvas: Canvas, point: Array, color: Color, radius: int, *, filled: bool) -> None:
        pixel = self.camera.project(point[None])[0] * canvas.scale
        if np.all(np.isfinite(pixel)) and np.abs(pixel).max() < 1e5:
            at = (round(float(pixel[0])), round(float(pixel[1])))
            cv2.circle(canvas.image, at, radius + 1, DARK, -1 if filled else 4, cv2.LINE_AA)
            cv2.circle(canvas.image, at, radius, color, -1 if filled else 2, cv2.LINE_AA)

    def _box(
        self, canvas: Canvas, lower: Array, upper: Array, color: Color, name: str | None = None, sample: int = 0
    ) -> None:
        corners = self._carried(lower + CORNERS * (upper - lower), name, sample)
        pixels = self.camera.project(corners) * canvas.scale
        for a, b in EDGES:
            if np.all(np.isfinite(pixels[[a, b]])) and np.abs(pixels[[a, b]]).max() < 1e5:
                cv2.polylines(canvas.image, [fine(pixels[[a, b]])], False, color, 1, cv2.LINE_AA, 4)

    def _nozzle(self, canvas: Canvas, position: Array, direction: Array, radius: float) -> None:
        along = direction / np.linalg.norm(direction)
        across = np.cross(along, [1.0, 0.0, 0.0] if abs(along[0]) < 0.9 else [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        angle = np.linspace(0.0, 2 * np.pi, 25)[:, None]
        ring = position + radius * (np.cos(angle) * across + np.sin(angle) * np.cross(along, across))
        self._line(canvas, ring, NOZZLE, 2)
        self._line(canvas, np.stack([position - 3.0 * radius * along, position]), NOZZLE, 2)

    def _joint(self, canvas: Canvas, joint: Joint, sample: int) -> None:
        anchor = self._carried(np.asarray([joint.anchor], dtype=float), joint.object, sample)[0]
        if isinstance(joint, Spring):
            other = self._carried(np.asarray([joint.other_anchor], dtype=float), joint.other, sample)[0]
            self._line(canvas, self._coil(anchor, other), JOINT, 1)
            return
        if isinstance(joint, Hinge | Slider):
            axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
            if self.world.planar:
                axis = geometry.plane_axes(self.world.environment.motion_plane)[2]
            tips = self._carried(np.asarray(joint.anchor) + np.array([[0.0], [1.0]]) * axis, joint.object, sample)
            metres = AXIS * float(self.camera.to_camera(anchor)[2]) / self.camera.intrinsics[0][0]
            along = (tips[1] - tips[0]) * metres
            self._line(canvas, np.stack([anchor - along, anchor + along]), JOINT, 1)
        self._dot(canvas, anchor, JOINT, 4, filled=joint.kind in ("fixed", "slider"))

    def _coil(self, start: Array, end: Array) -> Array:
        along = end - start
        length = float(np.linalg.norm(along))
        across = np.cross(along, np.asarray(self.camera.rotation)[2])
        across = across / max(float(np.linalg.norm(across)), 1e-9) * min(0.06 * length, 0.05)
        share = np.linspace(0.0, 1.0, 2 * COILS + 1)[:, None]
        swing = np.where(np.arange(2 * COILS + 1) % 2 == 0, 1.0, -1.0)[:, None]
        swing[[0, -1]] = 0.0
        coil: Array = start + share * along + swing * across
        return coil

    def _fastening(self, canvas: Canvas, attachment: Attachment, sample: int) -> None:
        points = self.trajectory.deformables[attachment.object].points[sample]
        nodes = self.held[attachment.name]
        for node in nodes[:: max(1, -(-len(nodes) // MOST_NODES))]:
            if np.all(np.isfinite(points[node])):
                self._dot(canvas, points[node], FASTENING, 2, filled=True)


def held_nodes(world: World, attachment: Attachment) -> list[int]:
    """Indices of the nodes that an attachment holds."""
    nodes = mesh_of(world, world.deformable(attachment.object)).nodes
    if attachment.end is not None:
        return [0 if attachment.end == "start" else len(nodes) - 1]
    if attachment.nodes is not None:
        return [node for node in attachment.nodes if node < len(nodes)]
    assert attachment.region is not None  # the attachment's own check
    inside = np.all((nodes >= attachment.region.lower) & (nodes <= attachment.region.upper), axis=1)
    return [int(i) for i in np.flatnonzero(inside)]
