"""Observed shapes as entries of a fit: which of a series' values count, and how far a batch of rollouts is from them.

Every observed value becomes one entry; entries are ordered by time, so that a shorter horizon is a prefix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.readouts import Centreline, Readout, check_readable, read
from polyworld.shape_series import ShapeSeries
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Standardised difference of a value where the rollout has nothing to compare, such as the front of a fluid that has
# not flowed yet: far more than any misfit, and finite, so that such a world is bad rather than undefined.
ABSENT = 100.0


@dataclass(frozen=True)
class ShapeEntries:
    """One series of a track record against one world. sample, entry (n,): frame row and index in the readout."""

    world: World
    series: ShapeSeries
    sample: Ints
    entry: Ints
    weight: Array
    axes: Array | None

    @classmethod
    def of(cls, world: World, series: ShapeSeries, times: Array) -> ShapeEntries:
        """The observed values from the object's start on; raises ValueError where the world has no such readout."""
        check_readable(series.readout, world)
        start = getattr(world.deformable(series.object), "start_time", 0.0)
        seen = (series.confidence > 0.0) & (times >= start - 1e-9)[:, None]
        sample, entry = np.nonzero(seen)  # row-major: ordered by time
        in_space = series.values.shape[2] == 3 and getattr(series.readout, "view", "image") == "world"
        frame = geometry.plane_axes(world.environment.motion_plane)
        return cls(
            world=world,
            series=series,
            sample=sample.astype(np.int64),
            entry=entry.astype(np.int64),
            weight=series.confidence[sample, entry],
            # What happens along a motion plane's normal is outside the model.
            axes=frame[:2] if world.planar and in_space else None,
        )

    @property
    def readout(self) -> Readout:
        """What was measured."""
        return self.series.readout

    @property
    def components(self) -> int:
        """Components of one entry's difference."""
        return self.series.values.shape[2] if self.axes is None else 2

    def before(self, samples: int) -> int:
        """How many entries belong to the first `samples` sample times."""
        return int(np.searchsorted(self.sample, samples, side="left"))

    def differences(self, batch: BatchTrajectory) -> Array:
        """Simulated minus observed values (W, n, c), in the readout's unit, for the samples the batch holds."""
        samples = batch.positions.shape[1]
        count = self.before(samples)
        observed = self.series.values[:samples]
        simulated = read(self.readout, self.world, batch, observed)
        if simulated.shape[-2:] != observed.shape[-2:]:
            raise ValueError(
                f"{self.readout.kind} of {self.series.object!r}: observed {observed.shape[1:]} entries and components, "
                f"the world has {simulated.shape[-2:]}"
            )
        difference = simulated - observed
        if isinstance(self.readout, Centreline) and not self.readout.directed:
            difference = self._nearer_direction(difference, simulated[..., ::-1, :] - observed)
        if self.axes is not None:
            difference = difference @ self.axes.T
        chosen: Array = difference[:, self.sample[:count], self.entry[:count]]
        return chosen

    def standardised(self, batch: BatchTrajectory) -> Array:
        """Differences (W, n, c) over their standard deviations; `ABSENT` where the rollout has nothing."""
        difference = self.differences(batch)
        count = difference.shape[1]
        residual = difference / self.sigma(count)[:, None]
        return np.where(np.isfinite(residual), residual, ABSENT)

    def sigma(self, count: int) -> Array:
        """Standard deviations (count,) of the first entries."""
        chosen: Array = self.series.sigma[self.sample[:count], self.entry[:count]]
        return chosen

    def groups(self, samples: int) -> list[Ints]:
        """Entries in the order of time, grouped as (T, e): all at once where the same are seen in every frame."""
        count = self.before(samples)
        sample, entry = self.sample[:count], self.entry[:count]
        frames = np.unique(sample)
        entries = np.unique(entry)
        if count == len(frames) * len(entries):
            return [np.arange(count).reshape(len(frames), len(entries))]
        return [np.flatnonzero(entry == e)[:, None] for e in entries]

    def _nearer_direction(self, forward: Array, backward: Array) -> Array:
        weight = np.nan_to_num(self.series.confidence[: forward.shape[-3]])
        cost = [(np.nan_to_num(d) ** 2).sum(axis=-1) * weight for d in (forward, backward)]
        turned = cost[1].sum(axis=-1) < cost[0].sum(axis=-1)
        return np.where(turned[..., None, None], backward, forward)
