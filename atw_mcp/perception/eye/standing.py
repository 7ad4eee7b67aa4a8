"""Standing: bodies at rest, which differ from what lies widely around them as moving ones do from the background."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from atw_mcp.perception.eye.pixels import Array, Bytes, features
from atw_mcp.perception.eye.regions import Region, Still, regions_of, weakest_step
from atw_mcp.perception.eye.settings import EyeSettings


def standing(frames: Bytes, still: Still, settings: EyeSettings) -> list[Region]:
    """Regions of bodies at rest in the still scene of frames (T, H, W, 3), each in the frame that covers it least.

    The wide surroundings are medians over a part of the picture; their spread is the ground's own texture. Regions
    that are alike and many are a pattern of it.
    """
    image = np.clip(_levels(still.feature, settings), 0, 255).astype(np.uint8)
    found = [
        r
        for r in regions_of(image, 0, _surroundings(still, settings), settings)
        if not (r.dark or r.border)
        and r.solid > settings.hollow
        and r.area < settings.largest_standing * image.shape[0] * image.shape[1]
        and weakest_step(still.feature, r) > settings.sharp_edge
    ]
    single = [r for r in found if sum(_alike(r, other) for other in found) <= settings.pattern]
    return [replace(r, frame=_clearest(frames, still, r, settings)) for r in single]


def _surroundings(still: Still, settings: EyeSettings) -> Still:
    """Background that the wide surroundings of each pixel of a still scene lead to expect."""
    usual = _middle(still.feature, settings, 1)
    # Half of a pattern of two tones does not differ from its median: the spread is that of the most around.
    spread = 1.48 * _middle(np.abs(still.feature - usual), settings, 3)
    return Still(usual, np.maximum(spread, 2 * settings.noise_floor), still.tint)


def _middle(feature: Array, settings: EyeSettings, reach: int) -> Array:
    """Medians (H, W, 3) of features over wide surroundings, of the most within `reach` quarter pixels."""
    height, width = feature.shape[:2]
    small = cv2.resize(feature, (width // 4, height // 4), interpolation=cv2.INTER_NEAREST)
    low, high = float(small.min()), float(small.max())
    step = max(high - low, 1e-3) / 255
    levels = np.round((small - low) / step).astype(np.uint8)
    levels = np.asarray(cv2.dilate(levels, np.ones((reach, reach), np.uint8)), dtype=np.uint8)
    middle = cv2.medianBlur(levels, int(settings.surroundings * min(small.shape[:2])) | 1)
    wide = low + step * cv2.resize(middle.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide, dtype=np.float32)


def _levels(feature: Array, settings: EyeSettings) -> Array:
    """Levels (H, W, 3) of features: the inverse of `features`."""
    green = feature[..., 0] - (feature[..., 1] + feature[..., 2]) / 3
    logs = np.stack([green + feature[..., 2], green, green + feature[..., 1]], axis=-1)
    return np.asarray(np.exp(logs) - settings.dark_level, dtype=np.float32)


def _alike(one: Region, other: Region) -> bool:
    near = float(np.abs((one.look - other.look) / [0.3, 0.1, 0.1]).max()) < 1
    return near and abs(np.log(one.area / other.area)) < 1


def _clearest(frames: Bytes, still: Still, region: Region, settings: EyeSettings) -> int:
    """Frame in which a region looks most as it does in the still scene."""
    v, u = np.nonzero(region.mask) + np.array(region.corner[::-1])[:, None]
    look = still.feature[v, u]
    apart = [float(np.abs(features(f[v, u].astype(np.float32), settings) - look).mean()) for f in frames]
    return int(np.argmin(apart))
