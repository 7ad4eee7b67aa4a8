"""Residuals of many settings of a world against all runs of a recording, simulated in few batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.batch import Batch, Settings, batches
from polyworld.estimation.design import Design
from polyworld.estimation.unknown import Unknown
from polyworld.world import World

__all__ = ["Forward", "Settings"]

Array = NDArray[np.float64]


@dataclass
class Forward:
    """The forward model of one world with S unknowns on a design.

    `residuals` gives simulated less observed, raw, in m, rad and rad/s; NaN rows where a rollout diverged.
    rollouts counts worlds simulated. cancelled: asked between batches; where it says so `InterruptedError` is raised.
    """

    design: Design
    world: World
    unknowns: tuple[Unknown, ...]
    cancelled: Callable[[], bool] | None = None
    rollouts: int = 0
    _batches: list[Batch] = field(default_factory=list, repr=False)

    def residuals(self, settings: Sequence[Settings], horizon: float = 1.0) -> list[Array]:
        """Return residuals (k, m) of each of the settings, in their order.

        horizon: part of each run's time that is of interest, as in `RunDesign.before`; residuals beyond it may be 0.
        """
        if self.cancelled is not None and self.cancelled():
            raise InterruptedError("cancelled")
        by_batch: dict[int, list[int]] = {}
        for i, item in enumerate(settings):
            by_batch.setdefault(self._batch_of(item.run), []).append(i)
        results = [np.empty(0)] * len(settings)
        for number, members in by_batch.items():
            chosen = [settings[i] for i in members]
            self.rollouts += sum(len(s.shared) for s in chosen)
            found = self._batches[number].residuals(self.unknowns, chosen, horizon)
            for i, own in zip(members, found, strict=True):
                results[i] = own
        return results

    def release(self) -> None:
        """Let go of all simulators; they are built again where they are needed again."""
        self._batches.clear()

    def _batch_of(self, run: int) -> int:
        """Return the batch that a run is simulated in."""
        if not self._batches:
            self._batches.extend(batches(self.world, self.design))
        return next(i for i, batch in enumerate(self._batches) if run in batch.members)
