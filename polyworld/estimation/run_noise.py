"""Measure the noise of recorded series before any model, by what local polynomials leave.

A smooth motion is a parabola over a few samples; where polynomials of the next degree still leave much less, motion is
in it and the next degree is taken. Windows with the largest remains are trimmed, since impacts disturb a few. Rounding
has a step: no noise is less than its standard deviation. What a fit leaves beyond this noise is its remainder, and
never changes the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from polyworld.data.recording import Run
from polyworld.world.symmetry import rotation_vector

Array = NDArray[np.float64]

KEPT = 0.8  # share of windows that counts: up to a fifth may span an impact
FEWEST = 6  # windows that show a level
LOWEST, HIGHEST = 2, 6  # degrees of polynomials that follow a motion
FALLING = 0.3  # ratio of variances from degree to degree below which motion is left: noise keeps 1
WIDER = 1.5  # times the length of windows that is tried next,
WIDEST = 8  # windows that a series holds at least: an impact disturbs one in eight
FLAT = 1.2  # growth of the variance with the windows up to which it is noise
AT_REST = 0.3  # of the usual noise, below which none is believed: a body at rest within one pixel shows none
FINEST = 1e-5  # least noise over the extent of a motion: simulations are no better
SUPPOSED = 1e-3  # noise over the extent where too few samples show it
SPIN_ERROR = 0.02  # of a spin that was measured too seldom to show its noise: what tracking of marks on a ball is off
TURN_ERROR = 0.01  # [rad] likewise of a turn
STILL = 0.1  # of the noise of turns about another axis, below which nothing turns about this one, as in a plane


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
                    level = _level(run.times, values[:, axis])
                    if level is not None:
                        found.setdefault((name, kind, axis), []).append(level)
            level = _turn_level(run, column)
            if level is not None:
                found.setdefault((name, "turn", 0), []).append(level)
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


def _level(times: Array, values: Array) -> float | None:
    """Return the standard deviation of the noise of a series (T,), None where too few samples show it.

    Polynomials over the shortest windows follow the motion; windows then grow while they leave no more, since each
    sample shows the noise better in a longer one.
    """
    seen = np.isfinite(values)
    times, values = times[seen], values[seen]
    steps = np.diff(times)
    if len(steps) < LOWEST + FEWEST:
        return None
    even = np.abs(steps - np.median(steps)) < 0.3 * np.median(steps)
    degree, level = LOWEST, _of_windows(values, even, LOWEST + 2, LOWEST)
    while level is not None and degree < HIGHEST:
        own = _of_windows(values, even, degree + 3, degree + 1)
        if own is None or own**2 > FALLING * level**2:
            break
        degree, level = degree + 1, own
    if level is None:
        return None
    length, most = degree + 2, FLAT * level**2
    while (wider := int(np.ceil(WIDER * length))) <= len(values) // WIDEST:
        own = _of_windows(values, even, wider, degree)
        if own is None or own**2 > most:
            break
        length, level = wider, own
    return max(level, _rounding(values))


def _of_windows(values: Array, even: NDArray[np.bool_], length: int, degree: int) -> float | None:
    """Return what polynomials of a degree leave in windows of so many samples; impacts disturb a share of these."""
    whole = np.lib.stride_tricks.sliding_window_view(even, length - 1).all(axis=1)
    if whole.sum() < FEWEST:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(values, length)[whole]
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), degree + 1))[0]
    windows = windows - windows[:, :1]
    square = np.sort(((windows - (windows @ basis) @ basis.T) ** 2).sum(axis=1))
    free = length - degree - 1
    kept = chi2.cdf(chi2.ppf(KEPT, free), free + 2) / KEPT  # mean of a chi-square variable below its quantile
    return float(np.sqrt(square[: max(3, int(KEPT * len(square)))].mean() / (free * kept)))


def _turn_level(run: Run, column: int) -> float | None:
    turned = np.isfinite(run.orientations[:, column]).all(axis=-1)
    q = run.orientations[turned, column]
    if len(q) < 4 + FEWEST:
        return None
    steps = rotation_vector(q[1:], q[:-1])
    own = np.array([_trimmed(d) for d in np.diff(steps, 2, axis=0).T])
    own = own[own >= STILL * own.max()]
    return float(np.sqrt(np.mean(own**2) / comb(6, 3)))


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
