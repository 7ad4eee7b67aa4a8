"""Simulate all segments of a problem at many settings of its unknowns, in few batches."""

from __future__ import annotations

from collections.abc import Callable

from polyworld.estimation import forward
from polyworld.estimation.forward import Ends, Outcome, Settings
from polyworld.estimation.problem import Problem
from polyworld.estimation.unknown import Unknown
from polyworld.world import World

__all__ = ["Ends", "Forward", "Outcome", "Settings"]


class Forward(forward.Forward):
    """The forward model of one world with S unknowns on a problem; a setting's run is the index of a segment."""

    def __init__(
        self,
        problem: Problem,
        world: World,
        unknowns: tuple[Unknown, ...],
        cancelled: Callable[[], bool] | None = None,
    ) -> None:
        super().__init__(problem.parts, world, unknowns, cancelled)
        self.problem = problem
