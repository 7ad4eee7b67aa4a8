"""Models of a clip, worked out once for all corrections: frames freed of camera motion and of changes of
light, the background, its noise, and how dark shadows are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.background import Array32, Mask, model_background, sample_rows
from atw_mcp.perception.camera_motion import as_filmed, as_stabilised, camera_motion, stabilised
from atw_mcp.perception.observe import enlarged, reduced
from atw_mcp.perception.segmentation import shadows_of
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]

LEAST_NOISE = 2.0  # levels: compression alone changes pixels by that much
MISALIGNED = 0.3  # pixels by which edges of the background may be off, from shake and resampling
ALIKE = 2.5  # standard deviations within which a pixel is the background's
BAKED = 0.6  # share of a seed that looks like the background from which the background may show the object itself
AWAY = 8.0  # levels by which a pixel differs once the object has left it
GONE, LEAST_GONE = 0.9, 3  # share of an object's pixels that differ once it has left, and frames that show it
COVER = 7  # pixels: width of the disc by which a seed is grown before the background under it is filled in


@dataclass
class SceneModels:
    """A clip as seen by a camera at rest under constant light.

    full (T, H, W, 3) BGR as filmed; ycc (T, h, w, 3) luminance and chroma (YCrCb) of the frames, perhaps reduced, in
    the first frame's view and light; background (h, w, 3) likewise; sigma (h, w, 2): noise of the background's
    luminance and chroma [levels]; shadow: factor of cast shadows, None where none shows; motion (T, 2, 3) of the camera
    in reduced pixels, None where it stands still; white: luminance of the bright part of the background.
    """

    full: Frames
    ycc: Frames
    background: Array32
    sigma: Array32
    shadow: float | None
    motion: Floats | None
    white: float

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.ycc)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the working frames."""
        return self.ycc.shape[1], self.ycc.shape[2]

    def working(self, mask: Mask, row: int) -> Mask:
        """Return a mask of the filmed frame in working pixels."""
        height, width = self.size
        if mask.shape != (height, width):
            small = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
            mask = np.asarray(small) > 0.5
        return mask if self.motion is None or not mask.any() else as_stabilised(mask, self.motion[row])

    def filmed(self, mask: Mask, row: int) -> Mask:
        """Return a mask of the working frame in pixels of the filmed one."""
        if self.motion is not None and mask.any():
            mask = as_filmed(mask, self.motion[row])
        return enlarged(mask, self.full.shape[1], self.full.shape[2])

    def working_point(self, x: float, y: float, row: int) -> tuple[float, float]:
        """Return a pixel of the filmed frame in working pixels."""
        height, width = self.size
        u, v = x * width / self.full.shape[2], y * height / self.full.shape[1]
        if self.motion is not None:
            back = cv2.invertAffineTransform(self.motion[row])
            u, v = (float(c) for c in back @ np.array([u, v, 1.0]))
        return u, v

    def uncover(self, seeds: Sequence[tuple[int, Mask]]) -> None:
        """Remove objects given by masks (row, working mask) from the background where it shows them.

        What is under an object is seen in the frames in which a pixel differs from it, as long as the rest of the
        object has left too: a pixel that merely shows another part of the object is none; else the surroundings are
        continued. What the background shows of an object is known by its likeness to the object's own pixels.
        """
        picks = sample_rows(self.count)
        hidden = np.zeros(self.size, dtype=bool)
        for row, mask in seeds:
            if not mask.any() or self._standing_out(row, mask) > 1.0 - BAKED:
                continue
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (COVER, COVER))
            cover = cv2.dilate(mask.astype(np.uint8), disc) > 0
            own = self.ycc[row][mask].astype(np.float32)
            apart = np.abs(self.ycc[picks][:, mask].astype(np.float32) - own).max(axis=2)
            gone = (apart > AWAY).mean(axis=1) > GONE
            if gone.sum() >= LEAST_GONE:
                self.background[cover] = np.median(self.ycc[picks[gone]][:, cover].astype(np.float32), axis=0)
            else:
                hidden |= cover
        if hidden.any():
            image = np.clip(self.background, 0, 255).astype(np.uint8)
            filled = cv2.inpaint(image, hidden.astype(np.uint8), 5, cv2.INPAINT_TELEA)
            self.background[hidden] = np.asarray(filled, dtype=np.float32)[hidden]

    def _standing_out(self, row: int, mask: Mask) -> float:
        """Share of a mask's pixels that differ from the background by more than noise."""
        apart = np.abs(self.ycc[row][mask].astype(np.float32) - self.background[mask])
        sigma = self.sigma[mask]
        return float(((apart[:, 0] > ALIKE * sigma[:, 0]) | (apart[:, 1:].max(axis=1) > ALIKE * sigma[:, 1])).mean())


def model_scene(frames: Frames, tick: Callable[[], None] | None = None) -> SceneModels:
    """Model a clip of frames (T, H, W, 3) as `observe` does: reduced, freed of camera motion, one background.

    tick is called between steps and may raise.
    """
    step = tick or (lambda: None)
    small = reduced(frames)
    motion = camera_motion(small, tick)
    if motion is not None:
        small = stabilised(small, motion)
    step()
    background = model_background(small)
    shadow = shadows_of(small, background)
    image = background.image
    ycc = np.empty_like(small)
    for t, frame in enumerate(small):
        if t % 8 == 0:
            step()
        gain = background.relit(frame) / np.maximum(image, 1e-3)
        plain = np.clip(frame / np.clip(gain, 0.2, 5.0) + 0.5, 0, 255).astype(np.uint8)
        ycc[t] = cv2.cvtColor(plain, cv2.COLOR_BGR2YCrCb)
    ground = np.asarray(cv2.cvtColor(np.clip(image, 0, 255).astype(np.uint8), cv2.COLOR_BGR2YCrCb), dtype=np.float32)
    noise = max(float(background.noise.max()), LEAST_NOISE)
    return SceneModels(frames, ycc, ground, _sigma(ground, noise), shadow, motion, background.white)


def _sigma(ground: Array32, noise: float) -> Array32:
    """Standard deviations (h, w, 2) of luminance and chroma: noise, and edges that are not quite in place."""
    slopes = [
        np.hypot(
            cv2.Sobel(ground[..., c], cv2.CV_32F, 1, 0, scale=0.125),
            cv2.Sobel(ground[..., c], cv2.CV_32F, 0, 1, scale=0.125),
        )
        for c in range(3)
    ]
    luminance = np.sqrt(noise**2 + (MISALIGNED * slopes[0]) ** 2)
    chroma = np.sqrt((0.7 * noise) ** 2 + (MISALIGNED * np.maximum(slopes[1], slopes[2])) ** 2)
    return np.stack([luminance, chroma], axis=-1).astype(np.float32)
