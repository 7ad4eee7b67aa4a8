"""Local least squares from a given point: Levenberg-Marquardt with derivatives from batches of rollouts.

A separate method with a name of its own, to polish what a global search found; it does not leave a basin.
Marquardt (1963); bounds by projection; Huber's loss by iterated weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.world_fit.problem import DescentStep, FitProblem
from polyworld.estimation.world_fit.result import FitResult, LossPoint, Status
from polyworld.estimation.world_fit.search import Cancelled

Array = NDArray[np.float64]

# Factors on the step of the differences, tried in turn while no trial improves: a collision puts kinks into the
# residuals, which a smaller step looks between and a larger one looks across.
SPANS = (1.0, 0.3, 3.0, 0.1, 10.0)
STEP = 1e-3  # of the differences, as a share of a parameter's range
TOLERANCE = 1e-4  # converged when the loss falls by less than this share of itself
# Loss up to which only noise is left: a perfect model exceeds it once in a thousand fits to 100 observed components
# (chi-square), and never to more.
GOOD = 1.5
# Trial dampings of one iteration, as factors of the last successful one: tried in a single batch.
TRIALS = 10.0 ** np.arange(-3.0, 5.0)


def refine(
    problem: FitProblem,
    start: dict[str, float] | None = None,
    *,
    iterations: int = 20,
    cancelled: Cancelled | None = None,
) -> FitResult:
    """Polish parameter values by name (default: the unknowns' starts); an iteration costs 2 P + 10 rollouts."""
    problem.begin()
    at = problem.space.mean if start is None else problem.space.coordinates(start)
    at, history, status = descend(problem, at, problem.samples, iterations=iterations, cancelled=cancelled)
    return problem.finish("refine", status, at, None, history, 0)


def descend(
    problem: FitProblem,
    at: Array,
    samples: int,
    *,
    iterations: int,
    tolerance: float = TOLERANCE,
    enough: float = 0.0,
    cancelled: Cancelled | None = None,
) -> tuple[Array, list[LossPoint], Status]:
    """Minimise the loss over the first `samples` samples from search coordinates (P,), by Levenberg-Marquardt.

    Only unknowns that can show by then are varied. tolerance: converged when the loss falls by less than this share.
    enough: loss at or below which that is so at once; above it, other steps of the differences are tried first.
    """
    space = problem.space
    entered = space.entered(float(problem.objective.sample_times[samples - 1]))
    judged = problem.judged(at[None], samples)
    loss, error = float(judged.losses[0]), float(judged.errors[0])
    damping, span = 1e-2, 0
    history: list[LossPoint] = []
    status: Status = "completed"
    for iteration in range(iterations):
        if cancelled is not None and cancelled():
            status = "cancelled"
            break
        steps = STEP * SPANS[span] * space.width
        jacobian = problem.difference_quotients(at, steps, samples, entered) * space.width
        weights = problem.huber_weights(at, samples)
        gradient = jacobian.T @ (weights * problem.residuals(at[None], samples)[0])
        hessian = (jacobian * weights[:, None]).T @ jacobian
        # Parameters held by a bound that the step would leave take no part in it.
        free = entered & ~(((at <= space.lower) & (gradient > 0.0)) | ((at >= space.upper) & (gradient < 0.0)))
        scale = np.diag(hessian)[free] + 1e-9 * max(float(np.diag(hessian).max()), 1e-12)
        candidates = np.repeat(at[None], len(TRIALS), axis=0)
        for row, factor in enumerate(TRIALS):
            matrix = hessian[np.ix_(free, free)] + np.diag(damping * factor * scale)
            candidates[row, free] -= np.linalg.solve(matrix, gradient[free]) * space.width[free]
        candidates = np.clip(candidates, space.lower, space.upper)
        judged = problem.judged(candidates, samples)
        losses = judged.losses
        best = int(np.argmin(losses))
        history.append(LossPoint(iteration, 0, samples, float(losses[best]), float(np.median(losses))))
        gain = (loss - losses[best]) / loss if loss > 0.0 else 0.0
        if losses[best] < loss:
            at, loss, error = candidates[best], float(losses[best]), float(judged.errors[best])
            damping = float(np.clip(damping * TRIALS[best], 1e-9, 1e6))
        if problem.watch is not None:
            problem.watch(DescentStep(iteration + 1, iterations, samples, float(judged.errors[best]), error, loss))
        span = span + 1 if gain < tolerance else 0
        if span == len(SPANS) or (span and loss <= enough):
            break
    return at, history, status
