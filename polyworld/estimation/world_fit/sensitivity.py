"""How well the data determine each parameter: sensitivities around the optimum, by one batch of rollouts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from polyworld.estimation.world_fit.problem import FitProblem

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Standard deviation of a uniform distribution, as a share of its width.
UNIFORM = 1.0 / np.sqrt(12.0)
# A parameter is undetermined when the data leave more than this share of what its bounds allowed.
UNDETERMINED = 0.7
# Quotients of two steps that differ in size by more than this factor: the response is not smooth.
ROUGH = 1.5
# Steps of differences, as shares of a parameter's range.
FIRST_STEP, LEAST_STEP, WIDE_STEP = 1e-3, 1e-5, 0.02


@dataclass(frozen=True)
class Sensitivity:
    """Laplace approximation at an optimum.

    standard_error (P,): standard deviations in search coordinates, given the data, the priors and a flat belief
    within the bounds. insensitive (P,): no observation changes with the parameter. undetermined (P,): the data
    leave more than `UNDETERMINED` of the flat belief's spread. combinations: sets of parameter indices of
    which the data fix less than their number, each with its direction. noise_factor: residual variance over
    the stated one. correlation_time: of the residuals, in samples; both widen the errors. jacobian (r, P): of the
    residuals. misfit_weight (r,): robust weight over the variance of each residual, which is the stated one times
    the reduced chi-square and the correlation time of its series, where their product exceeds 1.
    """

    standard_error: Array
    insensitive: NDArray[np.bool_]
    undetermined: NDArray[np.bool_]
    combinations: tuple[tuple[int, ...], ...]
    noise_factor: float
    correlation_time: float
    jacobian: Array
    misfit_weight: Array


def sensitivity(problem: FitProblem, optimum: Array) -> Sensitivity:
    """Estimate standard errors and undetermined directions at search coordinates `optimum` (P,).

    The covariance of an estimate that minimises a weighted sum of squares is H^-1 M H^-1 with H = J' W J and M
    the covariance of the gradient (Huber 1967, "sandwich"); J comes from central differences. In M the
    residuals of each object and kind have the variance they show, times their correlation time, since
    residuals correlated in time carry less information than their number says (Priestley, Spectral Analysis
    and Time Series, 5.3.2). A flat belief within the bounds keeps what the data leave open finite.
    Costs 4 P + 2 rollouts, and 2 P more in coupled worlds and where the response is rough.
    """
    width = problem.space.width
    flat = UNIFORM * width
    weights = problem.huber_weights(optimum)
    residual = problem.residuals(optimum[None])[0]
    if not np.all(np.isfinite(residual)):
        raise ValueError("the rollout at the optimum diverged: its sensitivity is not defined")
    variance, correlation_time, inflation = _noise(problem, residual * np.sqrt(weights), len(optimum))
    # Of every residual relative to the mean over all.
    mean = max(variance * correlation_time, 1e-300)
    noise = mean, inflation / mean
    # Steps of about one standard error see the response at the scale that matters: first a small step, to
    # learn that scale, then the step that fits it.
    first = problem.difference_quotients(optimum, FIRST_STEP * width)
    _, error = _posterior(first * flat, weights, noise)
    last = problem.difference_quotients(optimum, np.clip(error * flat, LEAST_STEP * width, WIDE_STEP * width))
    # A turbulent fluid or a contact that comes and goes answers a small step with jumps: its quotient grows as the
    # step shrinks, and would pass for knowledge. A wide step is taken too, and where they differ the smallest counts.
    if problem.world.coupled or _differ(np.stack([first, last]), weights).any():
        wide = problem.difference_quotients(optimum, WIDE_STEP * width)
        options = np.stack([first, last, wide])
        least = np.argmin(_sizes(options, weights), axis=0)
        smallest = np.take_along_axis(options, least[None, None, :], axis=0)[0]
        last = np.where(_differ(options, weights), smallest, last)
    information, error = _posterior(last * flat, weights, noise)
    insensitive = np.sqrt(np.diag(information)) < 0.1
    return Sensitivity(
        standard_error=error * flat,
        insensitive=insensitive,
        undetermined=error > UNDETERMINED,
        combinations=_combinations(information, insensitive),
        noise_factor=variance,
        correlation_time=correlation_time,
        jacobian=last,
        misfit_weight=weights / np.maximum(inflation, 1.0),
    )


def _sizes(options: Array, weights: Array) -> Array:
    """Return sizes (n, P) of the columns of Jacobians (n, r, P); infinite for zeros, which are of rollouts that
    diverged."""
    sizes = np.sqrt((weights[None, :, None] * options**2).sum(axis=1))
    return np.where(sizes > 0.0, sizes, np.inf)


def _differ(options: Array, weights: Array) -> NDArray[np.bool_]:
    """Return which parameters' columns (P,) of Jacobians (n, r, P) differ in size by more than `ROUGH`, zeros aside."""
    sizes = _sizes(options, weights)
    differ: NDArray[np.bool_] = np.where(np.isfinite(sizes), sizes, 0.0).max(axis=0) > ROUGH * sizes.min(axis=0)
    return differ


def _posterior(jacobian: Array, weights: Array, noise: tuple[float, Array]) -> tuple[Array, Array]:
    # In coordinates in which the flat belief has unit variance: information matrix, standard errors.
    mean, inflation = noise
    information = (jacobian * weights[:, None]).T @ jacobian / mean
    gradient = (jacobian * (weights * inflation)[:, None]).T @ jacobian / mean
    bread = np.linalg.inv(information + np.eye(len(information)))
    covariance = bread @ (gradient + np.eye(len(information))) @ bread
    return information, np.minimum(np.sqrt(np.diag(covariance)), 1.0)


def _noise(problem: FitProblem, weighted: Array, parameters: int) -> tuple[float, float, Array]:
    """Variance and correlation time over all series, and their product for every residual (r,)."""
    series = problem.objective.series(problem.samples)
    count = sum(places.size for places, _, _ in series)
    # Every fitted parameter takes one degree of freedom from the whole.
    correction = count / max(count - parameters, 1)
    inflation = np.ones(len(weighted))  # the priors' residuals, which come last, are what they say they are
    total, times = 0.0, 0.0
    for places, sample, column in series:
        squares = float((weighted[places] ** 2).sum())
        time = _correlation_time(weighted[places], sample, column)
        inflation[places] = max(correction * squares / places.size, 1e-12) * time
        total += squares
        times += time * squares
    if total <= 0.0:
        return 1e-12, 1.0, inflation
    return correction * total / count, times / total, inflation


def _correlation_time(values: Array, sample: Ints, column: Ints) -> float:
    """Return 1 + 2 times the sum of the autocorrelations of values (n, d) up to the first negative one, in samples.

    sample, column (n,): when and of which of the values at one instant; instants at which nothing was seen are left
    out.
    """
    instants, row = np.unique(sample, return_inverse=True)
    seen = np.zeros((len(instants), int(column.max()) + 1, values.shape[1]))
    seen[row, column] = values
    length = len(seen)
    spectrum = np.abs(np.fft.rfft(seen.reshape(length, -1), n=2 * length, axis=0)) ** 2
    lagged = np.fft.irfft(spectrum.sum(axis=1))[:length]
    if lagged[0] <= 0.0:
        return 1.0
    rho = lagged[1:] / lagged[0]
    # Beyond the first negative value the estimate is noise (initial positive sequence).
    end = int(np.argmax(rho <= 0.0)) if np.any(rho <= 0.0) else len(rho)
    return float(1.0 + 2.0 * rho[:end].sum())


def _combinations(scaled: Array, insensitive: NDArray[np.bool_]) -> tuple[tuple[int, ...], ...]:
    sensitive = np.flatnonzero(~insensitive)
    if len(sensitive) == 0:
        return ()
    values, vectors = np.linalg.eigh(scaled[np.ix_(sensitive, sensitive)])
    # Along a direction of information i the flat belief of variance 1 shrinks to 1 / (1 + i).
    weak = values < 1.0 / UNDETERMINED**2 - 1.0
    groups = [tuple(int(m) for m in sensitive[np.abs(vector) > 0.3]) for vector in vectors.T[weak]]
    return tuple(group for group in groups if len(group) > 1)
