"""Masks: the pixels of a body of unknown or changing shape, by the same likelihood, smooth in space."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Array, Floats, Mask, filled

NEIGHBOURS = np.array([[0.7, 1.0, 0.7], [1.0, 0.0, 1.0], [0.7, 1.0, 0.7]], np.float32) / 6.8  # by inverse distance


@dataclass(frozen=True)
class BodyMask:
    """Pixels of a body in a frame: first pixel (u, v) of a window, probabilities (h, w), and the mask (h, w)."""

    corner: tuple[int, int]
    probability: Array
    mask: Mask

    def centre(self) -> Floats:
        """Mean place (2,) of the mask's pixels, weighted by their probabilities [px]; NaN of an empty mask."""
        weight = np.where(self.mask, self.probability, 0.0)
        if not weight.sum():
            return np.full(2, np.nan)
        v, u = np.indices(weight.shape)
        middle = np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()
        return np.asarray(middle + self.corner)

    def outline(self) -> Floats:
        """Polygon (V, 2) around the mask [px]; empty of an empty mask."""
        found = cv2.findContours(self.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        if not found:
            return np.zeros((0, 2))
        return np.asarray(max(found, key=cv2.contourArea)[:, 0] + np.array(self.corner), dtype=float)


def body_mask(scene: Scene, body: int, frame: int, margin: float = 0.5) -> BodyMask:
    """Segment a body within `margin` [radii] of its silhouette in a frame, by mean field of a Potts model.

    Each pixel's log odds are those of the scene; unlike neighbours pay `smooth`. Of the parts, those that touch the
    silhouette are the body's. Raises ValueError where the body has no pose.
    """
    pose = scene.poses[body, frame]
    if not np.isfinite(pose[0]):
        raise ValueError(f"{scene.bodies[body].name} is not seen in frame {frame}")
    shape = scene.bodies[body]
    corner, size = scene.window(body, pose, margin * shape.radius(pose) + 2)
    if min(size) < 3:
        return BodyMask(corner, np.zeros(size[::-1], np.float32), np.zeros(size[::-1], bool))
    u, v = np.meshgrid(np.arange(size[0]) + corner[0], np.arange(size[1]) + corner[1])
    odds, free = scene.log_odds(body, frame, pose, np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    odds = np.where(free, odds, -scene.settings.decided).reshape(u.shape).astype(np.float32)
    probability = _sigmoid(odds)
    while True:
        around = cv2.filter2D(2 * probability - 1, -1, NEIGHBOURS, borderType=cv2.BORDER_REPLICATE)
        after = 0.5 * (probability + _sigmoid(odds + np.float32(2 * scene.settings.smooth) * around))
        change = float(np.abs(after - probability).max())
        probability = after
        if change < 0.01:  # of a probability: the mask is decided at a half
            break
    _, parts = cv2.connectedComponents((probability > 0.5).astype(np.uint8), connectivity=4)
    own = np.unique(parts[filled(shape.polygon(pose), corner, size)])
    mask = np.isin(parts, own[own > 0])
    rows, columns = slice(corner[1], corner[1] + size[1]), slice(corner[0], corner[0] + size[0])
    levels = scene.film.frames[frame, rows, columns].astype(np.float32)
    mask = at_half_light(levels, mask, free.reshape(mask.shape), scene.settings.mixed_near)
    return BodyMask(corner, probability, mask)


def at_half_light(levels: Array, mask: Mask, free: Mask, near: float) -> Mask:
    """Mask (h, w) whose rim is where levels (h, w, 3) are nearer to those well inside than to those well outside.

    Pixels on an edge are mixtures, which pure colours take for the side whose colours vary more. near: [px] within
    which they are mixed. Pixels that are not free, and rims with nothing pure on either side, stay as they are.
    """
    size = 2 * int(np.ceil(near)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    own = mask.astype(np.uint8)
    inside, outside = cv2.erode(own, disc) > 0, (cv2.dilate(own, disc) == 0) & free
    rim = free & ~inside & (cv2.dilate(own, disc) > 0)
    means, weights = [], []
    for side in (inside, outside):
        weight = cv2.GaussianBlur(side.astype(np.float32), (0, 0), near)
        total = cv2.GaussianBlur(np.where(side[..., None], levels, np.float32(0)), (0, 0), near)
        means.append(total / np.maximum(weight, 1e-6)[..., None])
        weights.append(weight)
    apart = [((levels - mean) ** 2).sum(axis=-1) for mean in means]
    decided = rim & (np.minimum(*weights) > 1e-3)
    return np.asarray(np.where(decided, apart[0] < apart[1], mask))


def _sigmoid(odds: Array) -> Array:
    return np.asarray(1 / (1 + np.exp(-odds)), dtype=np.float32)
