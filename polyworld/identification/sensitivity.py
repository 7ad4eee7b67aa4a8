"""How well the data determine each parameter: sensitivities around the optimum, by one batch of rollouts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.forward import ForwardModel

Array = NDArray[np.float64]

# Standard deviation of a uniform distribution, as a share of its width.
UNIFORM = 1.0 / np.sqrt(12.0)
# A parameter is undetermined when the data leave more than this share of what its bounds allowed.
UNDETERMINED = 0.7
# Quotients of two steps that differ in size by more than this factor: the response is not smooth.
ROUGH = 1.5


@dataclass(frozen=True)
class Sensitivity:
    """Laplace approximation at an optimum.

    standard_error (P,): standard deviations in search coordinates, given the data, the priors and a flat belief
    within the bounds. insensitive (P,): no observation changes with the parameter. undetermined (P,): the data
    leave more than `UNDETERMINED` of the flat belief's spread. combinations: sets of parameter indices of
    which the data fix less than their number, each with its direction. noise_factor: residual variance over
    the stated one. correlation_time: of the residuals, in samples; both widen the errors.
    """

    standard_error: Array
    insensitive: NDArray[np.bool_]
    undetermined: NDArray[np.bool_]
    combinations: tuple[tuple[int, ...], ...]
    noise_factor: float
    correlation_time: float


def sensitivity(forward: ForwardModel, optimum: Array, samples: int) -> Sensitivity:
    """Standard errors and undetermined directions at search coordinates `optimum` (P,).

    The covariance of an estimate that minimises a weighted sum of squares is H^-1 M H^-1 with H = J' W J and M
    the covariance of the gradient (Huber 1967, "sandwich"); J comes from central differences. In M the
    residuals of each object and kind have the variance they show, times their correlation time, since
    residuals correlated in time carry less information than their number says (Priestley, Spectral Analysis
    and Time Series, 5.3.2). A flat belief within the bounds keeps what the data leave open finite.
    Costs 4 P + 2 rollouts, and 2 P more in coupled worlds and where the response is rough.
    """
    space = forward.space
    width = space.upper - space.lower
    weights = forward.huber_weights(optimum, samples)
    residual = forward.residuals(optimum[None], samples)[0]
    if not np.all(np.isfinite(residual)):
        raise ValueError("the rollout at the optimum diverged: its sensitivity is not defined")
    noise = _noise(forward, residual, weights, samples, len(optimum))
    flat = UNIFORM * width
    # Steps of about one standard error see the response at the scale that matters: first a small step, to
    # learn that scale, then the step that fits it.
    first = difference_quotients(forward, optimum, 1e-3 * width, samples)
    _, error = _posterior(first * flat, weights, noise)
    steps = np.clip(error * flat, 1e-5 * width, 0.02 * width)
    jacobian = difference_quotients(forward, optimum, steps, samples)
    jacobian = _smoothed(forward, optimum, samples, [(1e-3 * width, first), (steps, jacobian)], weights)
    information, error = _posterior(jacobian * flat, weights, noise)
    insensitive = np.sqrt(np.diag(information)) < 0.1
    return Sensitivity(
        standard_error=error * flat,
        insensitive=insensitive,
        undetermined=error > UNDETERMINED,
        combinations=_combinations(information, insensitive),
        noise_factor=noise.variance,
        correlation_time=noise.correlation_time,
    )


def difference_quotients(forward: ForwardModel, at: Array, steps: Array, samples: int) -> Array:
    """Jacobian (r, P) of the residuals by central differences, one-sided where a bound is in the way.

    Entries whose rollouts diverged are zero: nothing can be said about them.
    """
    space = forward.space
    up = np.minimum(at + steps, space.upper)
    down = np.maximum(at - steps, space.lower)
    candidates = np.repeat(at[None], 2 * len(at), axis=0)
    index = np.arange(len(at))
    candidates[index, index] = up
    candidates[len(at) + index, index] = down
    residuals = forward.residuals(candidates, samples)
    jacobian = (residuals[: len(at)] - residuals[len(at) :]).T / (up - down)
    return np.where(np.isfinite(jacobian), jacobian, 0.0)


def _smoothed(
    forward: ForwardModel, at: Array, samples: int, tried: list[tuple[Array, Array]], weights: Array
) -> Array:
    """The last Jacobian (r, P) of `tried` (steps (P,), Jacobian), or one from wider steps where the response is rough.

    A turbulent fluid or a contact that comes and goes answers a small step with jumps: its quotient grows as the step
    shrinks, and would pass for knowledge. In coupled worlds, and where quotients of two steps differ in size by more
    than `ROUGH`, one across a fiftieth of the range is taken too; where it differs, the smallest counts (a Jacobian of
    zeros is one of rollouts that diverged, and does not).
    """
    width = forward.space.upper - forward.space.lower
    (_, first), (_, last) = tried
    if not forward.world.coupled and not _differ(np.stack([first, last]), weights).any():
        return last
    wide = difference_quotients(forward, at, 0.02 * width, samples)
    options = np.stack([first, last, wide])
    squares = (weights[None, :, None] * options**2).sum(axis=1)
    least = np.argmin(np.where(squares > 0.0, squares, np.inf), axis=0)
    smallest = np.take_along_axis(options, least[None, None, :], axis=0)[0]
    return np.where(_differ(options, weights), smallest, last)


def _differ(options: Array, weights: Array) -> NDArray[np.bool_]:
    """Which parameters' columns (P,) of Jacobians (n, r, P) differ in size by more than `ROUGH`, zeros aside."""
    sizes = np.sqrt((weights[None, :, None] * options**2).sum(axis=1))
    largest = sizes.max(axis=0)
    smallest = np.where(sizes > 0.0, sizes, np.inf).min(axis=0)
    differ: NDArray[np.bool_] = largest > ROUGH * np.where(np.isfinite(smallest), smallest, np.inf)
    return differ


@dataclass(frozen=True)
class _Noise:
    """Variance and correlation time over all series, and their product for every residual (r,)."""

    variance: float
    correlation_time: float
    inflation: Array


def _posterior(jacobian: Array, weights: Array, noise: _Noise) -> tuple[Array, Array]:
    # In coordinates in which the flat belief has unit variance: information matrix, standard errors.
    mean = max(noise.variance * noise.correlation_time, 1e-300)
    information = (jacobian * weights[:, None]).T @ jacobian / mean
    gradient = (jacobian * (weights * noise.inflation / mean)[:, None]).T @ jacobian / mean
    bread = np.linalg.inv(information + np.eye(len(information)))
    covariance = bread @ (gradient + np.eye(len(information))) @ bread
    return information, np.minimum(np.sqrt(np.diag(covariance)), 1.0)


def _noise(forward: ForwardModel, residual: Array, weights: Array, samples: int, parameters: int) -> _Noise:
    groups = forward.objective.series(samples)
    weighted = residual * np.sqrt(weights)
    count = sum(rows.size for rows in groups)
    # Every fitted parameter takes one degree of freedom from the whole.
    correction = count / max(count - parameters, 1)
    inflation = np.ones(len(residual))  # the priors' residuals, which come last, are what they say they are
    total, times = 0.0, 0.0
    for rows in groups:
        squares = float((weighted[rows] ** 2).sum())
        variance = max(correction * squares / rows.size, 1e-12)
        time = _correlation_time(weighted[rows])
        inflation[rows] = variance * time
        total += squares
        times += time * squares
    if total <= 0.0:
        return _Noise(1e-12, 1.0, inflation)
    return _Noise(correction * total / count, times / total, inflation)


def _correlation_time(series: Array) -> float:
    """1 + 2 times the sum of the autocorrelations of series (T, d) up to the first negative one, in samples."""
    length = len(series)
    lagged = np.zeros(length)
    for component in series.T:
        lagged += np.correlate(component, component, mode="full")[length - 1 :]
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
    found: list[tuple[int, ...]] = []
    for vector in vectors.T[weak]:
        members = sensitive[np.abs(vector) > 0.3]
        if len(members) > 1:
            found.append(tuple(int(m) for m in members))
    return tuple(found)
