"""Search: places at which the whole silhouette of a known solid on its plane is an edge of a frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.bodies import Solid, sampled_contour
from atw_mcp.perception.eye.colours import STRETCH
from atw_mcp.perception.eye.pixels import Array, Bytes, Floats, features, sampled
from atw_mcp.perception.eye.settings import EyeSettings

NORMALS = 24  # of a silhouette; those of a small one are no independent edges, and weigh less
BIN, BINS = 0.02, 100  # [feature] of the histogram of steps
SIDE = 4  # places along each axis that share a silhouette: a radius, within which they are one


class Silhouettes:
    """Silhouettes of a solid on its plane of motion all over a picture, and what a frame says for each.

    They are laid out once for all frames: pairs (M, NORMALS, 2, 2) of pixels inside and outside of each point of each
    silhouette, in reduced frames; places (M, 3): u, v of its centre [px], a quarter of a radius apart, and its angle.
    """

    def __init__(self, body: Solid, factor: float, settings: EyeSettings, hiding: Array | None) -> None:
        """factor: of reduced frames; hiding (H, W): depth of what never moves and may hide the body."""
        self.body, self.factor, self.settings, self.hiding = body, factor, settings, hiding
        found = [*self._laid_out(), (np.zeros((0, NORMALS, 2, 2)), np.zeros((0, 3)), np.zeros(0))]
        self._pairs, self._places, self._weights = (np.concatenate(column) for column in zip(*found, strict=True))

    def _laid_out(self) -> Iterator[tuple[Floats, Floats, Floats]]:
        s, body, (width, height) = self.settings, self.body, (self.body.camera.width, self.body.camera.height)
        row = 0.0
        while row < height:
            middle = body.placed(np.array([width / 2, row]), np.zeros(4))
            radius = body.radius(middle) if np.isfinite(middle).all() and body.depth(middle) > 0 else 0.0
            pitch = max(1.5 / self.factor, radius / SIDE)
            if s.least_region < np.pi * (radius * self.factor) ** 2 and radius < height / 2:
                for column in np.arange(0.0, width, SIDE * pitch):
                    for angle in body.angles():
                        pixel = np.array([column, row]) + 0.5 * (SIDE - 1) * pitch
                        block = self._block(np.array([*pixel, angle]), pitch * (np.arange(SIDE) - 0.5 * (SIDE - 1.0)))
                        if block is not None:
                            yield block
            row += SIDE * pitch

    def _block(self, place: Floats, offsets: NDArray[np.floating]) -> tuple[Floats, Floats, Floats] | None:
        """Pairs, places and weights of one silhouette displaced by offsets [px] along each axis, where in view."""
        s, pose = self.settings, self._pose(place)
        there = np.isfinite(pose).all() and not self.body.under_floor(pose)
        polygon = self.body.polygon(pose) if there else np.full((1, 2), np.nan)
        if not np.isfinite(polygon).all() or np.linalg.norm(self.body.centre(pose) - place[:2]) > 1.0:
            return None  # beyond the horizon, or within something fixed that bears it
        if self.hiding is not None and sampled(self.hiding, place[None, :2])[0, 0] < self.body.depth(pose):
            return None
        contour = sampled_contour(polygon, np.zeros((1, len(polygon), 2)), NORMALS)
        aside = s.mixed_near / self.factor * contour.normals
        moved = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
        pairs = np.stack([contour.points - aside, contour.points + aside], axis=1) + moved[:, None, None]
        size = np.array([self.body.camera.width, self.body.camera.height])
        inside = ((pairs > 0) & (pairs < size - 1)).all(axis=(1, 2, 3))
        places = np.c_[place[:2] + moved, np.full(len(moved), place[2])]
        weights = np.full(len(moved), min(1.0, contour.spacing * self.factor / s.correlated))
        return ((pairs + 0.5) * self.factor - 0.5)[inside], places[inside], weights[inside]

    def _pose(self, place: Floats) -> Floats:
        return self.body.placed(place[:2], np.array([0.0, 0.0, place[2], 0.0]))

    def best(self, frame: Bytes, count: int) -> list[tuple[Floats, float]]:
        """Poses (4,) in a reduced frame with the largest log odds [nats] that a body is there, a radius apart.

        Each normal's step of features is compared with those at all places of the frame. A darkening that is common to
        the normals is a shadow's, and no evidence. Normals are alike, as the pixels of a body are.
        """
        s, found = self.settings, list[tuple[Floats, float]]()
        if not len(self._places):
            return found
        look = features(frame.astype(np.float32), s)
        steps = _steps(look, self._pairs)
        usual = np.bincount(_bins(steps).ravel(), minlength=BINS) + 1.0
        expected = np.exp(-np.arange(BINS) * BIN / s.contrast)
        odds = np.maximum.accumulate(np.log(expected / expected.sum() / (usual / usual.sum())))
        odds = np.clip(odds, -s.edge_odds, s.edge_odds)
        total = self._odds(steps, self._weights, odds)
        while len(found) < count and total.max() > -s.unlikely:
            place = self._places[int(np.argmax(total))]
            near = np.hypot(*(self._places[:, :2] - place[:2]).T)
            radius = self.body.radius(self._pose(place))
            total[near < radius] = -np.inf
            for pitch in (radius / 6, radius / 18):
                block = self._block(place, pitch * np.arange(-2, 3))
                if block is None or not len(block[0]):
                    break
                finer = self._odds(_steps(look, block[0]), block[2], odds)
                place = block[1][int(np.argmax(finer))]
            else:
                found.append((self._pose(place), float(finer.max())))
        return [f for f in found if f[1] > 0.0]

    def _odds(self, steps: Array, weights: Floats, odds: Floats) -> Floats:
        """Log odds (M,) of silhouettes with steps (M, NORMALS, 3) of features, weights (M,), and odds by bin."""
        s = self.settings
        dark = np.minimum(np.median(steps[..., 0], axis=1), 0.0)[:, None]
        spread = [np.hypot(s.shade_slack * dark, s.least_spread[0]), *2 * [s.least_spread[1] - s.shade_chroma * dark]]
        apart = (steps - np.stack([dark, 0 * dark, 0 * dark], axis=-1)) / np.stack(spread, axis=-1)
        own = odds[_bins(steps)]
        own = np.where(own > 0, own * (1 - np.exp(-0.5 * (apart**2).sum(axis=-1))), own)
        return np.asarray(s.support / NORMALS * weights * own.sum(axis=1) - np.log(len(self._places) / SIDE**2))


def _steps(look: Array, pairs: Floats) -> Array:
    """Features inside less those outside (M, NORMALS, 3)."""
    values = sampled(look, pairs.reshape(-1, 2)).reshape(*pairs.shape[:3], 3)
    return np.asarray(values[:, :, 0] - values[:, :, 1])


def _bins(steps: Array) -> NDArray[np.intp]:
    return np.asarray(np.minimum(np.linalg.norm(steps * STRETCH, axis=-1) / BIN, BINS - 1), dtype=np.intp)
