"""Choose the samples of a rollout that a document shows, so that it stays small enough to mail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import Trajectory
from polyworld.world import World

MOST_NUMBERS = 4_000_000  # of all rollouts together: 16 MB, some 8 MB once compressed and written as text
PER_OBJECT = 16  # numbers of a state, and two energies
FINEST = 14  # bits of a coordinate of many points: a 16 000th of the largest, less than a pixel of any screen
MANY = 1000  # points of one object from which its coordinates are rounded


def numbers_per_sample(world: World, trajectory: Trajectory) -> int:
    """Count the numbers that one sample of a rollout takes."""
    points = sum(int(motion.points.shape[-2]) for motion in trajectory.deformables.values())
    pushes = 3 * sum(effect.enabled for effect in world.effects)
    return (PER_OBJECT + pushes) * len(trajectory.names) + 3 * points


def shares(needs: Sequence[int], most: int = MOST_NUMBERS) -> list[int]:
    """Divide `most` numbers among rollouts that need so many: equally, what some leave unused going to the others."""
    given, left, waiting = [0] * len(needs), most, len(needs)
    for k in sorted(range(len(needs)), key=lambda k: needs[k]):
        given[k] = min(needs[k], left // waiting)
        left, waiting = left - given[k], waiting - 1
    return given


def chosen_samples(world: World, trajectory: Trajectory, most: int) -> NDArray[np.int64]:
    """Return which samples to show: all, or every k-th and the last, of at most so many numbers (two at least)."""
    count = len(trajectory.times)
    limit = max(2, most // max(1, numbers_per_sample(world, trajectory)))
    if count <= limit:
        return np.arange(count)
    step = int(np.ceil((count - 1) / (limit - 1)))
    return np.unique(np.append(np.arange(0, count, step), count - 1))


def sampled(rows: NDArray[np.int64], count: int) -> str:
    """Return how samples were chosen from so many, in words; empty where all are shown."""
    if len(rows) == count:
        return ""
    return f"every {int(rows[1] - rows[0])}th of {count} samples and the last; events and misfits are of all"


def rounded(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return points (T, k, 3) with coordinates of many points rounded to a fraction of the largest, for compression."""
    single = points.astype(np.float32)
    if points.shape[1] < MANY:
        return single
    largest = float(np.nanmax(np.abs(points), initial=1e-6))
    step = np.float32(2.0 ** (np.ceil(np.log2(largest)) - FINEST))
    return np.round(single / step) * step


def at_samples(trajectory: Trajectory, rows: NDArray[np.int64]) -> Trajectory:
    """Return a trajectory at some of its samples."""
    return trajectory.select(rows)
