"""Choose the samples of a rollout that a document shows, so that it stays small enough to mail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import Trajectory

MOST_NUMBERS = 4_000_000  # of all rollouts together: 16 MB, some 8 MB once compressed and written as text
PER_OBJECT = 14  # numbers of a rigid state with what is derived from it


def numbers_per_sample(trajectory: Trajectory) -> int:
    """Count the numbers that one sample of a rollout takes."""
    points = sum(int(motion.points.shape[-2]) for motion in trajectory.deformables.values())
    return PER_OBJECT * len(trajectory.names) + 3 * points


def shares(needs: Sequence[int], most: int = MOST_NUMBERS) -> list[int]:
    """Divide `most` numbers among rollouts that need so many: equally, what some leave unused going to the others."""
    given, left, waiting = [0] * len(needs), most, len(needs)
    for k in sorted(range(len(needs)), key=lambda k: needs[k]):
        given[k] = min(needs[k], left // waiting)
        left, waiting = left - given[k], waiting - 1
    return given


def chosen_samples(trajectory: Trajectory, most: int) -> NDArray[np.int64]:
    """Return which samples to show: all, or every k-th and the last, of at most so many numbers (two at least)."""
    count = len(trajectory.times)
    limit = max(2, most // max(1, numbers_per_sample(trajectory)))
    if count <= limit:
        return np.arange(count)
    step = int(np.ceil((count - 1) / (limit - 1)))
    return np.unique(np.append(np.arange(0, count, step), count - 1))


def at_samples(trajectory: Trajectory, rows: NDArray[np.int64]) -> Trajectory:
    """Return a trajectory at some of its samples."""
    return Trajectory(
        names=trajectory.names,
        times=trajectory.times[rows],
        positions=trajectory.positions[rows],
        orientations=trajectory.orientations[rows],
        velocities=trajectory.velocities[rows],
        angular_velocities=trajectory.angular_velocities[rows],
        active=trajectory.active[rows],
        deformables={name: motion.select(rows) for name, motion in trajectory.deformables.items()},
    )
