"""How far a rollout is from the measured positions, frame by frame, as fits compare them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.readout import CHANNELS, tracks_readout
from polyworld.probing.compare import positions_at
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]

LATE = 1e-9  # [s] by which rounding may put a frame after the last sample


@dataclass(frozen=True)
class Misfit:
    """One object: times (T,) [s] of the observed frames, its measured positions (T, 3) [m], distances of simulated from
    measured (T,) in metres and in standard deviations of the measurement, NaN where not measured; rms [m]."""

    name: str
    times: Array
    measured: Array
    distance: Array
    sigmas: Array
    rms: float

    @property
    def largest(self) -> float:
        """The largest distance in standard deviations, else in metres where none is stated; 0 without any."""
        known = self.sigmas if np.isfinite(self.sigmas).any() else self.distance
        return float(np.nanmax(known)) if np.isfinite(known).any() else 0.0


def misfits(world: World, run: Trajectory, tracks: ObservedTracks) -> list[Misfit]:
    """Return the distance of each object to its track; tracks: in the time base of the world.

    In planar worlds distances are those in the plane of motion. Empty where the rollout covers no observed frame.
    """
    if not len(run.times) or not set(tracks.names) & set(run.names):
        return []
    end = float(run.times[-1]) + LATE
    tracks = tracks.rows(tracks.times <= end)
    if not len(tracks.frames):
        return []
    readout, batch, count = tracks_readout(world, tracks), _at_frames(run, tracks), len(tracks.frames)
    shape = (count, len(readout.run.names), CHANNELS)
    seen: NDArray[np.bool_] = readout.measured.reshape(shape)[:, :, :3]
    with np.errstate(divide="ignore"):
        both = (readout.differences(batch, count)[0], readout.standardised(batch, count)[0].reshape(shape))
    distances, sigmas = (np.linalg.norm(np.where(seen, d[..., :3], 0.0), axis=-1) for d in both)
    found = []
    for column, name in enumerate(readout.run.names):
        rows: NDArray[np.bool_] = np.any(seen[:, column], axis=1)
        if not rows.any():
            continue
        stated = tracks.position_sigma[:, tracks.index(name)]
        known = rows & np.isfinite(stated) & (stated > 0.0)
        measured = np.where(rows[:, None], tracks.positions[:, tracks.index(name)], np.nan)
        distance = np.where(rows, distances[:, column], np.nan)
        deviation = np.where(known, sigmas[:, column], np.nan)
        rms = float(np.sqrt(np.nanmean(distance**2)))
        found.append(Misfit(name, tracks.times, measured, distance, deviation, rms))
    return found


def _at_frames(run: Trajectory, tracks: ObservedTracks) -> BatchTrajectory:
    """Return positions at the times of the tracks; between samples on the cubic through positions and velocities."""
    times = np.minimum(tracks.times, run.times[-1])
    positions = np.stack([positions_at(run, k, times) for k in range(len(run.names))], axis=1)
    nearest: NDArray[np.int64] = np.abs(run.times[:, None] - times).argmin(axis=0)
    return replace(run.select(nearest), times=times, positions=positions).batch()
