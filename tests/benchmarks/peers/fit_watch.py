"""Simulators that count rollouts and note when the error of the best one fell: equal budgets, and time to a result."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit.problem import MakeSimulator
from polyworld.solver.rollout import Simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """After `rollouts`, and `seconds` of CPU, the least RMSE [m] of those that reached the end; inf before any did."""

    rollouts: int
    seconds: float
    rmse: float


class Watch:
    """Makes simulators as `make` does and watches what they are asked for. What the watching takes is not counted."""

    def __init__(self, make: MakeSimulator, tracks: ObservedTracks) -> None:
        self._make, self._tracks = make, tracks
        self._began, self._apart = time.process_time(), 0.0
        self.points: list[Point] = []

    @property
    def rollouts(self) -> int:
        """Rollouts so far."""
        return self.points[-1].rollouts if self.points else 0

    def __call__(self, world: World, sample_times: Array, *, n_worlds: int) -> Simulator:
        """Return a simulator that is watched."""
        return _Watched(self, self._make(world, sample_times, n_worlds=n_worlds), n_worlds)

    def note(self, batch: BatchTrajectory, worlds: int) -> None:
        """Note the least error of a batch, and the time."""
        now = time.process_time()
        best = self.points[-1].rmse if self.points else np.inf
        if batch.positions.shape[1] == len(self._tracks.frames):
            columns = [self._tracks.index(name) for name in batch.names]
            apart = batch.positions[..., :2] - self._tracks.positions[:, columns, :2]
            squares = np.where(batch.diverged, np.inf, np.mean(np.sum(apart**2, axis=-1), axis=(1, 2)))
            best = min(best, float(np.sqrt(np.nanmin(squares))))
        self.points.append(Point(self.rollouts + worlds, now - self._began - self._apart, best))
        self._apart += time.process_time() - now

    def seconds(self, rollouts: int) -> float:
        """CPU seconds [s] that the first `rollouts` took; NaN where there were fewer."""
        return next((p.seconds for p in self.points if p.rollouts >= rollouts), float("nan"))

    def seconds_to(self, rmse: float) -> float:
        """CPU seconds [s] to an RMSE [m]; NaN where it was not reached."""
        return next((p.seconds for p in self.points if p.rmse <= rmse), float("nan"))


class _Watched:
    def __init__(self, watch: Watch, simulator: Simulator, worlds: int) -> None:
        self._watch, self._simulator = watch, simulator
        self.names, self.n_worlds = simulator.names, worlds

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """See `Simulator.run`."""
        batch = self._simulator.run(overrides, samples=samples)
        self._watch.note(batch, self.n_worlds)
        return batch
