"""Pixels: features of a film at any place, and the background that is learned over the clip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.settings import EyeSettings

Array = NDArray[np.float32]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]


def features(levels: Array, settings: EyeSettings) -> Array:
    """Features (..., 3) of BGR levels (..., 3): log brightness, log red over green, log blue over green.

    Light and shadow displace the first alone.
    """
    logs = np.log(levels + np.float32(settings.dark_level), dtype=np.float32)
    green = logs[..., 1]
    brightness = (logs[..., 0] + green + logs[..., 2]) * np.float32(1 / 3)
    return np.stack([brightness, logs[..., 2] - green, logs[..., 0] - green], axis=-1)


def sampled(image: NDArray[np.float32] | NDArray[np.uint8], points: Floats) -> Array:
    """Values (M, C) of an image (H, W, C) at points (M, 2) [px], bilinear; the border's value outside."""
    places = points.astype(np.float32).reshape(1, -1, 2) if len(points) < 32000 else _rows(points)
    values = cv2.remap(image, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    channels = 1 if image.ndim == 2 else image.shape[2]
    return np.asarray(values, dtype=np.float32).reshape(-1, channels)[: len(points)]


def _rows(points: Floats) -> Array:
    """Points (M, 2) in rows of 16384, padded: cv2.remap takes no longer ones."""
    padded = np.zeros((-(-len(points) // 16384) * 16384, 2), np.float32)
    padded[: len(points)] = points
    return padded.reshape(-1, 16384, 2)


def evenly_lit(frames: Bytes) -> Bytes:
    """Frames (T, H, W, 3) without changes of exposure: levels scaled so that the median pixel keeps its own."""
    sample = frames[:, ::8, ::8].reshape(len(frames), -1, 3).astype(np.float32)
    usual = np.median(sample, axis=0)
    seen = ((usual > 12) & (usual < 245)).all(axis=1)  # neither black nor clipped
    if not seen.any():
        return frames
    gain = np.median(usual[seen] / np.maximum(sample[:, seen], 1.0), axis=1)
    if np.abs(gain - 1).max() < 0.02:
        return frames
    levels = np.arange(256, dtype=np.float32)[:, None]
    tables = [np.clip(np.round(levels * g), 0, 255).astype(np.uint8)[None] for g in gain]
    return np.stack([cv2.LUT(frame, table) for frame, table in zip(frames, tables, strict=True)])


def filled(polygon: Floats, corner: tuple[int, int], size: tuple[int, int]) -> Mask:
    """Pixels (h, w) inside a polygon (V, 2) [px], of a window whose first pixel is `corner` (u, v); size (w, h)."""
    mask = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillPoly(mask, [np.round((polygon - corner) * 16).astype(np.int32)], 1, shift=4)
    return mask.astype(bool)


class Film:
    """Frames (T, H, W, 3) of BGR bytes from a camera that stands still."""

    def __init__(self, frames: Bytes, settings: EyeSettings) -> None:
        self.frames, self.settings = frames, settings
        self.count, self.height, self.width = frames.shape[:3]

    def at(self, frame: int, points: Floats) -> Array:
        """Features (M, 3) of a frame at points (M, 2) [px]."""
        return features(sampled(self.frames[frame], points), self.settings)

    def inside(self, points: Floats) -> Mask:
        """Whether points (M, 2) lie in the picture, half a pixel around the outermost centres included."""
        u, v = points[:, 0], points[:, 1]
        return np.asarray((u > -0.5) & (v > -0.5) & (u < self.width - 0.5) & (v < self.height - 0.5))

    def chosen(self) -> NDArray[np.intp]:
        """Frames from which the background is learned, at equal distances."""
        count = min(self.count, self.settings.background_frames)
        return np.unique(np.linspace(0, self.count - 1, count).astype(int))

    def nothing(self) -> Mask:
        """Pixels (S, H, W) of the chosen frames, none of them covered."""
        return np.zeros((len(self.chosen()), self.height, self.width), bool)

    @cached_property
    def sample(self) -> Bytes:
        """The chosen frames."""
        return self.frames[self.chosen()]

    @cached_property
    def middle(self) -> Array:
        """Levels (H, W, 3) of the median of the chosen frames, whatever they show."""
        middle = np.empty(self.frames.shape[1:], np.float32)
        for row in range(0, self.height, 64):  # in strips, for the sake of memory
            strip = np.s_[row : row + 64]
            half = np.partition(self.sample[:, strip], len(self.sample) // 2, axis=0)[len(self.sample) // 2]
            middle[strip] = _averaged(self.sample[:, strip], half.astype(np.float32))
        return middle


@dataclass(frozen=True)
class Background:
    """Features (H, W, 3), what they change by where edges are displaced (H, W, 3), and their noise (3,)."""

    feature: Array
    edges: Array
    noise: Array

    def at(self, points: Floats) -> tuple[Array, Array]:
        """Features (M, 3) and their standard deviations (M, 3) at points (M, 2) [px]."""
        spread = np.sqrt(sampled(self.edges, points) ** 2 + self.noise**2)
        return sampled(self.feature, points), spread


def learn_background(film: Film, covered: NDArray[np.bool_]) -> Background:
    """Median over sampled frames of what no body covers; pixels always covered are filled from around them.

    covered (S, H, W): whether a pixel of a chosen frame is, or may be, a body's.
    """
    settings, frames = film.settings, film.sample
    middle = film.middle.copy()
    rows, columns = np.nonzero(covered.any(axis=0))
    hole = np.zeros(middle.shape[:2], bool)
    if len(rows):
        values = frames[:, rows, columns].astype(np.int16)
        hidden = covered[:, rows, columns]
        values[hidden] = 999
        values.sort(axis=0)
        count = len(frames) - hidden.sum(axis=0)
        pick = np.maximum(count // 2, 0)
        below = np.maximum((count - 1) // 2, 0)
        index = np.arange(len(rows))
        middle[rows, columns] = 0.5 * (values[pick, index] + values[below, index])
        hole[rows, columns] = count == 0
    feature = features(middle, settings)
    if hole.any():
        around = cv2.dilate(hole.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0
        feature = np.stack([diffused(feature[..., c], around) for c in range(3)], axis=-1)
    noise = np.maximum(_noise(film, frames, feature, covered), settings.noise_floor).astype(np.float32)
    return Background(feature, displaced_edges(feature, settings), noise)


def displaced_edges(feature: Array, settings: EyeSettings) -> Array:
    """Change (H, W, 3) of features (H, W, 3) where edges are displaced by as much as they may be."""
    slopes = [
        np.hypot(cv2.Sobel(f, -1, 1, 0, scale=0.125), cv2.Sobel(f, -1, 0, 1, scale=0.125)) for f in cv2.split(feature)
    ]
    return np.asarray(np.stack(slopes, axis=-1) * settings.sharp, dtype=np.float32)


def _averaged(frames: Bytes, middle: Array) -> Array:
    """Mean of levels within 4 of the median: finer than whole levels."""
    total, count = np.zeros_like(middle), np.zeros_like(middle)
    for frame in frames:
        apart = frame - middle
        near = np.abs(apart) <= 4.0
        total += np.where(near, apart, np.float32(0))
        count += near
    return np.asarray(middle + total / np.maximum(count, 1), dtype=np.float32)


def _noise(film: Film, frames: Bytes, feature: Array, covered: NDArray[np.bool_]) -> Floats:
    """Standard deviation (3,) of a background pixel's features over time, from every 37th pixel."""
    flat = feature.reshape(-1, 3)[::37]
    values = features(frames.reshape(len(frames), -1, 3)[:, ::37].astype(np.float32), film.settings) - flat
    keep = ~covered.reshape(len(frames), -1)[:, ::37]
    return np.asarray(1.48 * np.median(np.abs(values[keep]), axis=0)) if keep.any() else np.zeros(3)


def diffused(values: Array, known: Mask) -> Array:
    """Values (H, W) where known, elsewhere filled smoothly from around, coarse to fine (pull-push)."""
    if known.all() or min(values.shape) < 4:
        return np.where(known, values, values[known].mean() if known.any() else np.float32(0)).astype(np.float32)
    half = ((values.shape[1] + 1) // 2, (values.shape[0] + 1) // 2)
    weight = known.astype(np.float32)
    share = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)
    total = cv2.resize(np.where(known, values, 0).astype(np.float32), half, interpolation=cv2.INTER_AREA)
    coarse = diffused(np.where(share > 0, total / np.maximum(share, 1e-6), 0).astype(np.float32), share > 0)
    fine = cv2.resize(coarse, values.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.where(known, values, cv2.GaussianBlur(fine, (0, 0), 1.0)).astype(np.float32)
