"""Collect what the screening looks at: every object's track in every run, with the noise of each axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_levels
from polyworld.data.recording import Recording, Run

Array = NDArray[np.float64]

LAST_DIGIT = 1e-6  # of a last digit: what reading and scaling a number in double precision may be off by
EXACT = 1e-9  # least noise as a part of the range: rounding of floating-point numbers


@dataclass(frozen=True)
class Track:
    """One object in one run at the m instants at which anything of its position was measured.

    run: name of the run. times (m,) [s]. places (m, 3) [m] and orientations (m, 4), NaN where not measured. noise (3,):
    standard deviation of each axis [m], pooled over runs, rounding included; quantum (3,): step of the grid that
    positions lie on [m], 0 where there is none.
    """

    run: str
    object: str
    times: Array
    places: Array
    orientations: Array
    noise: Array = field(default_factory=lambda: np.zeros(3))
    quantum: Array = field(default_factory=lambda: np.zeros(3))

    @cached_property
    def axes(self) -> tuple[int, ...]:
        """World axes measured in at least half of the instants."""
        return tuple(int(a) for a in np.flatnonzero(np.isfinite(self.places).mean(axis=0) >= 0.5))

    @cached_property
    def range(self) -> Array:
        """Difference of largest and smallest position on each axis (3,) [m], 0 where not measured."""
        seen = np.isfinite(self.places)
        high = np.where(seen, self.places, -np.inf).max(axis=0)
        low = np.where(seen, self.places, np.inf).min(axis=0)
        return np.where(seen.any(axis=0), high - low, 0.0)

    @cached_property
    def interval(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    def moves(self, factor: float) -> bool:
        """Whether the range on some axis exceeds `factor` standard deviations and two steps of its grid."""
        return bool(np.any(self.range > factor * self.noise + 2.0 * self.quantum))


def tracks_of(recording: Recording) -> tuple[Track, ...]:
    """Return the tracks with at least two instants, in the order of runs and objects, without their noise."""
    found = []
    for run in recording.runs:
        for column, name in enumerate(run.names):
            places = run.positions[:, column]
            rows = np.isfinite(places).any(axis=1)
            if np.count_nonzero(rows) >= 2:
                found.append(Track(run.name, name, run.times[rows], places[rows], run.orientations[rows, column]))
    return tuple(found)


def with_noise(tracks: Sequence[Track], recording: Recording, quantum: dict[tuple[str, int], float]) -> list[Track]:
    """Return the tracks with their noise: of each object and axis the median over runs, at least what is stated.

    quantum: steps of grids by object and axis. Rounding by a step q has standard deviation q / sqrt(12).
    """
    levels: dict[tuple[str, int], list[float]] = {}
    stated: dict[str, Run] = {run.name: run for run in recording.runs}
    ranges: dict[str, float] = {}
    for track in tracks:
        own = noise_levels(track.times, track.places)
        ranges[track.object] = max(ranges.get(track.object, 0.0), float(track.range.max()))
        for axis in range(3):
            if np.isfinite(own[axis]):
                levels.setdefault((track.object, axis), []).append(float(own[axis]))
    pooled = {key: float(np.median(values)) for key, values in levels.items()}
    found = []
    for track in tracks:
        step = np.array([quantum.get((track.object, axis), 0.0) for axis in range(3)])
        given = stated[track.run].sigma or 0.0
        own = np.array([pooled.get((track.object, axis), 0.0) for axis in range(3)])
        floor = np.maximum(step / np.sqrt(12.0), EXACT * ranges[track.object])
        found.append(replace(track, noise=np.maximum(np.maximum(own, given), floor), quantum=step))
    return found


def last_digit(values: Array, decimals: int, error: float = LAST_DIGIT) -> float:
    """Return the power of ten of which all values are multiples, 0 where it has more than so many decimals.

    error: of a last digit, by reading and scaling numbers in double precision.
    """
    for count in range(decimals + 1):
        scaled = values * 10.0**count
        if np.all(np.abs(scaled - np.round(scaled)) < error * np.maximum(1.0, 1e-9 * np.abs(scaled))):
            return float(10.0**-count)
    return 0.0
