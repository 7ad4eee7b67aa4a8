"""Samples of one shard's worlds, taken as they run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.coupled.shard import Shard
from polyworld.trajectory import Event

Array = NDArray[np.float64]

MOST_BYTES = 2_000_000_000  # of points kept in one run


class Record:
    """Rigid states (W, T, n, 3 or 4), and points, velocities and quantities of each deformable object."""

    def __init__(self, shard: Shard, count: int) -> None:
        self.shard = shard
        self._count = count
        w, n = shard.n_worlds, len(shard.world.objects)
        self.rigid = [np.full((w, count, n, k), np.nan) for k in (3, 4, 3, 3)]
        # Seen once, here: for every view of records NumPy parses their layout, and threads of CPython 3.11 that parse
        # at the same time were seen to fail (SystemError: AST constructor recursion depth mismatch).
        self._bodies = buffers.Mirror(shard.rigid.bodies) if n else None
        sizes = shard.point_counts()
        asked = 48 * w * count * sum(sizes.values())
        if asked > MOST_BYTES:
            raise ValueError(
                f"{count} samples of {sum(sizes.values())} points in {w} worlds take {asked / 1e9:.2g} GB, more than "
                f"{MOST_BYTES / 1e9:.2g} GB: sample less often, or use a coarser resolution"
            )
        self.points = {name: np.full((w, count, k, 3), np.nan) for name, k in sizes.items()}
        self.velocities = {name: np.full((w, count, k, 3), np.nan) for name, k in sizes.items()}
        self.quantities: dict[str, dict[str, Array]] = {name: {} for name in sizes}

    def take(self, sample: int) -> None:
        """Keep the state of this moment as sample number `sample`."""
        shard = self.shard
        live = shard.live()
        if self._bodies is not None:
            bodies = self._bodies.pull()[:, : len(self.shard.world.objects)]
            for values, name in zip(self.rigid, ("x", "q", "v", "w"), strict=True):
                state = np.asarray(bodies[name], dtype=float)
                values[live, sample] = (np.roll(state, 1, axis=-1) if name == "q" else state)[live]
        for name, (x, v) in shard.points().items():
            self.points[name][live, sample] = x[live]
            self.velocities[name][live, sample] = v[live]
        for name, quantities in shard.quantities().items():
            for quantity, now in quantities.items():
                kept = self.quantities[name].setdefault(
                    quantity, np.full((len(now), self._count, now.shape[1]), np.nan)
                )
                kept[live, sample] = now[live]

    def divergence(self) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
        """Return the time [s], moving object and element at which each world diverged; NaN, -1, -1 where it did not."""
        return self.shard.divergence()

    def contacts_until(self) -> list[float | None]:
        """Times [s] up to which the contacts of each world are recorded; None where all are."""
        return [self.shard.contacts_until(w) for w in range(self.shard.n_worlds)]

    def events(self, times: Array) -> list[tuple[Event, ...]]:
        """Events of each world, in order of time."""
        return [self.shard.events(w, float(times[w % len(times), -1])) for w in range(self.shard.n_worlds)]
