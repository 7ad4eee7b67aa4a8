"""Noise of the runs of a recording, and of the tracks of a video, by series; never changed by a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import NOISE_FLOOR
from polyworld.data.noise import noise_level, noise_levels
from polyworld.data.recording import Run
from polyworld.data.tracks import ObservedTracks
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

AT_REST = 0.3  # of the usual noise, below which none is believed: a body at rest within one pixel shows none
FINEST = 1e-5  # least noise over the extent of a motion: simulations are no better
SUPPOSED = 1e-3  # noise over the extent where too few samples show it
SPIN_ERROR = 0.02  # of a spin that was measured too seldom to show its noise: what tracking of marks on a ball is off
TURN_ERROR = 0.01  # [rad] likewise of a turn
STILL = 0.1  # of the noise of turns about another axis, below which nothing turns about this one, as in a plane
FREEDOM = 3.0  # third differences for each that is independent, of white noise
ERRORS = 2.0  # standard errors of the scatter within which a stated noise may be below it
SMOOTH = 3.0  # times the scatter that a stated noise is believed: the rest of it drifts slowly, as masks' errors do


@dataclass(frozen=True)
class RunNoise:
    """Standard deviations (n, 3) of the n objects of one run: positions [m], turns [rad], spins [rad/s]."""

    position: Array
    turn: Array
    spin: Array


def run_noise(runs: Sequence[Run]) -> tuple[RunNoise, ...]:
    """Return the noise of every run: that stated, else the median over runs by object and axis.

    Runs of one study come from the same instruments, and short ones hardly show their noise by themselves.
    """
    found: dict[tuple[str, str, int], list[float]] = {}
    extents: dict[str, float] = {}
    for run in runs:
        for column, name in enumerate(run.names):
            places = run.positions[:, column]
            seen = np.isfinite(places)
            if seen.any():
                spans = [float(np.ptp(places[s, a])) for a, s in enumerate(seen.T) if s.any()]
                extents[name] = max(extents.get(name, 0.0), *spans)
            for axis in range(3):
                for kind, values in (("position", places), ("spin", run.angular_velocities[:, column])):
                    level = noise_level(run.times, values[:, axis])
                    if np.isfinite(level):
                        found.setdefault((name, kind, axis), []).append(level)
            turn = _turn_level(run, column)
            if turn is not None:
                found.setdefault((name, "turn", 0), []).append(turn)
    moving = [level for (_, kind, _), levels in found.items() if kind == "position" for level in levels if level > 0.0]
    rest = AT_REST * float(np.median(moving)) if moving else 0.0
    return tuple(_of_run(run, found, extents, rest) for run in runs)


def _of_run(
    run: Run, found: dict[tuple[str, str, int], list[float]], extents: dict[str, float], rest: float
) -> RunNoise:
    shape = (len(run.names), 3)
    position, turn, spin = np.ones(shape), np.ones(shape), np.ones(shape)
    for column, name in enumerate(run.names):
        extent = max(extents.get(name, 0.0), 1e-9)
        turn[column] = float(np.median(found.get((name, "turn", 0), [TURN_ERROR])))
        spins = run.angular_velocities[:, column]
        spins = spins[np.isfinite(spins).any(axis=1)]
        size = float(np.sqrt(np.mean(np.nansum(spins**2, axis=1)))) if len(spins) else 1.0
        for axis in range(3):
            own = found.get((name, "position", axis), [SUPPOSED * extent])
            position[column, axis] = run.sigma or max(float(np.median(own)), FINEST * extent, rest)
            rates = found.get((name, "spin", axis), [])
            spin[column, axis] = max(float(np.median(rates)) if rates else SPIN_ERROR * size, 1e-3 * size, 1e-6)
    return RunNoise(position, np.maximum(turn, FINEST), spin)


def _turn_level(run: Run, column: int) -> float | None:
    """Return the noise of turns, which are counted on from instant to instant; None where too few were measured."""
    turned = np.isfinite(run.orientations[:, column]).all(axis=-1)
    q = run.orientations[turned, column]
    if len(q) < 4:
        return None
    own = noise_levels(run.times[turned][1:], np.cumsum(rotation_vector(q[1:], q[:-1]), axis=0))
    if not np.isfinite(own).all():
        return None
    return float(np.sqrt(np.mean(own[own >= STILL * own.max()] ** 2)))


def track_sigma(tracks: ObservedTracks) -> Array:
    """Return standard deviations (n,) [m] of the positions of each track.

    A stated noise is taken where it is no smaller than the scatter, beyond the error that so few samples leave, and no
    larger than three times; short tracks have what is stated. The scatter of all tracks together bounds that of each
    from below, since a few samples say little.
    """
    stated, scatter = np.zeros(len(tracks.names)), np.full(len(tracks.names), np.nan)
    error = np.zeros(len(tracks.names))
    for column in range(len(tracks.names)):
        seen = tracks.confidence[:, column] > 0.0
        if not seen.any():
            continue
        stated[column] = float(np.median(tracks.position_sigma[seen, column]))
        own = noise_levels(tracks.times[seen], tracks.positions[seen, column])
        if np.isfinite(own).any():
            own = own[own >= 0.1 * np.nanmax(own)]  # heights taken from the floor carry no noise
            scatter[column] = float(np.sqrt(np.mean(own**2)))
            error[column] = np.sqrt(FREEDOM / (2.0 * len(own) * (np.count_nonzero(seen) - 3)))
    known = np.isfinite(scatter)
    common = float(np.median(scatter[known])) if known.any() else 0.0
    scatter = np.where(known, np.maximum(scatter, 0.5 * common), stated)
    sigma = np.where(
        stated > 0.0,
        np.clip(stated, scatter / (1.0 + ERRORS * error), SMOOTH * np.maximum(scatter, NOISE_FLOOR)),
        scatter,
    )
    found: Array = np.maximum(sigma, NOISE_FLOOR)
    return found
