"""Explained part of a video: silhouettes, what differs from the background beside them, confidence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.looking.overlay import DARK, OBSERVED, Canvas, Color, Crop, Image
from atw_mcp.perception.camera_motion import as_filmed, as_stabilised
from atw_mcp.perception.clip import Clip
from atw_mcp.perception.eye import EyeSettings, Seed, background_scene
from atw_mcp.perception.masks import Mask
from atw_mcp.perception.observation import ImageObservation, ObservedObject
from atw_mcp.perception.video import load

UNEXPLAINED: Color = (0, 230, 255)
SILHOUETTES: tuple[Color, ...] = (
    (230, 150, 60),
    (90, 200, 90),
    (80, 80, 235),
    (220, 90, 200),
    (200, 200, 70),
    (60, 150, 240),
)
RIM = 1  # pixels around a silhouette that blur explains
STRIP, GAP = 12, 4  # [px] height of a strip of confidence, and between two
LABEL = 110  # [px] of names beside the strips


class ResidualView:
    """Draws what an observation explains, and what it leaves, of the frames of its video."""

    def __init__(self, path: Path, observation: ImageObservation, stop: Callable[[], None]) -> None:
        self.observation = observation
        stride = observation.frames[1] - observation.frames[0] if len(observation.frames) > 1 else 1
        _, frames = load(path, stride=stride)
        self.clip = Clip.of(frames, stride, stop)
        self.scene = background_scene(self.clip.steady, self._steady_objects, EyeSettings())

    def _steady_objects(self, row: int) -> Mask:
        """Pixels (H, W) of all objects in a steady frame, grown by a rim."""
        objects = self._objects(self.observation.frames[row])
        return objects if self.clip.motion is None else as_stabilised(objects, self.clip.motion[row])

    def _objects(self, frame: int) -> Mask:
        labels = (self.observation.label_image(frame) > 0).astype(np.uint8)
        reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RIM + 1, 2 * RIM + 1))
        return np.asarray(cv2.dilate(labels, reach) > 0)

    def unexplained(self, frame: int) -> Mask:
        """Pixels (H, W) of a frame that are neither background nor shadow nor any object's."""
        row = self.observation.row(frame)
        apart = cv2.GaussianBlur(self.scene.unlike_background(row), (0, 0), 0.8) > 0
        apart = cv2.morphologyEx(apart.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        filmed = apart if self.clip.motion is None else as_filmed(apart, self.clip.motion[row])
        return np.asarray(filmed & ~self._objects(frame))

    def beside(self, image: Image, frame: int, names: list[str], crop: Crop | None, zoom: float | None) -> Image:
        """The frame with silhouettes of the named objects filled, and what is unexplained in yellow."""
        canvas = Canvas.of(image, crop, zoom)
        for name in names:
            canvas.tint(self.observation.mask(name, frame), self._color(name), 0.6)
        canvas.tint(self.unexplained(frame), UNEXPLAINED, 0.8)
        return canvas.image

    def strips(self, names: list[str], frame: int, width: int) -> Image:
        """Confidence of each object over all frames: green where sure, red where not, dark where it has no mask; white
        marks the frames in which it was outlined, a line the frame shown."""
        strip = np.full((GAP + len(names) * (STRIP + GAP), width, 3), DARK, dtype=np.uint8)
        room = max(width - LABEL - GAP, 8)
        columns = np.minimum(np.arange(room) * len(self.observation.frames) // room, len(self.observation.frames) - 1)
        for k, name in enumerate(names):
            top = GAP + k * (STRIP + GAP)
            strip[top : top + STRIP, LABEL : LABEL + room] = _tones(self.observation.object(name))[columns][None]
            for c in self.observation.constraints:
                if isinstance(c, Seed) and c.object == name and c.frame is not None:
                    x = LABEL + self._column(c.frame, room)
                    strip[top : top + STRIP, x : x + 2] = OBSERVED
            cv2.putText(
                strip,
                name[:16],
                (GAP, top + STRIP - 2),
                cv2.FONT_HERSHEY_SIMPLEX,
                0.35,
                self._color(name),
                1,
                cv2.LINE_AA,
            )
        x = LABEL + self._column(frame, room)
        strip[:, x : x + 1] = OBSERVED
        return strip

    def _column(self, frame: int, room: int) -> int:
        return int((self.observation.row(frame) + 0.5) * room / len(self.observation.frames))

    def _color(self, name: str) -> Color:
        return SILHOUETTES[self.observation.names.index(name) % len(SILHOUETTES)]


def _tones(observed: ObservedObject) -> NDArray[np.uint8]:
    """Colour (T, 3) of an object's confidence in every frame."""
    sure = observed.confidence[:, None]
    tones = np.array([60.0, 200.0, 60.0]) * sure + np.array([50.0, 50.0, 230.0]) * (1.0 - sure)
    return np.where(observed.area[:, None] > 0, tones, 45.0).astype(np.uint8)
