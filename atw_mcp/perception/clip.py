"""Clip: frames that are looked at, their numbers in the video, and how the camera moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.camera_motion import camera_motion, filmed, in_full_pixels, stabilised, steadied
from atw_mcp.perception.eye.regions import reduced
from atw_mcp.perception.observation import ObservationError
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]
ALIGNED_PIXELS = 230_000  # of a frame in which the camera's motion is measured: more make it no better


@dataclass(frozen=True)
class Clip:
    """Frames (T, H, W, 3) of a video and their numbers in it; steady: as the first frame's camera would have seen them;
    motion (T, 2, 3): of the camera in full pixels, None where it stands still."""

    frames: Frames
    numbers: tuple[int, ...]
    steady: Frames
    motion: Floats | None

    @classmethod
    def of(cls, frames: Frames, stride: int, tick: Callable[[], None]) -> Clip:
        """Return a clip of every `stride`-th frame, freed of the camera's motion."""
        small, factor = reduced(frames, ALIGNED_PIXELS)
        motion = in_full_pixels(camera_motion(small, tick), 1 / factor)
        steady = frames if motion is None else stabilised(frames, motion)
        return cls(frames, tuple(range(0, stride * len(frames), stride)), steady, motion)

    def row(self, frame: int) -> int:
        """Row of a frame number; raises ObservationError naming frames that are looked at."""
        if frame in self.numbers:
            return self.numbers.index(frame)
        near = sorted(self.numbers, key=lambda n: abs(n - frame))[:2]
        raise ObservationError(
            f"frame {frame} is not looked at (frames {self.numbers[0]}..{self.numbers[-1]}): give one that is, such as "
            + " or ".join(map(str, sorted(near)))
        )

    def steadied(self, points: Floats, row: int) -> Floats:
        """Return points (N, 2) [px] of a row's frame as they lie in the steady one."""
        return steadied(points, self.motion, row)

    def filmed(self, points: Floats, row: int) -> Floats:
        """Return the inverse of `steadied`."""
        return filmed(points, self.motion, row)
