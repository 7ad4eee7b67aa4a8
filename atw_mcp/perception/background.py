"""Model of the fixed background of a scene and of its lighting.

A temporal median alone keeps objects that never move. The background here is the median where it agrees with
a smooth surface fitted robustly over the whole image (an empty floor), the surface itself where a compact
region stands out of it (an object at rest). In scenes whose background is textured an object at rest is known by a
colour that occurs nowhere else, and the background under it is inpainted.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.still_colours import rare_colour_regions
from atw_mcp.perception.video import Frames

Array32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

MIN_CONTRAST = 10.0  # grey levels: a step that neither codec noise nor vignetting makes
MAX_STILL_AREA = 0.15  # of the image: larger regions are parts of the background
MIN_STILL_AREA = 40  # pixels: smaller regions of a rare colour are specks
LUMINANCE = np.array([0.114, 0.587, 0.299], dtype=np.float32)  # of BGR levels, as cv2.cvtColor weighs them
SAMPLES = 28  # frames looked at for the median


@dataclass(frozen=True)
class Background:
    """The fixed background.

    image (H, W, 3) float32, BGR levels; noise (3,) standard deviation of a pixel over time [levels];
    still (H, W): pixels taken from the smooth surface because an object that does not move covers them;
    smooth: whether the background is a smooth surface at all; texture: its robust residual [levels].
    """

    image: Array32
    noise: Array32
    still: Mask
    smooth: bool
    texture: float

    @property
    def white(self) -> float:
        """Luminance of the bright part of the background [levels], by which brightness is judged."""
        return float(np.percentile(self.image @ LUMINANCE, 80))

    def relit(self, frame: Frames) -> Array32:
        """Return the background under the lighting of `frame`: a gain per channel, linear over the image."""
        gain = _lighting(frame.astype(np.float32), self.image)
        lit: Array32 = self.image * gain
        return lit


def sample_rows(count: int) -> NDArray[np.int64]:
    """Rows of `count` frames that medians over time are taken of: evenly spaced, at most SAMPLES."""
    rows: NDArray[np.int64] = np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).round().astype(np.int64))
    return rows


def model_background(frames: Frames) -> Background:
    """Background of frames (T, H, W, 3) taken by a camera that does not move."""
    sample = frames[sample_rows(len(frames))].astype(np.float32)
    median = np.median(sample, axis=0).astype(np.float32)
    for k in range(len(sample)):  # take flicker and slow changes of light out before the final median
        sample[k] /= np.clip(_lighting(sample[k], median), 0.2, 5.0)
    median = np.median(sample, axis=0).astype(np.float32)
    noise = _temporal_noise(sample)
    surface = _smooth_surface(median)
    residual = np.abs(median - surface).max(axis=2)
    texture = float(np.median(residual)) * 1.4826
    smooth = texture < 4.0
    still = _still_objects(median - surface, residual, texture) if smooth else np.zeros(median.shape[:2], bool)
    image = median.copy()
    # A pixel may show an object in most of the sampled frames and the floor in the others.
    if smooth:
        away = residual > max(MIN_CONTRAST, 4 * texture)
        image = _best_sample(sample, median, surface, away)
        rest = np.abs(image - surface).max(axis=2)
        uncovered = rest < np.maximum(0.35 * residual, MIN_CONTRAST)
        still &= ~(uncovered & away)
        grown = cv2.dilate(still.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9))) > 0
        image[grown] = surface[grown]
    else:
        image = _uncovered(sample, median)
        still = rare_colour_regions(image, MIN_STILL_AREA)
        covered = cv2.dilate(still.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7)))
        image = cv2.inpaint(np.clip(image, 0, 255).astype(np.uint8), covered, 5, cv2.INPAINT_TELEA).astype(np.float32)
    return Background(image=image.astype(np.float32), noise=noise, still=still, smooth=smooth, texture=texture)


def _lighting(frame: Array32, reference: Array32) -> Array32:
    """Gain (H, W, 3) that turns `reference` into `frame`: a + b x + c y per channel, by robust regression."""
    height, width = frame.shape[:2]
    step = max(1, int(np.sqrt(height * width / 2500)))
    seen, expected = frame[::step, ::step].reshape(-1, 3), reference[::step, ::step].reshape(-1, 3)
    y, x = np.mgrid[0:height:step, 0:width:step].astype(np.float32)
    design = np.stack([np.ones(x.size), x.ravel() / width - 0.5, y.ravel() / height - 0.5], axis=1)
    bright = expected.min(axis=1) > 12
    gain = np.ones((height, width, 3), dtype=np.float32)
    if bright.sum() < 50:
        return gain
    rows = design[bright]
    ratio = (seen[bright] + 4.0) / (expected[bright] + 4.0)
    across, down = (np.arange(width) / width - 0.5)[None, :], (np.arange(height) / height - 0.5)[:, None]
    for channel in range(3):
        values = ratio[:, channel]
        coefficients = np.array([float(np.median(values)), 0.0, 0.0])
        for _ in range(3):
            error = values - rows @ coefficients
            scale = max(1.4826 * float(np.median(np.abs(error))), 0.004)
            weight = np.where(np.abs(error) < 3 * scale, (1 - (error / (3 * scale)) ** 2) ** 2, 0.0)
            weighted = rows * weight[:, None]
            coefficients = np.linalg.solve(weighted.T @ rows + np.diag([1e-6, 1.0, 1.0]), weighted.T @ values)
        gain[..., channel] = coefficients[0] + coefficients[1] * across + coefficients[2] * down
    return gain


def _temporal_noise(sample: Array32) -> Array32:
    if len(sample) < 3:
        return np.full(3, 2.0, dtype=np.float32)
    steps = np.abs(np.diff(sample[:, ::4, ::4], axis=0)).reshape(-1, 3)
    noise: Array32 = np.maximum(1.4826 * np.median(steps, axis=0) / np.sqrt(2), 1.0).astype(np.float32)
    return noise


def _smooth_surface(image: Array32) -> Array32:
    """Fit a polynomial of degree 4 per channel with Tukey weights, then a smooth local correction."""
    height, width = image.shape[:2]
    step = max(1, int(np.sqrt(height * width / 6000)))
    y, x = np.mgrid[0:height:step, 0:width:step]
    design = _monomials(x.ravel() / width, y.ravel() / height)
    values = image[::step, ::step].reshape(-1, 3).astype(float)
    weight = np.ones(len(values))
    coefficients = np.zeros((design.shape[1], 3))
    for _ in range(12):
        weighted = design * weight[:, None]
        coefficients = np.linalg.solve(weighted.T @ design + 1e-6 * np.eye(design.shape[1]), weighted.T @ values)
        error = np.abs(values - design @ coefficients).max(axis=1)
        scale = max(1.4826 * float(np.median(error)), 1.0)
        weight = np.where(error < 4 * scale, (1 - (error / (4 * scale)) ** 2) ** 2, 0.0)
    ys, xs = np.mgrid[0:height, 0:width]
    full = _monomials(xs.ravel() / width, ys.ravel() / height)
    surface = (full @ coefficients).reshape(height, width, 3).astype(np.float32)
    error_image = image - surface
    scale = max(1.4826 * float(np.median(np.abs(error_image).max(axis=2))), 1.0)
    trusted = (np.abs(error_image).max(axis=2) < 3 * scale).astype(np.float32)
    sigma = max(height, width) / 24
    total = cv2.GaussianBlur(trusted, (0, 0), sigma)
    for channel in range(3):
        correction = cv2.GaussianBlur(error_image[..., channel] * trusted, (0, 0), sigma) / (total + 0.02)
        surface[..., channel] += correction
    return surface


def _monomials(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    u, v = 2 * x - 1, 2 * y - 1
    return np.stack([u**i * v**j for i in range(5) for j in range(5 - i)], axis=1)


def _still_objects(difference: Array32, residual: Array32, texture: float) -> Mask:
    """Compact regions of the median that stand out of the surface and have a sharp edge somewhere."""
    threshold = max(MIN_CONTRAST, 5 * texture)
    standing_out = (residual > threshold).astype(np.uint8)
    high = cv2.morphologyEx(standing_out, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(high, connectivity=8)
    height, width = residual.shape
    keep = np.zeros((height, width), dtype=bool)
    soft = cv2.GaussianBlur(difference, (0, 0), 0.8)
    gradient = np.hypot(
        np.abs(cv2.Sobel(soft, cv2.CV_32F, 1, 0, scale=0.125)).max(axis=2),
        np.abs(cv2.Sobel(soft, cv2.CV_32F, 0, 1, scale=0.125)).max(axis=2),
    )
    for label in range(1, count):
        left, top, wide, tall, area = (int(v) for v in stats[label])
        if area > MAX_STILL_AREA * height * width or area < 20:
            continue
        region = labels[top : top + tall, left : left + wide] == label
        along_border = (
            (left == 0) * tall + (top == 0) * wide + (left + wide == width) * tall + (top + tall == height) * wide
        )
        if along_border > 0.6 * (height + width) / 2:
            continue
        # Shadows come along: replaced by the bare surface they are seen again as shadows, frame by frame.
        # Vignettes and pools of light do not: they have no edge.
        height_above = np.percentile(residual[top : top + tall, left : left + wide][region], 75)
        edge = np.percentile(gradient[top : top + tall, left : left + wide][region], 90)
        if height_above > 1.3 * threshold and edge > 0.15 * height_above:
            keep[top : top + tall, left : left + wide] |= region
    return keep


def _best_sample(sample: Array32, median: Array32, surface: Array32, away: Mask) -> Array32:
    """Return where the median is far from the surface, the mean of the frames nearest to it, if any are near."""
    image = median.copy()
    rows, columns = np.nonzero(away)
    if len(rows) == 0 or len(sample) < 5:
        return image
    values = sample[:, rows, columns]
    distance = np.abs(values - surface[rows, columns]).max(axis=2)
    nearest = np.sort(distance, axis=0)[: max(3, len(sample) // 12)]
    near = distance <= nearest[-1]
    picked = (values * near[..., None]).sum(axis=0) / near.sum(axis=0)[:, None]
    closer = np.abs(picked - surface[rows, columns]).max(axis=1) < 0.5 * np.abs(
        median[rows, columns] - surface[rows, columns]
    ).max(axis=1)
    image[rows[closer], columns[closer]] = picked[closer]
    return image


def _uncovered(sample: Array32, median: Array32) -> Array32:
    """In a textured scene: where a pixel has two lasting values, the one that continues its surroundings.

    An object that rests for most of the clip and then leaves makes a region of the median differ from the
    frames without it; its rim is then a step in the median and none in those frames.
    """
    if len(sample) < 8:
        return median
    late, early = np.median(sample[-len(sample) // 4 :], axis=0), np.median(sample[: len(sample) // 4], axis=0)
    image = median.copy()
    for other in (early, late):
        changed = (np.abs(other - median).max(axis=2) > 2 * MIN_CONTRAST).astype(np.uint8)
        changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(changed, connectivity=8)
        for label in range(1, count):
            area = int(stats[label, cv2.CC_STAT_AREA])
            if area < 30 or area > MAX_STILL_AREA * changed.size:
                continue
            region = labels == label
            rim = region ^ (cv2.erode(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
            outside = (cv2.dilate(region.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0) & ~region
            around = np.median(median[outside], axis=0)
            step_median = np.abs(np.median(median[rim], axis=0) - around).max()
            step_other = np.abs(np.median(other[rim], axis=0) - around).max()
            if step_other < 0.5 * step_median:
                image[region] = other[region]
    return image
