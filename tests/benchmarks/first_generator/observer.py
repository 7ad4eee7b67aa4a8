"""Observe hidden motions with faults and noise: times, places and turns as they go into `data.csv`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
NoiseKind = Literal["white", "ar1", "outliers", "missing_rows"]


@dataclass(frozen=True)
class Fault:
    """Faults of the observer. scale, tilt (rotation vector of its axes), distortion: about the origin of the world.

    clock: its seconds per true second. lost: frames dropped (negative: repeated) in run lost_run before frame
    lost_after unseen in the stamps.
    """

    scale: float = 1.0
    clock: float = 1.0
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distortion: float = 0.0
    lost: int = 0
    lost_after: int = 0
    lost_run: int = -1

    def with_fault(self, other: Fault) -> Fault:
        """Both faults."""
        return Fault(
            self.scale * other.scale,
            self.clock * other.clock,
            tuple(np.add(self.tilt, other.tilt)),
            self.distortion + other.distortion,
            self.lost or other.lost,
            self.lost_after or other.lost_after,
            max(self.lost_run, other.lost_run),
        )

    def instants(self, stamps: Array, run: int) -> Array:
        """True times of stamps (T,) counted from the run's start; the first frame shows the start."""
        frames = np.arange(len(stamps), dtype=float)
        if run == self.lost_run:
            after = frames >= self.lost_after
            if self.lost >= 0:
                frames = frames + self.lost * after
            else:  # the frame before is shown again
                frames = np.where(after, np.maximum(frames + self.lost, self.lost_after - 1), frames)
        return frames * (stamps[1] - stamps[0]) / self.clock

    def seen(self, positions: Array, orientations: Array) -> tuple[Array, Array]:
        """Positions (..., 3) and orientations (..., 4; w, x, y, z) in what the observer takes for the world's axes."""
        back = Rotation.from_rotvec(self.tilt).inv()
        places = back.apply(positions.reshape(-1, 3)).reshape(positions.shape)
        places = self.scale * places * (1.0 + self.distortion * np.sum(places**2, axis=-1, keepdims=True))
        turned = back * Rotation.from_quat(orientations.reshape(-1, 4), scalar_first=True)
        return places, turned.as_quat(scalar_first=True).reshape(orientations.shape)


def noisy(
    positions: Array, orientations: Array, rng: np.random.Generator, *, sigma: float, angle: float, kind: NoiseKind
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Positions (T, n, 3), orientations (T, n, 4) with noise, and which instants (T,) are kept.

    sigma [m], angle [rad]: standard deviations per component of position and of a small turn. white: independent;
    ar1: each series first-order autoregressive with coefficient 0.9 and the same standard deviation; outliers: white,
    and 2% of the rows are off by tenfold noise; missing_rows: white, and 10% of the rows are missing besides a gap of
    8 rows, with right stamps.
    """
    t = len(positions)
    places = sigma * _series(rng, positions.shape, kind)
    turns = angle * _series(rng, positions.shape, kind)
    if kind == "outliers":
        wild = rng.random(positions.shape[:2]) < 0.02
        places[wild] += 10.0 * sigma * rng.normal(size=(int(wild.sum()), 3))
    keep = np.ones(t, dtype=bool)
    if kind == "missing_rows":
        keep = rng.random(t) >= 0.1
        gap = int(rng.integers(2, max(t - 12, 3)))
        keep[gap : gap + 8] = False
        keep[:2] = True
    turned = Rotation.from_rotvec(turns.reshape(-1, 3)) * Rotation.from_quat(
        orientations.reshape(-1, 4), scalar_first=True
    )
    return positions + places, turned.as_quat(scalar_first=True).reshape(orientations.shape), keep


def _series(rng: np.random.Generator, shape: tuple[int, ...], kind: NoiseKind) -> Array:
    white = rng.normal(size=shape)
    if kind != "ar1":
        return white
    out = np.empty(shape)
    out[0] = white[0]
    for k in range(1, shape[0]):
        out[k] = 0.9 * out[k - 1] + np.sqrt(1.0 - 0.81) * white[k]
    return out
