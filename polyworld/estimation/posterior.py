"""Sample the posterior of a study: population Monte Carlo over shared unknowns, initial states eliminated by run.

Initial states follow the shared unknowns, linearly and then by a Gauss-Newton step with the slopes of the minimum, and
scatter by their own information unless the measurements contradict where that leads; what is left is a density over a
few constants that priors and bounds make anything but Gaussian: friction and damping lie in a valley, and what was
never observed keeps its prior. Draws from a Student t distribution with the mean and covariance of the round before are
weighted by the density over that of all rounds' proposals (Cappe et al. 2004, J. Comput. Graph. Stat. 13, 907; weights
of Owen & Zhou 2000).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from polyworld.estimation.least_squares import Minimum, Problem, inverse
from polyworld.estimation.problem import link_start
from polyworld.estimation.robust import huber_loss, huber_weights

Array = NDArray[np.float64]
FLATTEST = -30.0  # logarithm of the power of weights at which all draws count


@dataclass(frozen=True)
class SamplingSettings:
    """Rounds of `draws` each, up to `most` while fewer than `enough` draws count. freedom: of the t distribution, whose
    tails cover what a Gaussian would miss. turns: in which states are scattered object by object, where all at
    once were refused: what the first refuses the second proposes again."""

    most: int = 10
    draws: int = 128
    enough: float = 64.0
    freedom: float = 6.0
    turns: int = 2


@dataclass(frozen=True)
class Posterior:
    """Equally probable settings. shared (N, S): coordinates; states[run][block] (N, n). effective: how
    many draws their weights are worth, before any flattening."""

    shared: Array
    states: tuple[tuple[Array, ...], ...]
    effective: float


def sample(
    problem: Problem, found: Minimum, count: int, seed: int, settings: SamplingSettings | None = None
) -> Posterior:
    """Draw settings from the posterior about a minimum.

    Its density is exp(-cost / 2 scale^2): where residuals exceed the measured noise the model is wrong by the rest, and
    they say less by that factor.
    """
    settings = settings or SamplingSettings()
    rng = np.random.default_rng([seed, 0x5A])
    normal, centre, variance = found.normal, found.point.shared, problem.scale**2
    s = len(centre)
    answers: list[Array] = []
    inverses: list[Array] = []
    widths: list[list[Array]] = []
    information = normal.information() / variance
    named = [[label for b in run for label in b.states.labels] for run in problem.runs]
    for own, border, labels in zip(normal.own, normal.border, named, strict=True):
        inverses.append(inverse(own))
        answers.append(-inverses[-1] @ border)
        widths.append(_by_object(variance * inverses[-1], labels))
    flat = ((problem.upper - problem.lower) / np.sqrt(12.0)) ** -2.0  # no wider than the bounds
    information += np.diag(flat)
    scale = np.sqrt(np.maximum(np.diag(normal.shared) / variance + flat, 1e-300))
    covariance: Array = information
    if s:
        covariance = np.asarray(np.linalg.inv(_positive(information, scale)), dtype=np.float64)
    mean = np.clip(centre, problem.lower, problem.upper)
    draws: list[Array] = [np.zeros((0, s))]
    targets: list[Array] = [np.zeros(0)]
    places: list[list[Array]] = [[] for _ in answers]
    costs: list[Array] = [np.zeros((len(answers), 0))]
    proposals = []
    weights, counted = np.zeros(0), 0.0
    for turn in range(settings.most if s else 0):
        if turn > 1 and counted >= settings.enough:
            break
        for about in (mean, _inward(mean, covariance, problem)):
            proposal = multivariate_t(about, _positive(covariance, np.ones(s)), df=settings.freedom, seed=rng)
            shared = np.atleast_2d(proposal.rvs(settings.draws)).reshape(settings.draws, s)
            shared = shared[np.all((shared >= problem.lower) & (shared <= problem.upper), axis=1)]
            if len(shared) > settings.draws // 10:
                break
        if not len(shared):  # mean and covariance would stay as they are: a proposal that is half as wide next
            covariance = 0.25 * covariance
            continue
        proposals.append(proposal)
        draws.append(shared)
        least, moved = _profiled(problem, found, answers, inverses, shared)
        costs.append(least)
        targets.append(-0.5 * (problem.prior_costs(shared) + least.sum(axis=0)) / variance)
        for place, part in zip(places, moved, strict=True):
            place.append(part)
        every, target = np.concatenate(draws), np.concatenate(targets)
        mixture = logsumexp(np.stack([np.atleast_1d(p.logpdf(every)) for p in proposals]), axis=0)
        weights, counted = _weights(target - mixture, settings.enough)
        mean = weights @ every
        apart = every - mean
        covariance = (apart * weights[:, None]).T @ apart + 0.05 * covariance
    at = np.zeros(count, dtype=np.int64)
    if s:
        at = np.searchsorted(np.cumsum(weights), (np.arange(count) + rng.uniform()) / count)
        at = rng.permutation(np.minimum(at, len(weights) - 1))
    shared = np.concatenate(draws)[at] if s else np.zeros((count, 0))
    if s:
        first, least = [np.concatenate(place)[at] for place in places], np.concatenate(costs, axis=1)[:, at]
    else:
        one = [np.concatenate(parts)[None] for parts in found.point.states]
        least = np.array([total for total, _ in _costs(problem, found, shared[:1], one)])
        first = [np.tile(own, (count, 1)) for own in one]
    scattered = _scattered(problem, found, shared, first, least / variance, widths, settings.turns, rng)
    states = [
        tuple(np.split(drawn, np.cumsum([b.states.count for b in run])[:-1], axis=1))
        for run, drawn in zip(problem.runs, scattered, strict=True)
    ]
    return Posterior(shared, tuple(states), counted if s else float(count))


def _scattered(
    problem: Problem,
    found: Minimum,
    shared: Array,
    first: list[Array],
    costs: Array,
    widths: list[list[Array]],
    turns: int,
    rng: np.random.Generator,
) -> list[Array]:
    """Return initial states (K, n) by run, scattered about `first` (K, n) by Metropolis's algorithm.

    costs (R, K): standardised, of `first`, as predicted. widths: by run and object, see `_by_object`. Proposals do not
    depend on where states are. All states of a run move at once; of members that measurements contradict there, those
    of one object after the other: what a collision bends leaves the objects that are not in it theirs.
    """
    variance, count = problem.scale**2, len(shared)
    normals = [[rng.standard_normal((count, part.shape[1])) for part in own] for own in widths]
    states, moved = list(first), np.zeros(costs.shape, dtype=bool)

    def evaluated(members: NDArray[np.int64], proposed: list[Array]) -> Array:
        found_costs = [total for total, _ in _costs(problem, found, shared[members], [p[members] for p in proposed])]
        return np.array(found_costs).reshape(len(proposed), len(members)) / variance

    everyone = np.arange(count)
    proposed = [
        start + sum((z @ part.T for z, part in zip(drawn, own, strict=True)), np.zeros_like(start))
        for start, drawn, own in zip(first, normals, widths, strict=True)
    ]
    true = evaluated(everyone, proposed)
    for r, drawn in enumerate(normals):
        length = sum(((z**2).sum(axis=1) for z in drawn), np.zeros(count))
        moved[r] = np.log(rng.uniform(size=count)) < 0.5 * (length + costs[r] - true[r])
        states[r] = np.where(moved[r][:, None], proposed[r], first[r])
    rest = np.flatnonzero(~moved.all(axis=0))
    if not len(rest) or not turns:
        return states
    now = evaluated(rest, states)
    at = [[np.where(moved[r][:, None], z, 0.0) for z in drawn] for r, drawn in enumerate(normals)]
    for j in [j for _ in range(turns) for j in range(max(map(len, widths)))]:
        fresh = [rng.standard_normal(own[j].shape) if j < len(own) else None for own in at]
        proposed = [
            state if z is None else state + (z - at[r][j]) @ widths[r][j].T
            for r, (state, z) in enumerate(zip(states, fresh, strict=True))
        ]
        true = evaluated(rest, proposed)
        for r, z in enumerate(fresh):
            if z is not None:
                longer = ((z**2).sum(axis=1) - (at[r][j] ** 2).sum(axis=1))[rest]
                taken = np.log(rng.uniform(size=len(rest))) < 0.5 * (longer + now[r] - true[r])
                taken &= ~moved[r][rest]
                states[r][rest[taken]], at[r][j][rest[taken]] = proposed[r][rest[taken]], z[rest[taken]]
                now[r][taken] = true[r][taken]
    return states


def _by_object(covariance: Array, labels: list[str]) -> list[Array]:
    """Return a factor of a covariance (n, n) of states in parts (n, m), one an object: their products add up to it.

    A part moves its object, and those that come later as far as they depend on it.
    """
    owners = [label.split(".")[0] for label in labels]
    order = np.array(sorted(range(len(labels)), key=lambda i: owners.index(owners[i])), dtype=np.int64)
    values, vectors = np.linalg.eigh(covariance[np.ix_(order, order)])
    root = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    triangle: Array = np.linalg.qr(root).R
    factor = np.zeros_like(covariance)
    factor[order] = triangle.T
    sorted_owners = [owners[i] for i in order]
    return [factor[:, [k for k, o in enumerate(sorted_owners) if o == name]] for name in dict.fromkeys(owners)]


def _inward(mean: Array, covariance: Array, problem: Problem) -> Array:
    """Return the mean (S,) moved off bounds by a standard deviation, so that most draws are within them.

    Where a dozen coordinates end on bounds, one draw in thousands about the mean is.
    """
    room = np.minimum(np.sqrt(np.diag(covariance)), 0.5 * (problem.upper - problem.lower))
    moved: Array = np.clip(mean, problem.lower + room, problem.upper - room)
    return moved


def _weights(logs: Array, enough: float) -> tuple[Array, float]:
    """Return importance weights (N,) of their logarithms, flattened by a power until enough draws count, and how many
    count without that.

    A proposal that is far from the density has one draw that outweighs all others, from which nothing can be adapted.
    """

    def flattened(log_power: float) -> Array:
        size: Array = np.exp(np.exp(log_power) * (logs - logs.max()))
        share: Array = size / size.sum()
        return share

    def count(log_power: float) -> float:
        return float(1.0 / (flattened(log_power) ** 2).sum())

    least, counted = min(enough, 0.5 * len(logs)), count(0.0)
    if counted >= least:
        return flattened(0.0), counted
    return flattened(float(brentq(lambda power: count(power) - least, FLATTEST, 0.0, xtol=1e-3))), counted


def _positive(matrix: Array, size: Array) -> Array:
    """Return a symmetric matrix (S, S) with eigenvalues, in units of size (S,), that rounding leaves positive."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T) / np.outer(size, size))
    found: Array = (vectors * np.maximum(values, 1e-9 * values.max())) @ vectors.T * np.outer(size, size)
    return found


def _profiled(
    problem: Problem, found: Minimum, answers: list[Array], inverses: list[Array], shared: Array
) -> tuple[Array, list[Array]]:
    """Return chi-square (R, K) of each run at shared coordinates (K, S), initial states where they follow, and these
    (K, n) by run.

    The step takes residuals where the states follow linearly, and slopes of the minimum.
    """
    at = found.point
    flat = [np.concatenate(own) + (shared - at.shared) @ a.T for own, a in zip(at.states, answers, strict=True)]
    totals = []
    for r, (total, gradient) in enumerate(_costs(problem, found, shared, flat)):
        step = gradient @ inverses[r]
        totals.append(total - (gradient * step).sum(axis=1))
        flat[r] = flat[r] - step
    return np.array(totals).reshape(len(flat), len(shared)), flat


def _costs(problem: Problem, found: Minimum, shared: Array, flat: list[Array]) -> list[tuple[Array, Array]]:
    """Return chi-square (K,) of each run at shared coordinates (K, S) and initial states (K, n) by run, and half its
    gradient (K, n) with the slopes of the minimum."""
    variance, huber = problem.scale**2, problem.settings.huber
    cuts = [np.cumsum([0, *(b.states.count for b in run)]) for run in problem.runs]
    states = [np.split(own, cut[1:-1], axis=1) for own, cut in zip(flat, cuts, strict=True)]
    settings = [(b, shared, states[r][i]) for r, run in enumerate(problem.runs) for i, b in enumerate(run)]
    evaluated = iter(zip(problem.evaluate(settings, 1.0), found.normal.slopes, strict=True))
    costs = []
    for r, run in enumerate(problem.runs):
        total, gradient = np.zeros(len(shared)), np.zeros_like(flat[r])
        for i, block in enumerate(run):
            own = slice(cuts[r][i], cuts[r][i + 1])
            one, slopes = next(evaluated)
            prior = (states[r][i] - block.states.prior[:, 0]) / block.states.prior[:, 1]
            total += huber_loss(one.residuals, huber).sum(axis=1) + variance * (prior**2).sum(axis=1)
            gradient[:, own] += (one.residuals * huber_weights(one.residuals, huber)) @ slopes.states
            gradient[:, own] += variance * prior / block.states.prior[:, 1]
            if one.end is not None and slopes.end is not None:
                start, turn = link_start(run[i + 1], block, states[r][i + 1])
                apart = one.end - start
                total += variance * huber_loss(apart, huber).sum(axis=1)
                apart = variance * apart * huber_weights(apart, huber)
                gradient[:, own] += apart @ slopes.end[2]
                gradient[:, cuts[r][i + 1] : cuts[r][i + 2]] -= apart @ turn
        costs.append((total, gradient))
    return costs
