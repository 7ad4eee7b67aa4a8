"""Masks as a scene of the eye: pixels are decided already, and near other objects or the border they say nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from atw_mcp.perception.eye.bodies import Solid
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Array, Background, Film, Floats, Mask, sampled
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.eye.silhouette import Fit, fit_pose
from atw_mcp.perception.masks import window
from atw_mcp.perception.observation import ImageObservation

CLEARANCE = 2.5  # [px] from other objects and from the image's border within which an outline is not an object's own
REACHES = (12.0, 8.0, 6.0, 6.0)  # [px] of normals: nothing near a mask misleads, and its solid may be of another size
BORDER = 1.5  # [px] by which whoever made a mask may draw all of its border farther out, or in
RIMS = 0.02  # as in EyeSettings: the border's own error hides more
OUTWARD = 0.3  # as in EyeSettings: masks take in shadows that touch a body, which pixels show to be shadows
MARGIN = 20  # [px] around a mask: edges farther away are not searched for
SMOOTH = 0.7  # [px] over which a mask's steps are averaged
FARTHER = 1.02  # ratio of distances from which one object is surely behind another


class MaskScene(Scene):
    """Objects of an observation, each as the solid of its name. depths: T distances [m] of those that may be behind
    others, whose edges are then the others' own."""

    def __init__(
        self, observation: ImageObservation, bodies: Sequence[Solid], depths: Mapping[str, Floats] | None = None
    ) -> None:
        settings = replace(EyeSettings(), reaches=REACHES, border=BORDER, outward=OUTWARD, rims=RIMS)
        size = observation.video.height, observation.video.width
        nothing = np.broadcast_to(np.uint8(0), (len(observation.frames), *size, 3))
        flat = np.zeros((1, 1, 3), np.float32)
        super().__init__(Film(nothing, settings), list(bodies), settings, Background(flat, flat, flat[0, 0]))
        self._observation, self._depths = observation, depths or {}
        self._layers: dict[tuple[str, int], tuple[Floats, Array]] = {}

    def log_odds(
        self, body: int, frame: int, pose: Floats, points: Floats, *, anywhere: bool = False, besides: bool = False
    ) -> tuple[Array, Mask]:
        """Log odds (M,) that points (M, 2) of the steady frame show a body, by its mask; whether they can show it."""
        del pose, anywhere, besides
        key = self.bodies[body].name, frame
        if key not in self._layers:
            self._layers[key] = self._layers_of(*key)
        corner, layers = self._layers[key]
        filmed = self._observation.filmed(points, frame)
        values = sampled(layers, filmed - corner)
        most = np.array([self.film.width, self.film.height]) - 1.0 - CLEARANCE
        free = (values[:, 1] > CLEARANCE) & ((filmed > CLEARANCE) & (filmed < most)).all(axis=1)
        return (2 * values[:, 0] - 1) * np.float32(self.settings.decided), free

    def _layers_of(self, name: str, frame: int) -> tuple[Floats, Array]:
        """First pixel (2,) of a window around a mask; the mask, and distances from others in front of it (h, w, 2)."""
        seen = self._observation.object(name).masks[frame]
        own = np.zeros((self.film.height, self.film.width), bool) if seen is None else seen.decode()
        part = window(own, MARGIN)
        others = np.zeros(own[part].shape, bool)
        for other in self._observation.objects:
            stored = other.masks[frame]
            if other.name == name or stored is None or self._is_behind(other.name, name, frame):
                continue
            others |= stored.decode()[part]
        away = np.full(others.shape, 99.0, np.float32)
        if others.any():
            away = np.asarray(cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5), dtype=np.float32)
        corner = np.array([part[1].start, part[0].start], float)
        smooth = cv2.GaussianBlur(own[part].astype(np.float32), (0, 0), SMOOTH) if away.size else away
        return corner, np.stack([smooth, away], axis=-1)

    def _is_behind(self, other: str, name: str, frame: int) -> bool:
        depths = self._depths
        return other in depths and name in depths and depths[other][frame] > FARTHER * depths[name][frame]

    def placed(self, body: int, frame: int) -> Floats | None:
        """Pose (4,) at which a body's silhouette lies about its mask; None where it has no such place."""
        shape = self.bodies[body]
        assert isinstance(shape, Solid)
        left, top, width, height = self._observation.object(shape.name).box[frame]
        middle = self._observation.steadied(np.array([left + 0.5 * (width - 1), top + 0.5 * (height - 1)]), frame)
        return shape.about(middle)

    def fit(self, body: int, frame: int, near: Floats | None = None) -> Fit | None:
        """Pose that a body's mask shows best, from one (4,) near or from all angles; None where it has no place."""
        shape, start = self.bodies[body], self.placed(body, frame) if near is None else near
        if start is None:
            return None
        angles = shape.angles() if near is None else [0.0]
        coarse = 0 if near is None else 2
        fits = [fit_pose(self, body, frame, start + np.array([0.0, 0.0, a, 0.0]), coarse=coarse) for a in angles]
        return min(fits, key=lambda fit: fit.misfit)
