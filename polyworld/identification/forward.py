"""Losses and residuals of many candidates at once, by batches of rollouts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.free_parameters import SearchSpace
from polyworld.identification.objective import Objective
from polyworld.readouts import object_mesh
from polyworld.representations.fluid import Fluid
from polyworld.rollout import Simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Deformable, World

Array = NDArray[np.float64]


MOST_BYTES = 500_000_000  # of points of deformable objects in one run


class MakeSimulator(Protocol):
    """Anything that makes a simulator as `polyworld.rollout.simulator` does."""

    def __call__(self, world: World, sample_times: Array, *, n_worlds: int) -> Simulator: ...


class ForwardModel:
    """Candidates in search coordinates in, losses or residuals out; counts the rollouts it asks for.

    batch: worlds of one simulator run at most, fewer where the points of deformable objects would take more than
    `MOST_BYTES`. What is left of the candidates runs in a smaller simulator, of a power of two of worlds, filled
    up with copies that are not counted.
    """

    def __init__(
        self,
        world: World,
        objective: Objective,
        space: SearchSpace,
        make_simulator: MakeSimulator,
        *,
        batch: int,
        prior_weight: float = 1.0,
    ) -> None:
        self.world = world
        self.objective = objective
        self.space = space
        self.rollouts = 0
        self._batch = min(batch, most_worlds(world, objective.sample_times))
        self._prior_weight = prior_weight
        self._make_simulator = make_simulator
        self._simulators: dict[int, Simulator] = {}

    @property
    def samples(self) -> int:
        """Number of sample times of the full horizon."""
        return len(self.objective.sample_times)

    def losses(self, candidates: Array, samples: int) -> Array:
        """Loss (N,) of candidates (N, P) over the first `samples` sample times.

        With the prior: D + lambda R, where R is the sum of squared prior residuals over the same normaliser
        as the data's, so that for lambda = 1 the minimum is the most probable value.
        """
        losses = self._over(candidates, samples, self.objective.losses)
        prior = (self.space.prior_residuals(candidates) ** 2).sum(axis=1)
        total: Array = losses + self._prior_weight * prior / self.objective.weight(samples)
        return total

    def residuals(self, candidates: Array, samples: int) -> Array:
        """Weighted standardised residuals (N, r) of candidates (N, P), the prior's last; NaN rows where diverged."""
        data = self._over(candidates, samples, self.objective.residuals)
        prior = np.sqrt(self._prior_weight) * self.space.prior_residuals(candidates)
        return np.concatenate([data, prior], axis=1)

    def huber_weights(self, candidate: Array, samples: int) -> Array:
        """Weights (r,) of iterated least squares at one candidate (P,), 1 for the prior's residuals."""
        data = self._over(candidate[None], samples, self.objective.huber_weights)[0]
        count = sum(p.prior is not None for p in self.space.parameters)
        return np.concatenate([data, np.ones(count)])

    def _over(self, candidates: Array, samples: int, measure: Callable[[BatchTrajectory], Array]) -> Array:
        parts: list[Array] = []
        for begin in range(0, len(candidates), self._batch):
            part = candidates[begin : begin + self._batch]
            size = min(self._batch, 1 << (len(part) - 1).bit_length())
            filled = np.concatenate([part, np.repeat(part[-1:], size - len(part), axis=0)])
            batch = self._of_size(size).run(self.space.overrides(filled), samples=samples)
            parts.append(measure(batch)[: len(part)])
            self.rollouts += len(part)
        return np.concatenate(parts)

    def _of_size(self, size: int) -> Simulator:
        if size not in self._simulators:
            self._simulators[size] = self._make_simulator(self.world, self.objective.sample_times, n_worlds=size)
        return self._simulators[size]


def most_worlds(world: World, sample_times: Array) -> int:
    """Worlds of which one run may keep the motion: a power of two, at least 1."""
    samples, horizon = len(sample_times), float(sample_times[-1]) if len(sample_times) else 0.0
    points = sum(_most_points(world, item, horizon) for item in world.deformables)
    worlds = MOST_BYTES // max(48 * points * samples, 1)
    return 1 << max(int(worlds).bit_length() - 1, 0)


def _most_points(world: World, item: Deformable, horizon: float) -> int:
    """Points that a motion of one object may have room for; particles of all fluids are kept together."""
    if not isinstance(item, Fluid) or world.fluid_grid is None:
        return len(object_mesh(world, item.name).nodes)
    volume = (world.fluid_grid.cell / 2.0) ** (2 if item.representation == "fluid_planar" else 3)
    there = sum(len(object_mesh(world, d.name).nodes) for d in world.deformables if isinstance(d, Fluid))
    return there + int(sum(e.rate for e in world.emitters) * horizon / volume)
