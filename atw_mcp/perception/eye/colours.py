"""Colours: a mixture of a body's own colours whose shares depend smoothly on the place on the body."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.settings import EyeSettings

Array = NDArray[np.float32]
Floats = NDArray[np.float64]

STRETCH = np.array([1.0, 3.0, 3.0], dtype=np.float32)  # chroma varies less than brightness: equal weight in clusters


@dataclass(frozen=True)
class Colours:
    """Gaussian colours: means (K, 3), standard deviations (K, 3), log shares by cell of the body (G, G, K)."""

    means: Array
    spreads: Array
    shares: Array

    def log_density(self, values: Array, local: Floats | None = None) -> Array:
        """Log density (M,) of features (M, 3) at places (M, 2) on the body (-1..1); anywhere on it without."""
        if local is None:
            shares = np.log(np.exp(self.shares).mean(axis=(0, 1)))[:, None]
        else:
            cells = len(self.shares)
            index = np.clip((local + 1) * (0.5 * cells), 0, cells - 1).astype(int)
            shares = self.shares[index[:, 1], index[:, 0]].T
        logs = shares - np.log(self.spreads).sum(axis=-1)[:, None] - np.float32(2.757)
        for channel in range(3):
            apart = (values[:, channel] - self.means[:, channel, None]) / self.spreads[:, channel, None]
            logs = logs - np.float32(0.5) * apart * apart
        top = logs.max(axis=0)
        return np.asarray(top + np.log(np.exp(logs - top).sum(axis=0)))


def learn_colours(values: Array, local: Floats, settings: EyeSettings) -> Colours | None:
    """Mixture of features (M, 3) seen at places (M, 2) on a body, -1..1; None of fewer pixels than can be learned."""
    if len(values) < settings.least_pixels:
        return None
    random = np.random.default_rng(0)
    keep = random.permutation(len(values))[: settings.sampled_pixels]
    values, local = values[keep].astype(np.float32), local[keep]
    count = min(settings.clusters, len(values) // 4)
    cv2.setRNGSeed(1)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
    initial = np.zeros((len(values), 1), np.int32)
    _, labels, _ = cv2.kmeans(values * STRETCH, count, initial, stop, 2, cv2.KMEANS_PP_CENTERS)
    one = np.eye(count, dtype=np.float32)[labels.ravel()]
    total = one.sum(axis=0)[:, None] + 1e-6
    means = one.T @ values / total
    spreads = np.sqrt(np.maximum(one.T @ values**2 / total - means**2, 0))
    spreads = np.maximum(spreads, np.array(settings.least_spread, np.float32))
    apart = (values[:, None] - means) / spreads
    logs = -0.5 * (apart**2).sum(-1) - np.log(spreads).sum(-1) + np.log(one.mean(axis=0) + 1e-6)
    parts = np.exp(logs - logs.max(axis=1)[:, None])
    parts /= parts.sum(axis=1)[:, None]
    cells = settings.cells
    index = np.clip((local + 1) * (0.5 * cells), 0, cells - 1).astype(int)
    counts = np.zeros((cells, cells, count), np.float32)
    np.add.at(counts, (index[:, 1], index[:, 0]), parts)
    blurred = cv2.GaussianBlur(counts, (0, 0), settings.cell_blur, borderType=cv2.BORDER_REPLICATE)
    counts = np.asarray(blurred, dtype=np.float32).reshape(cells, cells, count)
    overall = parts.mean(axis=0) + 1e-3
    overall /= overall.sum()
    prior = settings.place_prior * min(1.0, len(values) / 500.0)
    shares = (counts + prior * overall) / (counts.sum(axis=-1, keepdims=True) + prior)
    return Colours(
        means.astype(np.float32), spreads.astype(np.float32), np.log(np.maximum(shares, 1e-4)).astype(np.float32)
    )
