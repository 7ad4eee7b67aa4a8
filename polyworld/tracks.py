"""Observed motion in world coordinates: what a fit compares a rollout with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObservedTracks:
    """Measured motion of n objects at T instants.

    frames (T,): frame numbers (or row numbers where there are no frames); time of frame f is
    f * seconds_per_frame. positions (T, n, 3) [m], NaN where unknown. position_sigma (T, n): standard
    deviation of a position [m]. orientations (T, n, 4) w, x, y, z, NaN where unknown. confidence (T, n) and
    orientation_confidence (T, n) in 0..1, 0 where nothing was observed. symmetry (n,): order of rotational
    symmetry of the object about its vertical axis as far as the observation can tell (1 none, 4 a cube
    without markings, 0 any angle looks the same: its rotation about that axis is not compared).
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    seconds_per_frame: float
    positions: Array
    position_sigma: Array
    orientations: Array
    confidence: Array
    orientation_confidence: Array
    symmetry: tuple[int, ...]

    def __post_init__(self) -> None:
        t, n = len(self.frames), len(self.names)
        shapes = {
            "positions": (self.positions.shape, (t, n, 3)),
            "position_sigma": (self.position_sigma.shape, (t, n)),
            "orientations": (self.orientations.shape, (t, n, 4)),
            "confidence": (self.confidence.shape, (t, n)),
            "orientation_confidence": (self.orientation_confidence.shape, (t, n)),
            "symmetry": ((len(self.symmetry),), (n,)),
        }
        wrong = [f"{k} {got}, expected {want}" for k, (got, want) in shapes.items() if got != want]
        if wrong:
            raise ValueError("; ".join(wrong))
        if t and np.any(np.diff(self.frames) <= 0):
            raise ValueError("frames must increase")
        if not np.isfinite(self.seconds_per_frame) or self.seconds_per_frame <= 0:
            raise ValueError(f"seconds_per_frame must be positive, got {self.seconds_per_frame}")
        if np.any((self.confidence > 0) & ~np.all(np.isfinite(self.positions), axis=-1)):
            raise ValueError("a position with confidence above 0 must be finite")

    @property
    def times(self) -> Array:
        """Times of the frames, shape (T,) [s]."""
        return self.frames.astype(np.float64) * self.seconds_per_frame

    def index(self, name: str) -> int:
        """Column of an object; raises KeyError naming the valid choices."""
        if name not in self.names:
            raise KeyError(f"unknown track {name!r}; tracks: {list(self.names)}")
        return self.names.index(name)

    def select(self, names: list[str] | tuple[str, ...]) -> Self:
        """The same tracks for some objects only, in the order given."""
        columns = [self.index(n) for n in names]
        return type(self)(
            names=tuple(names),
            frames=self.frames,
            seconds_per_frame=self.seconds_per_frame,
            positions=self.positions[:, columns],
            position_sigma=self.position_sigma[:, columns],
            orientations=self.orientations[:, columns],
            confidence=self.confidence[:, columns],
            orientation_confidence=self.orientation_confidence[:, columns],
            symmetry=tuple(self.symmetry[c] for c in columns),
        )

    def window(self, first_frame: int, last_frame: int) -> Self:
        """The same tracks between two frames, both included."""
        rows = (self.frames >= first_frame) & (self.frames <= last_frame)
        return type(self)(
            names=self.names,
            frames=self.frames[rows],
            seconds_per_frame=self.seconds_per_frame,
            positions=self.positions[rows],
            position_sigma=self.position_sigma[rows],
            orientations=self.orientations[rows],
            confidence=self.confidence[rows],
            orientation_confidence=self.orientation_confidence[rows],
            symmetry=self.symmetry,
        )

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values, NaN as None; `from_dict` reads them back exactly."""
        return {
            "names": list(self.names),
            "frames": self.frames.tolist(),
            "seconds_per_frame": self.seconds_per_frame,
            "positions": _to_lists(self.positions),
            "position_sigma": _to_lists(self.position_sigma),
            "orientations": _to_lists(self.orientations),
            "confidence": _to_lists(self.confidence),
            "orientation_confidence": _to_lists(self.orientation_confidence),
            "symmetry": list(self.symmetry),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """The inverse of `to_dict`."""
        n, t = len(data["names"]), len(data["frames"])
        return cls(
            names=tuple(data["names"]),
            frames=np.asarray(data["frames"], dtype=np.int64),
            seconds_per_frame=float(data["seconds_per_frame"]),
            positions=np.asarray(data["positions"], dtype=float).reshape(t, n, 3),
            position_sigma=np.asarray(data["position_sigma"], dtype=float).reshape(t, n),
            orientations=np.asarray(data["orientations"], dtype=float).reshape(t, n, 4),
            confidence=np.asarray(data["confidence"], dtype=float).reshape(t, n),
            orientation_confidence=np.asarray(data["orientation_confidence"], dtype=float).reshape(t, n),
            symmetry=tuple(int(s) for s in data["symmetry"]),
        )


def _to_lists(values: Array) -> list[Any]:
    replaced = values.astype(object)
    replaced[~np.isfinite(values)] = None
    listed: list[Any] = replaced.tolist()
    return listed
