"""Log-likelihood ratios of a pixel: an object's against the background's or a shadow's.

The background is known up to noise; a cast shadow is the background made darker by a factor, with its hue; the object
is known by the colours of its seeds. What is neither is taken for the object with some reserve, so that highlights and
blurred rims count a little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from atw_mcp.perception.background import Array32, Mask
from atw_mcp.perception.scene_models import SceneModels
from atw_mcp.perception.video import Frames

View = tuple[slice, slice]

LIGHT_BINS, TONE_BINS = 64, 24
LIGHT_WIDTH, TONE_WIDTH = 4, 6  # levels of luminance and chroma a bin
CELL = LIGHT_WIDTH * TONE_WIDTH**2  # levels cubed
ANY_OBJECT = 3e-5  # probability per bin that the object shows a colour its seeds do not
ANY_GROUND = 1e-5  # the same of the background
BESIDE = 0.3  # share of what surrounds an object that looks as its surroundings did where it was given
SHADOW_PRIOR = 0.3  # share of background near an object that is in shadow
SOFTEST = 0.72  # factor down to which there may be soft shadows where no factor is known
NEAR_FACTOR = 0.03  # standard deviation of the factor of shadows
STRONGEST = 4.0  # bound of a log-likelihood ratio


@dataclass(frozen=True)
class Look:
    """Colours of an object and of what is beside it where it is given: its shadow, its reflection, bodies it touches.

    log_share (bins,): logarithm of the probability of each colour bin; beside (bins,): probability of each colour bin
    in the surroundings.
    """

    log_share: Array32
    beside: Array32

    @classmethod
    def of(cls, ycc: Frames, rows: Sequence[int], masks: Sequence[Mask]) -> Look:
        """Return the colours under masks (h, w), and around them, in rows of a clip (T, h, w, 3)."""
        own, around = np.zeros(LIGHT_BINS * TONE_BINS**2), np.zeros(LIGHT_BINS * TONE_BINS**2)
        for row, mask in zip(rows, masks, strict=True):
            byte = mask.astype(np.uint8)
            inner = cv2.erode(byte, np.ones((3, 3), np.uint8), borderValue=1) > 0
            own += _counted(ycc[row], inner if inner.sum() > 40 else mask)
            wide = 2 * max(round(0.35 * float(np.sqrt(mask.sum()))), 4) + 1
            near, far = np.ones((5, 5), np.uint8), np.ones((wide, wide), np.uint8)
            around += _counted(ycc[row], (cv2.dilate(byte, far) > 0) & (cv2.dilate(byte, near) == 0))
        share, beside = _spread(own) / max(len(rows), 1), _spread(around) / max(len(rows), 1)
        return cls(np.log(0.95 * share + ANY_OBJECT).astype(np.float32), (BESIDE * beside).astype(np.float32))


def bins_of(ycc: Frames) -> NDArray[np.int32]:
    """Number of the colour bin of each pixel of an image (h, w, 3)."""
    tone = np.clip((np.arange(256) - 128 + TONE_WIDTH // 2) // TONE_WIDTH + TONE_BINS // 2, 0, TONE_BINS - 1)
    table = tone.astype(np.int32)
    light = (ycc[..., 0] // LIGHT_WIDTH).astype(np.int32)
    found: NDArray[np.int32] = (light * TONE_BINS + table[ycc[..., 1]]) * TONE_BINS + table[ycc[..., 2]]
    return found


def _counted(image: Frames, where: Mask) -> NDArray[np.float64]:
    """Share (bins,) of each colour bin in the chosen pixels of an image."""
    values = np.bincount(bins_of(image[where][None])[0], minlength=LIGHT_BINS * TONE_BINS**2)
    return values / max(int(values.sum()), 1)


def _spread(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares (bins,) given to neighbouring bins too: shading changes luminance widely, hue little."""
    counts = shares.reshape(LIGHT_BINS, TONE_BINS, TONE_BINS)
    narrow = convolve1d(counts, np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0, axis=0, mode="constant")
    wide = convolve1d(counts, np.ones(13) / 13.0, axis=0, mode="constant")
    light = 0.85 * narrow + 0.15 * wide
    tone = np.array([0.2, 0.6, 0.2])
    return np.asarray(
        convolve1d(convolve1d(light, tone, axis=1, mode="constant"), tone, axis=2, mode="constant")
    ).ravel()


class PixelEvidence:
    """Evidence of pixels in windows of the frames of a clip."""

    def __init__(self, models: SceneModels) -> None:
        self.models = models
        steps = np.arange(0.0, 2.0, 0.005)
        if models.shadow is None:
            weight = np.where((steps > SOFTEST) & (steps < 1.0), 1.0 / (1.0 - SOFTEST), 0.0)
        else:
            darkest = 0.95 * models.shadow
            weight = np.where((steps > darkest) & (steps < 1.0), 0.4 / (1.0 - darkest), 0.0)
            bell = np.exp(-0.5 * ((steps - models.shadow) / NEAR_FACTOR) ** 2)
            weight += 0.6 * bell / (NEAR_FACTOR * np.sqrt(2 * np.pi))
        self._shade = weight.astype(np.float32)

    def ratio(self, look: Look, row: int, view: View) -> Array32:
        """Log-likelihood ratio (h, w) of an object with this look to the background, in a window of a row."""
        bins = bins_of(self.models.ycc[row][view])
        beside = np.logaddexp(self.ground(row, view), np.log(look.beside[bins] + 1e-12))
        found = look.log_share[bins] - beside
        return np.asarray(np.clip(found, -STRONGEST, STRONGEST), dtype=np.float32)

    def apart(self, row: int, view: View) -> Array32:
        """Log-likelihood ratio (h, w) of anything at all to the background and its shadows, in a window of a row."""
        found = np.log(1e-3) - self.ground(row, view)
        return np.asarray(np.clip(found, -STRONGEST, STRONGEST), dtype=np.float32)

    def ground(self, row: int, view: View) -> Array32:
        """Log-probability (h, w) of a window's pixels to be background or shadow on it, per colour bin."""
        image = self.models.ycc[row][view].astype(np.float32)
        ground, sigma = self.models.background[view], self.models.sigma[view]
        light, tone = sigma[..., 0], sigma[..., 1]
        off = image - ground
        plain = (off[..., 0] / light) ** 2 + (off[..., 1] ** 2 + off[..., 2] ** 2) / tone**2
        share = (image[..., 0] + 4.0) / (ground[..., 0] + 4.0)
        shaded = image[..., 1:] - 128.0 - (ground[..., 1:] - 128.0) * share[..., None]
        dim = (shaded[..., 0] ** 2 + shaded[..., 1] ** 2) / tone**2
        weight = self._shade[np.minimum((share * 200.0).astype(np.int32), len(self._shade) - 1)]
        flat = CELL / (2 * np.pi * tone**2)
        lit = flat / (np.sqrt(2 * np.pi) * light) * np.exp(-0.5 * np.minimum(plain, 60.0))
        dark = flat * weight / (ground[..., 0] + 4.0) * np.exp(-0.5 * np.minimum(dim, 60.0))
        total = (1.0 - SHADOW_PRIOR) * lit + SHADOW_PRIOR * dark + ANY_GROUND
        return np.asarray(np.log(total), dtype=np.float32)
