"""Measure the noise of recorded series before any model, by differences of high order.

Third differences of a smooth motion are near zero, so that noise is left; where differences of the next order still
fall, motion is in them and the next order is taken. The largest are trimmed, since impacts disturb a few. Rounding has
a step: no noise is less than its standard deviation. What a fit leaves beyond this noise is its remainder, and never
changes the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from polyworld.data.recording import Run
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

KEPT = 0.8  # share of differences that counts: up to a fifth may span an impact
FEWEST = 6  # differences that show a level
HIGHEST = 7  # order of differences up to which a motion is followed
FALLING = 0.3  # ratio of variances from order to order below which motion is left: noise keeps 1
FINEST = 1e-5  # least noise over the extent of a motion: simulations are no better
SUPPOSED = 1e-3  # noise over the extent where too few samples show it
SPIN_ERROR = 0.02  # of a spin that was measured too seldom to show its noise: what tracking of marks on a ball is off
TURN_ERROR = 0.01  # [rad] likewise of a turn


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
                    level = _level(run.times, values[:, axis], 3)
                    if level is not None:
                        found.setdefault((name, kind, axis), []).append(level)
            level = _turn_level(run, column)
            if level is not None:
                found.setdefault((name, "turn", 0), []).append(level)
    return tuple(_of_run(run, found, extents) for run in runs)


def _of_run(run: Run, found: dict[tuple[str, str, int], list[float]], extents: dict[str, float]) -> RunNoise:
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
            position[column, axis] = run.sigma or max(float(np.median(own)), FINEST * extent)
            rates = found.get((name, "spin", axis), [])
            spin[column, axis] = max(float(np.median(rates)) if rates else SPIN_ERROR * size, 1e-3 * size, 1e-6)
    return RunNoise(position, np.maximum(turn, FINEST), spin)


def _level(times: Array, values: Array, order: int) -> float | None:
    """Return the standard deviation of the noise of a series (T,), None where too few samples show it."""
    seen = np.isfinite(values)
    times, values = times[seen], values[seen]
    if len(times) < order + FEWEST:
        return None
    steps = np.diff(times)
    even = np.abs(steps - np.median(steps)) < 0.3 * np.median(steps)
    level = None
    while order <= HIGHEST:
        whole = np.lib.stride_tricks.sliding_window_view(even, order).all(axis=1)
        differences = np.diff(values, order)[whole]
        if len(differences) < FEWEST:
            break
        own = float(_trimmed(differences) / np.sqrt(comb(2 * order, order)))
        if level is not None and own**2 > FALLING * level**2:
            break
        level, order = own, order + 1
    if level is None:
        return None
    return max(level, _rounding(values))


def _turn_level(run: Run, column: int) -> float | None:
    turned = np.isfinite(run.orientations[:, column]).all(axis=-1)
    q = run.orientations[turned, column]
    if len(q) < 4 + FEWEST:
        return None
    steps = rotation_vector(q[1:], q[:-1])
    return float(_trimmed(np.diff(steps, 2, axis=0).ravel()) / np.sqrt(comb(6, 3)))


def _trimmed(values: Array) -> float:
    """Return a standard deviation of which the largest values are no part."""
    square = np.sort(values**2)[: max(3, int(KEPT * len(values)))]
    edge = float(norm.ppf(0.5 + 0.5 * KEPT))
    kept = 1.0 - 2.0 * edge * float(norm.pdf(edge)) / KEPT  # variance of a normal variable within the edge
    return float(np.sqrt(square.mean() / kept))


def _rounding(values: Array) -> float:
    """Return the standard deviation of rounding where values come again, else 0."""
    steps = np.unique(values)
    if not 1 < len(steps) <= 0.8 * len(values):
        return 0.0
    return float(np.diff(steps).min() / np.sqrt(12.0))
