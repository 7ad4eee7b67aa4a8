"""Collect what the screening looks at: every object's track in every run, with noise and grid of each axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.data.noise import noise_levels
from polyworld.data.recording import Recording
from polyworld.screening.grid import grid_step
from polyworld.screening.settings import DEFAULT, ScreenSettings
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]

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
    noise: Array
    quantum: Array

    @cached_property
    def axes(self) -> list[int]:
        """World axes measured in at least half of the instants."""
        found: list[int] = np.flatnonzero(np.isfinite(self.places).mean(axis=0) >= 0.5).tolist()
        return found

    @cached_property
    def range(self) -> Array:
        """Difference of largest and smallest position on each axis (3,) [m], 0 where not measured."""
        return np.array([np.ptp(v[np.isfinite(v)]) if np.isfinite(v).any() else 0.0 for v in self.places.T])

    @cached_property
    def interval(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.times)))

    def moves(self, factor: float) -> bool:
        """Whether the range on some axis exceeds `factor` standard deviations and two steps of its grid."""
        return bool(np.any(self.range > factor * self.noise + 2.0 * self.quantum))


@dataclass(frozen=True)
class Subject:
    """What every check gets: a recording as tracks, and the world that it is held against."""

    world: World
    recording: Recording
    tracks: tuple[Track, ...]
    settings: ScreenSettings

    @cached_property
    def moving(self) -> list[Track]:
        """Tracks long enough to judge their sampling, of objects that move."""
        fewest, factor = self.settings.few_samples, self.settings.moved
        return [t for t in self.tracks if len(t.times) >= fewest and t.moves(factor)]

    @cached_property
    def counts_frames(self) -> bool:
        """Whether all times are whole numbers that mostly grow by one."""
        long = [t for t in self.tracks if len(t.times) >= self.settings.few_samples]
        whole = all(np.all(np.abs(t.times - np.round(t.times)) < 1e-9) for t in self.tracks)
        return bool(long) and whole and all(abs(t.interval - 1.0) < 1e-9 for t in long)

    def body(self, track: Track) -> RigidObject | None:
        """Return the rigid body that a track is of."""
        return next((o for o in self.world.objects if o.name == track.object), None)


def subject(world: World, recording: Recording, settings: ScreenSettings = DEFAULT) -> Subject:
    """Return the tracks with at least two instants, in the order of runs and objects.

    Grids are those that differences from sample to sample are multiples of, whatever the origin of each run. Steps that
    are finer than the motion resolves, or well below the noise, as the last decimal of a good measurement, are none.
    """
    seen: dict[str, list[tuple[int, int, NDArray[np.bool_]]]] = {}
    for r, run in enumerate(recording.runs):
        for column, name in enumerate(run.names):
            rows = np.asarray(np.isfinite(run.positions[:, column]).any(axis=1))
            if np.count_nonzero(rows) >= 2:
                seen.setdefault(name, []).append((r, column, rows))
    found: dict[tuple[int, int], Track] = {}
    for name, own in seen.items():
        places = [recording.runs[r].positions[rows, column] for r, column, rows in own]
        levels = np.array(
            [noise_levels(recording.runs[r].times[k], p) for (r, _, k), p in zip(own, places, strict=True)]
        )
        extent = max(float(np.ptp(v[np.isfinite(v)])) for p in places for v in p.T if np.isfinite(v).any())
        noise, quantum = np.full(3, EXACT * extent), np.zeros(3)
        for axis in range(3):
            columns = [p[np.isfinite(p[:, axis]), axis] for p in places]
            step = grid_step(np.concatenate(columns), np.concatenate([np.diff(c) for c in columns]), settings)
            level = float(np.nanmedian(levels[:, axis])) if np.isfinite(levels[:, axis]).any() else 0.0
            if step > settings.resolved * extent and step / np.sqrt(12.0) > settings.rounding_share * level:
                quantum[axis] = step
            noise[axis] = max(noise[axis], level, quantum[axis] / np.sqrt(12.0))
        for (r, column, rows), there in zip(own, places, strict=True):
            run, turns = recording.runs[r], recording.runs[r].orientations[rows, column]
            least = np.maximum(noise, run.sigma or 0.0)
            found[r, column] = Track(run.name, name, run.times[rows], there, turns, least, quantum)
    return Subject(world, recording, tuple(found[key] for key in sorted(found)), settings)
