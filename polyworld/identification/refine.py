"""Local least squares from a given point: Levenberg-Marquardt with derivatives from batches of rollouts.

A separate method with a name of its own, to polish what a global search found; it does not leave a basin.
Marquardt (1963); bounds by projection; Huber's loss by iterated weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.fit import Cancelled
from polyworld.identification.forward import MakeSimulator
from polyworld.identification.free_parameters import FitParameter
from polyworld.identification.objective import ObjectiveSettings
from polyworld.identification.problem import Problem
from polyworld.identification.result import FitResult, LossPoint
from polyworld.identification.sensitivity import difference_quotients
from polyworld.rollout import simulator
from polyworld.tracks import ObservedTracks
from polyworld.world import World

Array = NDArray[np.float64]

# Factors on the step of the differences, tried in turn while no trial improves: a collision puts kinks into the
# residuals, which a smaller step looks between and a larger one looks across.
SPANS = (1.0, 0.3, 3.0, 0.1, 10.0)
# Trial dampings of one iteration, as factors of the last successful one: tried in a single batch.
TRIALS = 10.0 ** np.arange(-3.0, 5.0)


@dataclass(frozen=True)
class RefineSettings:
    """iterations at most; converged when the loss falls by less than `tolerance` of itself. step: finite
    differences as a share of a parameter's range. Other fields as in `FitSettings`."""

    iterations: int = 20
    tolerance: float = 1e-4
    step: float = 1e-3
    batch: int = 64
    objective: ObjectiveSettings = field(default_factory=ObjectiveSettings)
    prior_weight: float = 1.0
    holdout_from: int | None = None


def refine(
    world: World,
    tracks: ObservedTracks,
    parameters: Sequence[FitParameter],
    start: dict[str, float] | None = None,
    *,
    settings: RefineSettings | None = None,
    cancelled: Cancelled | None = None,
    make_simulator: MakeSimulator = simulator,
) -> FitResult:
    """Polish parameter values by name (default: the parameters' means); an iteration costs 2 P + 10 rollouts."""
    settings = settings or RefineSettings()
    problem = Problem.of(
        world,
        tracks,
        parameters,
        objective=settings.objective,
        holdout_from=settings.holdout_from,
        batch=settings.batch,
        prior_weight=settings.prior_weight,
        make_simulator=make_simulator,
    )
    space, forward = problem.space, problem.forward
    at = space.mean if start is None else space.coordinates(start)
    width = space.upper - space.lower
    loss = problem.loss(at)
    damping, span = 1e-2, 0
    history: list[LossPoint] = []
    stopped = False
    for iteration in range(settings.iterations):
        if cancelled is not None and cancelled():
            stopped = True
            break
        step = settings.step * SPANS[span]
        jacobian = difference_quotients(forward, at, step * width, forward.samples) * width
        weights = forward.huber_weights(at, forward.samples)
        residual = forward.residuals(at[None], forward.samples)[0]
        gradient = jacobian.T @ (weights * residual)
        hessian = (jacobian * weights[:, None]).T @ jacobian
        # Parameters held by a bound that the step would leave take no part in it.
        free = ~(((at <= space.lower) & (gradient > 0.0)) | ((at >= space.upper) & (gradient < 0.0)))
        scale = np.diag(hessian)[free] + 1e-9 * max(float(np.diag(hessian).max()), 1e-12)
        candidates = np.repeat(at[None], len(TRIALS), axis=0)
        for row, factor in enumerate(TRIALS):
            matrix = hessian[np.ix_(free, free)] + np.diag(damping * factor * scale)
            candidates[row, free] -= np.linalg.solve(matrix, gradient[free]) * width[free]
        candidates = np.clip(candidates, space.lower, space.upper)
        losses = forward.losses(candidates, forward.samples)
        best = int(np.argmin(losses))
        history.append(LossPoint(iteration, 0, forward.samples, float(losses[best]), float(np.median(losses))))
        gain = (loss - losses[best]) / loss if loss > 0.0 else 0.0
        if losses[best] < loss:
            at, loss = candidates[best], float(losses[best])
            damping = float(np.clip(damping * TRIALS[best], 1e-9, 1e6))
        if gain < settings.tolerance:
            span += 1
            if span == len(SPANS):
                break
        else:
            span = 0
    return problem.finish("refine", "cancelled" if stopped else "completed", at, None, history, 0)
