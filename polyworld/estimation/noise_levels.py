"""Levels of the noise: pooled over series of an object and axis, no finer than engine and rounding resolve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import differences
from polyworld.estimation.design import Design, RunDesign, Series
from polyworld.screening.grid import grid_step
from polyworld.world.symmetry import rotation_vector

if TYPE_CHECKING:
    from polyworld.estimation.noise import Correlation, Kind

Array = NDArray[np.float64]

RESOLUTION = 1e-5  # least noise, as a part of the extent of the motion: simulations are no better
RELATIVE_ERROR = 1.3  # relative standard error of a level from n samples, times sqrt(n)
BELIEVED = 1.5  # factor by which the data may be noisier than was said before they are believed instead
SUPPOSED: dict[Kind, float] = {"position": 1e-3, "rotation": 0.01, "spin": 0.1}  # [unit] noise of too few samples


def levels(
    design: Design,
    series: Sequence[Series],
    spreads: Sequence[differences.Spread],
    correlation: Correlation,
    notes: list[str],
) -> Array:
    """Return standard deviations of series of one kind: each shrunk to those of its object and axis, those to all."""
    measured = np.array(
        [
            differences.level(d, float(correlation.over(np.array(d.interval)))) if d.count >= 2 else np.nan
            for d in spreads
        ]
    )
    floors = np.array([resolution(design, s) for s in series])
    known = np.isfinite(measured)
    if not known.any():
        measured = np.full(len(series), SUPPOSED[series[0].kind])
        notes.append(f"too few samples to estimate the noise of {series[0].kind}s: assumed")
    variance = np.where(known, RELATIVE_ERROR**2 / np.maximum([d.count for d in spreads], 1), np.inf)
    # The logarithm of a level is too low by its variance on average (mean of log chi-squared, to first order).
    logs = np.log(np.maximum(np.where(known, measured, 1.0), floors)) + np.where(known, variance, 0.0)
    if known.any():
        keys = [(s.name, s.axis) for s in series]
        groups = [[i for i, k in enumerate(keys) if k == key] for key in dict.fromkeys(keys)]
        middle = np.array([_pool(logs[g], variance[g])[:2] for g in groups])
        towards, _, between = _pool(middle[:, 0], middle[:, 1])
        for g, (mean, error) in zip(groups, middle, strict=True):
            weight = between / (between + error) if np.isfinite(error) else 0.0
            centre = weight * mean + (1.0 - weight) * towards
            spread_ = _pool(logs[g], variance[g])[2]
            share = np.where(np.isfinite(variance[g]), spread_ / (spread_ + variance[g]), 0.0)
            logs[g] = share * logs[g] + (1.0 - share) * centre
    else:
        logs = np.log(np.maximum(measured, floors))
    result = np.maximum(np.exp(logs), floors)
    return _as_said(design, series, result, notes)


def _as_said(design: Design, series: Sequence[Series], levels: Array, notes: list[str]) -> Array:
    """Return levels with those that the recording states, unless the data are clearly noisier."""
    levels = levels.copy()
    for i, s in enumerate(series):
        said = design.runs[s.run].run.sigma
        if s.kind != "position" or said is None or not said > 0.0:
            continue
        if levels[i] > BELIEVED * said:
            notes.append("the positions are noisier than the recording says: measured levels are used")
        else:
            levels[i] = said
    return levels


def _pool(logs: Array, variance: Array) -> tuple[float, float, float]:
    """Mean of levels, its variance, and the variance between them (DerSimonian and Laird 1986)."""
    seen = np.isfinite(variance)
    if not seen.any():
        return 0.0, float("inf"), 0.0
    w = 1.0 / variance[seen]
    x = logs[seen]
    mean = float(w @ x / w.sum())
    between = 0.0
    if len(x) > 1:
        scatter = float(w @ (x - mean) ** 2)
        between = max((scatter - (len(x) - 1)) / float(w.sum() - (w**2).sum() / w.sum()), 0.0)
        w = 1.0 / (variance[seen] + between)
        mean = float(w @ x / w.sum())
    return mean, float(1.0 / w.sum()), between


def resolution(design: Design, s: Series) -> float:
    """Return the least sigma: what the engine resolves, and the rounding of coarse data (step / sqrt(12))."""
    if s.kind == "rotation":
        return RESOLUTION * np.pi
    rounding = _rounding(design, s) / float(np.sqrt(12.0))
    run = design.runs[s.run]
    if s.kind == "spin":
        return max(RESOLUTION * float(np.abs(raw(run, s)).max()), rounding, 1e-9)
    places = run.run.positions[:, run.run.names.index(s.name)]
    spans = [np.ptp(v[np.isfinite(v)]) for v in places.T if np.isfinite(v).any()]
    extent = float(max(spans, default=0.0))
    return max(RESOLUTION * extent, rounding, 1e-9)


def _rounding(design: Design, s: Series) -> float:
    """Return the step to which an object's values along an axis are rounded in all runs together, 0 where there is
    none.

    The differences of few samples that move by a whole number of pixels each scatter by nothing. Where nothing moves
    along an axis, its pixels are those of the others.
    """
    steps: dict[int, float] = {}
    for axis in range(3):
        alike = [t for t in design.series if (t.name, t.kind, t.axis) == (s.name, s.kind, axis)]
        values = [raw(design.runs[t.run], t) for t in alike]
        if any(np.ptp(v) > 0.0 for v in values):
            steps[axis] = grid_step(np.concatenate(values), np.concatenate([np.diff(v) for v in values]))
    return steps[s.axis] if s.axis in steps else max(steps.values(), default=0.0)


def raw(run: RunDesign, s: Series) -> Array:
    """Return what was measured of a series, rotations as turns since the first one, unwrapped."""
    column = run.run.names.index(s.name)
    if s.kind == "position":
        places: Array = run.run.positions[s.rows, column, s.axis]
        return places
    if s.kind == "spin":
        spins: Array = run.run.angular_velocities[s.rows, column, s.axis]
        return spins
    turns = run.run.orientations[s.rows, column]
    steps = np.zeros((len(turns), 3))
    steps[1:] = rotation_vector(turns[1:], turns[:-1])
    unwrapped: Array = np.cumsum(steps, axis=0)[:, s.axis]
    return unwrapped
