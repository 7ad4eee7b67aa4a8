"""Sample the posterior of a fit: Laplace approximations of the minima found, truncated to the bounds, and reweighted.

Around a minimum x0 the log-posterior is -U(x), U = sum of w r(x)^2 / 2, with weights w that admit the reduced
chi-square and the correlation of the residuals. Its linearisation is a Gaussian truncated to the bounds, flat along
what the data leave open. Candidates from it are weighted by exp(U_linearised - U) and resampled (sampling importance
resampling, Rubin 1988); where too few of them count, they are moved as well (`tempering`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.default_unknowns import states_at_rest, unknown_of
from polyworld.estimation.world_fit.determinable import Shown, reasons_undeterminable
from polyworld.estimation.world_fit.objective import DIVERGED
from polyworld.estimation.world_fit.plausible import with_prior
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.result import FitResult
from polyworld.estimation.world_fit.search_space import SearchSpace
from polyworld.estimation.world_fit.sensitivity import sensitivity
from polyworld.estimation.world_fit.tempering import TemperingSettings, annealed, systematic, tempered
from polyworld.estimation.world_fit.truncated import TruncatedGaussian
from polyworld.world import World
from polyworld.world.parameters import read_parameter

Array = NDArray[np.float64]

MEMBERS = 64
CANDIDATES, COUPLED_CANDIDATES = 4, 2  # rollouts for each member kept; those of coupled worlds take seconds
MOST_MINIMA = 3
FARTHEST = 6.0  # difference of log-posteriors beyond which a second minimum holds no member
UNFITTED = ("friction", "restitution", "mass")


@dataclass(frozen=True)
class PosteriorSample:
    """Equally probable parameter values of a fitted world, in random order after the best fit itself.

    values (N, P): of the unknowns: those that were fitted, contact parameters and masses that the tracks cannot show,
    and the places of objects that do not move. The first are those of the best fit, so that what is predicted from it
    lies within the ensemble also where its misfit is far from quadratic. from_bounds: names of unknowns that the data
    do not determine, drawn from their bounds. minima: how many minima the members come from. tempering: exponent of
    the importance weights, 1 where the linearised misfit describes the simulated one well; effective: number of
    candidates of equal weight that the `candidates` are worth. until [s]: time of the last sample that was fitted.
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    from_bounds: tuple[str, ...]
    minima: int
    tempering: float
    effective: float
    candidates: int
    seed: int
    until: float

    def overrides(self, count: int) -> dict[str, Array]:
        """Parameter path -> values (count,) of the first `count` members."""
        return {path: self.values[:count, i] for i, u in enumerate(self.unknowns) for path in u.paths}

    def to_dict(self) -> dict[str, Any]:
        """Return all but the values, as JSON-ready values."""
        about = {"from_bounds": list(self.from_bounds), "minima": self.minima, "seed": self.seed}
        about |= {"until": self.until}
        about |= {"tempering": self.tempering, "effective": self.effective, "candidates": self.candidates}
        return about | {"unknowns": [{"name": u.name, "paths": list(u.paths), "unit": u.unit} for u in self.unknowns]}


@dataclass(frozen=True)
class _Minimum:
    """Linearisation at search coordinates `centre` (P,): misfit, its gradient (P,) and its curvature (P, P)."""

    centre: Array
    misfit: float
    gradient: Array
    curvature: Array
    weight: Array
    undetermined: NDArray[np.bool_]

    def linearised(self, x: Array) -> Array:
        """Misfit (N,) of candidates (N, P), linearised."""
        step = x - self.centre
        quadratic: Array = (
            self.misfit + step @ self.gradient + 0.5 * np.einsum("ni,ij,nj->n", step, self.curvature, step)
        )
        return quadratic


def sample_posterior(
    problem: FitProblem,
    results: Sequence[FitResult],
    *,
    count: int = MEMBERS,
    known: Collection[str] = (),
    seed: int = 0,
) -> PosteriorSample | None:
    """Draw `count` parameter vectors from the posterior of a fit; None where the best result diverges.

    results: the fit's outcomes, the best first; another minimum takes part by its posterior mass. known: paths that are
    not drawn though the tracks do not show them. Costs `CANDIDATES` (in coupled worlds `COUPLED_CANDIDATES`) x count
    rollouts, and those of the sensitivities.
    """
    rng = np.random.default_rng([seed, 0x5A])
    space = problem.space
    minima = _minima(problem, results)
    if not minima:
        return None
    share = _masses(minima, space.width)
    total = (COUPLED_CANDIDATES if problem.world.coupled else CANDIDATES) * count
    approximations = [TruncatedGaussian(m.centre, m.gradient, m.curvature, space.lower, space.upper) for m in minima]
    owner = np.repeat(np.arange(len(minima)), rng.multinomial(total, share))
    counts = np.bincount(owner, minlength=len(minima))
    candidates = np.concatenate([a.draw(int(n), rng) for a, n in zip(approximations, counts, strict=True)])

    def log_ratio(x: Array, own: NDArray[np.int64]) -> Array:
        """Return the log-posterior (N,) over that of the linearisation from which each candidate comes."""
        residuals = problem.residuals(x)
        misfit = 0.5 * np.where(np.isfinite(residuals), residuals, 0.0) ** 2 @ minima[0].weight
        expected = np.zeros(len(x))
        for number, minimum in enumerate(minima):
            expected[own == number] = minimum.linearised(x[own == number])
        ratio: Array = np.where(np.isfinite(residuals).all(axis=1), expected - misfit, -np.inf)
        return ratio

    ratios = log_ratio(candidates, owner)
    settings = TemperingSettings()
    weights, exponent = tempered(ratios, least=count)
    if exponent < settings.well and np.isfinite(ratios).any() and not problem.world.coupled:
        candidates, exponent = annealed(candidates, ratios, owner, approximations, log_ratio, rng, settings)
        weights = np.full(len(candidates), 1.0 / len(candidates))
    chosen = rng.permutation(systematic(weights, count, rng))
    values = space.values(candidates[chosen])
    fitted = {path for u in space.unknowns for path in u.paths}
    more = _unfitted(problem, fitted, known)
    still = states_at_rest(Shown(problem.world, problem.window), fitted) if _varies_states(fitted) else []
    free = [u.name for u, open_ in zip(space.unknowns, minima[0].undetermined, strict=True) if open_]
    if more:
        other = SearchSpace(problem.world, more)
        unobserved = other.values(rng.uniform(other.lower, other.upper, (count, len(more))))
        for i, u in enumerate(more):
            if u.prior is not None:
                unobserved[:, i] = np.clip(rng.normal(*u.prior, count), u.lower, u.upper)
        values = np.concatenate([values, unobserved], axis=1)
    for unknown in still:
        assert unknown.prior is not None
        own = np.clip(rng.normal(*unknown.prior, count), unknown.lower, unknown.upper)
        values = np.concatenate([values, own[:, None]], axis=1)
    # What the fit left open keeps the world's own values in the best fit.
    own_values = [_own_value(problem.world, u) for u in (*more, *still)]
    best = np.concatenate([space.values(minima[0].centre), own_values])
    return PosteriorSample(
        unknowns=(*space.unknowns, *more, *still),
        values=np.concatenate([best[None], values[: count - 1]]),
        from_bounds=(*free, *(u.name for u in more)),
        minima=len(minima),
        tempering=exponent,
        effective=float(1.0 / (weights**2).sum()),
        candidates=total,
        seed=seed,
        until=float(problem.objective.sample_times[problem.samples - 1]),
    )


def _own_value(world: World, unknown: Unknown) -> float:
    value = read_parameter(world, unknown.paths[0])
    return unknown.start if value is None else float(value)


def _minima(problem: FitProblem, results: Sequence[FitResult]) -> list[_Minimum]:
    """Return the best minimum, and others that are neither in its basin nor much worse."""
    found: list[_Minimum] = []
    for result in results:
        if result.loss >= DIVERGED or len(found) == MOST_MINIMA:
            continue
        at = problem.space.coordinates(result.by_name)
        if found:
            step = at - found[0].centre
            weight = float(found[0].weight[found[0].weight > 0.0].mean())
            worse = 0.5 * (result.loss - results[0].loss) * problem.objective.weight(problem.samples) * weight
            same = any(float((at - m.centre) @ m.curvature @ (at - m.centre)) < 2.0 * len(step) for m in found)
            if worse > FARTHEST or same:
                continue
        found.append(_linearised(problem, at, found[0].weight if found else None))
    return found


def _linearised(problem: FitProblem, at: Array, weight: Array | None) -> _Minimum:
    laplace = sensitivity(problem, at)
    w = laplace.misfit_weight if weight is None else weight
    residual = problem.residuals(at[None])[0]
    weighted = laplace.jacobian * w[:, None]
    return _Minimum(
        centre=at,
        misfit=float(0.5 * residual**2 @ w),
        gradient=weighted.T @ residual,
        curvature=weighted.T @ laplace.jacobian,
        weight=w,
        undetermined=laplace.insensitive | laplace.undetermined,
    )


def _masses(minima: Sequence[_Minimum], width: Array) -> Array:
    """Posterior mass of each minimum, bounds taken for a Gaussian belief of their width."""
    logs = []
    for m in minima:
        scaled = m.curvature * np.outer(width, width) + np.eye(len(width))
        logs.append(-m.misfit - 0.5 * np.linalg.slogdet(scaled)[1])
    mass = np.exp(np.asarray(logs) - max(logs))
    normalised: Array = mass / mass.sum()
    return normalised


def _varies_states(fitted: Collection[str]) -> bool:
    """Return whether a fit varies initial states: else they are given."""
    return any(".position." in path or ".shift." in path for path in fitted)


def _unfitted(problem: FitProblem, fitted: Collection[str], known: Collection[str]) -> tuple[Unknown, ...]:
    """Return unknowns of the contact parameters and masses that were not fitted because the tracks cannot show them."""
    shown = Shown(problem.world, problem.window)
    unit = next((f"objects.{o.name}.mass" for o in problem.world.objects if o.name in shown.met), None)
    paths = [
        path
        for path in reasons_undeterminable(problem.world, problem.window)
        if path.rsplit(".", 1)[1] in UNFITTED and path not in fitted and path not in known and path != unit
    ]
    objects = {f"objects.{o.name}" for o in problem.world.objects}
    found = [unknown_of(problem.world, path) for path in paths if path.rsplit(".", 1)[0] in objects]
    ordinary = any(u.prior is not None for u in problem.space.unknowns)
    return tuple(with_prior(problem.world, u) if ordinary else u for u in found)
