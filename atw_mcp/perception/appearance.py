"""Colour distributions of objects, by which pixels and regions are assigned to one of them."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.video import Frames

Bins = NDArray[np.uint16]
Histogram = NDArray[np.float64]

LIGHTNESS_BINS = 14
CHROMA_BINS = 22
BIN_COUNT = LIGHTNESS_BINS * CHROMA_BINS * CHROMA_BINS
_CHROMA_WIDTH = 6.0  # CIELAB units
_FLOOR = 0.02  # share of any colour at all: highlights and reflections of neighbours


def colour_bins(image: Frames) -> Bins:
    """Bin number of each pixel's CIELAB colour, shape image.shape[:2]."""
    wide = image.astype(np.uint32) >> 2
    bins: Bins = _table()[(wide[..., 0] << 12) | (wide[..., 1] << 6) | wide[..., 2]]
    return bins


@lru_cache(maxsize=1)
def _table() -> Bins:
    """Bins of all colours, at six bits a channel: far finer than the bins, and far quicker than converting."""
    colours = _quantised().reshape(512, 512, 3)
    lab = cv2.cvtColor(colours, cv2.COLOR_BGR2Lab)
    lightness = np.clip(lab[..., 0] * (LIGHTNESS_BINS / 100.0), 0, LIGHTNESS_BINS - 1).astype(np.int32)
    half = CHROMA_BINS / 2
    chroma = np.clip(np.floor(lab[..., 1:] / _CHROMA_WIDTH + half), 0, CHROMA_BINS - 1).astype(np.int32)
    bins: Bins = ((lightness * CHROMA_BINS + chroma[..., 0]) * CHROMA_BINS + chroma[..., 1]).astype(np.uint16)
    return bins.ravel()


def _quantised() -> NDArray[np.float32]:
    """All colours b, g, r in 0..1 at six bits a channel, shape (64, 64, 64, 3)."""
    level = (np.arange(64, dtype=np.float32) * 4 + 1.5) / 255.0
    return np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1)


@lru_cache(maxsize=1)
def bin_colours() -> NDArray[np.float64]:
    """Mean colour r, g, b in 0..1 of each bin, shape (BIN_COUNT, 3); NaN where no colour falls into it."""
    colours = _quantised().reshape(-1, 3)[:, ::-1].astype(np.float64)
    bins = _table()
    counts = np.bincount(bins, minlength=BIN_COUNT)
    with np.errstate(invalid="ignore"):
        means = [np.bincount(bins, weights=colours[:, c], minlength=BIN_COUNT) / counts for c in range(3)]
    return np.stack(means, axis=1)


def histogram(bins: Bins) -> Histogram:
    """Counts of bins, spread to neighbouring bins so that a small sample stands for its like; shape (BIN_COUNT,)."""
    counts = np.bincount(bins.ravel(), minlength=BIN_COUNT).astype(np.float64)
    grid = counts.reshape(LIGHTNESS_BINS, CHROMA_BINS, CHROMA_BINS)
    for axis in range(3):
        padded = np.pad(grid, [(1, 1) if a == axis else (0, 0) for a in range(3)])
        n = grid.shape[axis]
        lower, upper = np.take(padded, range(n), axis=axis), np.take(padded, range(2, n + 2), axis=axis)
        grid = 0.5 * grid + 0.25 * (lower + upper)
    return grid.ravel()


def log_likelihood(counts: Histogram) -> NDArray[np.float64]:
    """Logarithm of the probability of each bin under a histogram of counts, relative to a uniform colour."""
    share = counts / max(float(counts.sum()), 1e-9)
    # Relative to what a typical foreground occupies (a few hundred bins), so that 0 means "as good as any".
    result: NDArray[np.float64] = np.log((1 - _FLOOR) * share * 300.0 + _FLOOR)
    return result


def similarity(a: Histogram, b: Histogram) -> float:
    """Bhattacharyya coefficient of two histograms: 1 equal, 0 disjoint."""
    total = float(a.sum()) * float(b.sum())
    return float(np.sqrt(a * b).sum() / np.sqrt(total)) if total > 0 else 0.0
