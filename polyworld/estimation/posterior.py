"""Sample the posterior of a study: population Monte Carlo over shared unknowns, initial states eliminated by run.

Around the minimum initial states follow the shared unknowns linearly and scatter by their own information; what is
left is a density over a few constants that priors and bounds make anything but Gaussian: friction and damping lie in a
valley, and what was never observed keeps its prior. Draws from a Student t distribution with the mean and covariance of
the round before are weighted by the density over that of all rounds' proposals (Cappe et al. 2004, J. Comput. Graph.
Stat. 13, 907; weights of Owen & Zhou 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from polyworld.estimation.least_squares import Minimum, Point, Problem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SamplingSettings:
    """rounds of `draws` each. freedom: of the t distribution, whose tails cover what a Gaussian would miss."""

    rounds: int = 4
    draws: int = 192
    freedom: float = 6.0


@dataclass(frozen=True)
class Posterior:
    """Equally probable settings. shared (N, S): coordinates; states[run][block] (N, n). effective: sample size."""

    shared: Array
    states: tuple[tuple[Array, ...], ...]
    effective: float


def sample(
    problem: Problem, found: Minimum, count: int, seed: int, settings: SamplingSettings | None = None
) -> Posterior:
    """Draw settings from the posterior about a minimum.

    Where residuals exceed the measured noise the model is wrong by the rest, and says less by that factor.
    """
    settings = settings or SamplingSettings()
    remainder = problem.remainder(found)
    rng = np.random.default_rng([seed, 0x5A])
    normal, centre = found.normal, found.point.shared
    s = len(centre)
    answers, widths = [], []
    information = normal.shared.copy()
    for own, border in zip(normal.own, normal.border, strict=True):
        inverse = np.linalg.pinv(own + 1e-9 * np.eye(len(own)), hermitian=True) if len(own) else own
        answers.append(-inverse @ border)
        information -= border.T @ inverse @ border
        values, vectors = np.linalg.eigh(inverse) if len(own) else (np.zeros(0), inverse)
        widths.append(vectors * np.sqrt(np.maximum(values, 0.0) * remainder))
    information /= remainder
    flat = ((problem.upper - problem.lower) / np.sqrt(12.0)) ** -2.0  # no wider than the bounds
    covariance = np.linalg.inv(information + np.diag(flat)) if s else np.zeros((0, 0))
    mean = np.clip(centre, problem.lower, problem.upper)
    draws: list[Array] = [np.zeros((0, s))]
    targets: list[Array] = [np.zeros(0)]
    proposals = []
    weights = np.zeros(0)
    for _ in range(settings.rounds if s else 0):
        proposal = multivariate_t(mean, covariance + 1e-12 * np.eye(s), df=settings.freedom, seed=rng)
        proposals.append(proposal)
        shared = np.atleast_2d(proposal.rvs(settings.draws)).reshape(settings.draws, s)
        inside = np.all((shared >= problem.lower) & (shared <= problem.upper), axis=1)
        shared = shared[inside]
        draws.append(shared)
        targets.append(-0.5 * _profiled(problem, found.point, answers, shared, remainder))
        every, target = np.concatenate(draws), np.concatenate(targets)
        mixture = logsumexp(np.stack([np.atleast_1d(p.logpdf(every)) for p in proposals]), axis=0)
        logs = target - mixture
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        mean = weights @ every
        apart = every - mean
        covariance = (apart * weights[:, None]).T @ apart + 0.05 * covariance
    if s:
        every = np.concatenate(draws)
        at = np.searchsorted(np.cumsum(weights), (np.arange(count) + rng.uniform()) / count)
        shared = every[rng.permutation(np.minimum(at, len(every) - 1))]
    else:
        shared = np.zeros((count, 0))
    states = []
    for run, parts, answer, width in zip(problem.runs, found.point.states, answers, widths, strict=True):
        first = np.concatenate(parts) if parts else np.zeros(0)
        moved = first + (shared - centre) @ answer.T + rng.standard_normal((count, width.shape[1])) @ width.T
        cuts = np.cumsum([b.states.count for b in run])[:-1]
        states.append(tuple(np.split(moved, cuts, axis=1)))
    return Posterior(shared, tuple(states), float(1.0 / (weights**2).sum()) if s else float(count))


def _profiled(problem: Problem, at: Point, answers: list[Array], shared: Array, remainder: float) -> Array:
    """Return chi-square (K,) at shared coordinates (K, S) with initial states where they follow."""
    states = []
    for own, run, answer in zip(at.states, problem.runs, answers, strict=True):
        moved = np.concatenate(own) + (shared - at.shared) @ answer.T
        states.append(np.split(moved, np.cumsum([b.states.count for b in run])[:-1], axis=1))
    total: Array = problem.prior_costs(shared) + problem.run_costs(shared, states, 1.0).sum(axis=1) / remainder
    return total
