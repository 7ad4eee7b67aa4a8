"""Directions in which starts are uncertain: paths of bodies in flight that one camera sees move towards it or away.

Seen from one place, a flight that is farther away and faster is hardly distinguished from a near and slow one. Which of
them a collision needs, no gradient shows before bodies touch: further starts depart along these directions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.world_fit.problem import FitProblem

Array = NDArray[np.float64]


def sight_lines(problem: FitProblem) -> Array:
    """Return by how much the unknowns change (L, P) where a body's path is one standard deviation farther away.

    One row for each body that begins where its distance is less known than the rest of its place.
    """
    tracks, space = problem.window, problem.space
    if tracks.position_spread is None:
        return np.zeros((0, len(space.unknowns)))
    paths = {path: i for i, unknown in enumerate(space.unknowns) for path in unknown.paths}
    lines = []
    for column, name in enumerate(tracks.names):
        rows = np.flatnonzero(tracks.confidence[:, column] > 0.0)
        spread = tracks.position_spread[rows, column]
        length = np.linalg.norm(spread, axis=1)
        far = length > tracks.position_sigma[rows, column]
        count = len(rows) if far.all() else int(np.argmin(far))
        if count < 2:
            continue
        times = tracks.times[rows[:count]]
        rate, start = np.polyfit(times - times[0], spread[:count], 1)
        line = np.zeros(len(space.unknowns))
        for field, values in (("position", start), ("velocity", rate)):
            for axis, value in zip("xyz", values, strict=True):
                if (index := paths.get(f"objects.{name}.{field}.{axis}")) is not None:
                    line[index] = value
        if line.any():
            lines.append(line)
    return np.array(lines).reshape(-1, len(space.unknowns))
