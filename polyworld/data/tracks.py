"""Observed motion: what a fit compares a rollout with. Centres of objects, and shapes of deformable ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from polyworld.data.shape_series import ShapeSeries

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObservedTracks:
    """Measured motion of n objects at T instants.

    frames (T,): frame numbers (or row numbers where there are no frames). clock (T,): when each was taken, in units of
    seconds_per_frame, for samples with times of their own; None where frame f was taken at f * seconds_per_frame.
    positions (T, n, 3) [m], NaN where unknown. position_sigma (T, n): standard
    deviation of a position [m]. orientations (T, n, 4) w, x, y, z, NaN where unknown. confidence (T, n) and
    orientation_confidence (T, n) in 0..1, 0 where nothing was observed. symmetry (n,): order of rotational
    symmetry of the object about its vertical axis as far as the observation can show (1 none, 4 a cube
    without markings, 0 any angle looks the same: its rotation about that axis is not compared). shapes: what was
    measured of deformable objects at the same frames; an object may have shapes, a track, or both. position_spread
    (T, n, 3) [m]: one more standard deviation, along the direction of a vector, as of distances from a camera; the
    covariance of a position is sigma^2 I + spread spread^T. None where no position has any.
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
    shapes: tuple[ShapeSeries, ...] = ()
    position_spread: Array | None = None
    clock: Array | None = None

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
        if self.position_spread is not None:
            shapes["position_spread"] = (self.position_spread.shape, (t, n, 3))
        if self.clock is not None:
            shapes["clock"] = (self.clock.shape, (t,))
        shapes |= {f"{s.readout.kind} of {s.object}": (s.confidence.shape[:1], (t,)) for s in self.shapes}
        wrong = [f"{k} {got}, expected {want}" for k, (got, want) in shapes.items() if got != want]
        if wrong:
            raise ValueError("; ".join(wrong))
        if t and np.any(np.diff(self.frames) <= 0):
            raise ValueError("frames must increase")
        if t and not np.all(np.diff(self.moments, prepend=-np.inf) > 0):
            raise ValueError("times must increase")
        if not np.isfinite(self.seconds_per_frame) or self.seconds_per_frame <= 0:
            raise ValueError(f"seconds_per_frame must be positive, got {self.seconds_per_frame}")
        if np.any((self.confidence > 0) & ~np.all(np.isfinite(self.positions), axis=-1)):
            raise ValueError("a position with confidence above 0 must be finite")

    @property
    def coordinate_sigma(self) -> Array:
        """Root mean square standard deviation (T, n) of a position's coordinates [m]."""
        if self.position_spread is None:
            return self.position_sigma
        sigma: Array = np.sqrt(self.position_sigma**2 + (self.position_spread**2).sum(axis=2) / 3.0)
        return sigma

    @property
    def height_sigma(self) -> Array:
        """Standard deviation (T, n) of a position's height, the coordinate z [m]."""
        if self.position_spread is None:
            return self.position_sigma
        sigma: Array = np.hypot(self.position_sigma, self.position_spread[:, :, 2])
        return sigma

    @property
    def moments(self) -> Array:
        """When each frame was taken, shape (T,), in units of seconds_per_frame."""
        return self.frames.astype(np.float64) if self.clock is None else self.clock

    @property
    def times(self) -> Array:
        """When each frame was taken, shape (T,) [s]."""
        return self.moments * self.seconds_per_frame

    def time_of(self, frame: int) -> float:
        """Time of a frame [s], interpolated between those that were measured, beyond them at seconds_per_frame."""
        if self.clock is None or not len(self.frames):
            return float(frame) * self.seconds_per_frame
        near = int(np.clip(frame, self.frames[0], self.frames[-1]))
        return float(np.interp(near, self.frames, self.clock) + frame - near) * self.seconds_per_frame

    def index(self, name: str) -> int:
        """Column of an object; raises KeyError naming the valid choices."""
        if name not in self.names:
            raise KeyError(f"unknown track {name!r}; tracks: {list(self.names)}")
        return self.names.index(name)

    def shows_turning(self, name: str) -> bool:
        """Whether two frames or more show how an object is turned."""
        return int((self.orientation_confidence[:, self.index(name)] > 0.0).sum()) >= 2

    @property
    def observed_names(self) -> tuple[str, ...]:
        """Names of all objects of which anything is known: those with tracks, then those with shapes alone."""
        return tuple(dict.fromkeys((*self.names, *(s.object for s in self.shapes))))

    def select(self, names: list[str] | tuple[str, ...]) -> Self:
        """The same for some objects only, tracks in the order given; raises KeyError for one with nothing known."""
        tracked = [n for n in names if n in self.names or not any(s.object == n for s in self.shapes)]
        columns = [self.index(n) for n in tracked]
        return replace(
            self,
            names=tuple(tracked),
            positions=self.positions[:, columns],
            position_sigma=self.position_sigma[:, columns],
            orientations=self.orientations[:, columns],
            confidence=self.confidence[:, columns],
            orientation_confidence=self.orientation_confidence[:, columns],
            symmetry=tuple(self.symmetry[c] for c in columns),
            shapes=tuple(s for s in self.shapes if s.object in names),
            position_spread=None if self.position_spread is None else self.position_spread[:, columns],
        )

    def with_shapes(self, shapes: tuple[ShapeSeries, ...], frames: NDArray[np.int64]) -> Self:
        """The same with more shapes, measured at other frames, which are added to these.

        A readout that is here already is replaced. Frames that are not here yet have the time of `time_of`.
        """
        union = np.union1d(self.frames, frames).astype(np.int64)
        at = np.searchsorted(union, self.frames)

        def spread(values: Array, empty: float) -> Array:
            wide = np.full((len(union), *values.shape[1:]), empty)
            wide[at] = values
            return wide

        new = [s.readout for s in shapes]
        kept = [s.onto(union, self.frames) for s in self.shapes if s.readout not in new]
        return replace(
            self,
            frames=union,
            positions=spread(self.positions, np.nan),
            position_sigma=spread(self.position_sigma, np.nan),
            orientations=spread(self.orientations, np.nan),
            confidence=spread(self.confidence, 0.0),
            orientation_confidence=spread(self.orientation_confidence, 0.0),
            shapes=(*kept, *(s.onto(union, frames) for s in shapes)),
            position_spread=None if self.position_spread is None else spread(self.position_spread, 0.0),
            clock=None
            if self.clock is None
            else np.array([self.time_of(int(f)) / self.seconds_per_frame for f in union]),
        )

    def window(self, first_frame: int, last_frame: int) -> Self:
        """The same tracks between two frames, both included."""
        return self.rows((self.frames >= first_frame) & (self.frames <= last_frame))

    def rows(self, keep: NDArray[np.bool_]) -> Self:
        """The same tracks at some of their frames, keep (T,)."""
        return replace(
            self,
            frames=self.frames[keep],
            positions=self.positions[keep],
            position_sigma=self.position_sigma[keep],
            orientations=self.orientations[keep],
            confidence=self.confidence[keep],
            orientation_confidence=self.orientation_confidence[keep],
            shapes=tuple(s.rows(keep) for s in self.shapes),
            position_spread=None if self.position_spread is None else self.position_spread[keep],
            clock=None if self.clock is None else self.clock[keep],
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
            **({"shapes": [s.to_dict() for s in self.shapes]} if self.shapes else {}),
            **({} if self.position_spread is None else {"position_spread": _to_lists(self.position_spread)}),
            **({} if self.clock is None else {"clock": self.clock.tolist()}),
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
            shapes=tuple(ShapeSeries.from_dict(s) for s in data.get("shapes", ())),
            position_spread=np.asarray(data["position_spread"], dtype=float).reshape(t, n, 3)
            if "position_spread" in data
            else None,
            clock=np.asarray(data["clock"], dtype=float) if "clock" in data else None,
        )


def frame_grid(times: Array, seconds_per_frame: float | None = None) -> tuple[NDArray[np.int64], float, Array]:
    """Return distinct frame numbers (T,) nearest to increasing times (T,) [s], seconds per frame, and the clock (T,).

    seconds_per_frame: default about the median interval, the mean one, or a half, quarter, ... of the median, whichever
    is the first to give every time a frame of its own.
    """
    steps = [seconds_per_frame or 1.0]
    if seconds_per_frame is None and len(times) > 1:
        whole, gaps = float(times[-1] - times[0]), np.diff(times)
        median = whole / max(round(whole / float(np.median(gaps))), 1)
        halvings = range(1, 2 + max(int(np.ceil(np.log2(median / gaps.min()))), 0))
        steps = [median, whole / len(gaps), *(median / 2**k for k in halvings)]
    for step in steps:
        frames = np.floor(times / step + 0.5).astype(np.int64)
        if np.all(np.diff(frames) > 0):
            break
    return frames, step, times / step


def continuous(quaternions: Array) -> Array:
    """Quaternions (T, 4) with signs chosen so that neighbours are close."""
    result = quaternions.copy()
    for t in range(1, len(result)):
        if result[t] @ result[t - 1] < 0:
            result[t] = -result[t]
    return result


def shapes_only(
    shapes: tuple[ShapeSeries, ...], frames: NDArray[np.int64], seconds_per_frame: float, clock: Array | None = None
) -> ObservedTracks:
    """A record of shapes without tracks."""
    t = len(frames)
    return ObservedTracks(
        names=(),
        frames=np.asarray(frames, dtype=np.int64),
        seconds_per_frame=seconds_per_frame,
        positions=np.zeros((t, 0, 3)),
        position_sigma=np.zeros((t, 0)),
        orientations=np.zeros((t, 0, 4)),
        confidence=np.zeros((t, 0)),
        orientation_confidence=np.zeros((t, 0)),
        symmetry=(),
        shapes=shapes,
        clock=clock,
    )


def without_spread(apart: Array, spread: Array, deviations: float = 4.0) -> Array:
    """Return differences (..., 3) of places without what a spread (..., 3) along one direction explains.

    Along that direction they lose up to so many standard deviations, which the length of `spread` is: a distance from
    one camera hangs on how its path is divided into flights, and errs by several at times.
    """
    length = np.linalg.norm(spread, axis=-1)
    direction = spread / np.maximum(length, 1e-300)[..., None]
    along = np.sum(apart * direction, axis=-1)
    explained = np.clip(along, -deviations * length, deviations * length)
    left: Array = apart - explained[..., None] * direction
    return left


def _to_lists(values: Array) -> list[Any]:
    replaced = values.astype(object)
    replaced[~np.isfinite(values)] = None
    listed: list[Any] = replaced.tolist()
    return listed
