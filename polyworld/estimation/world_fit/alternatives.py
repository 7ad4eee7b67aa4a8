"""Search the priors of contact parameters and unobserved spins for other minima that describe the tracks about as well.

One bounce that took away some speed is explained by a slippery surface or by a rough one and a spin, and the two differ
in what the next bounce does. A fit that reaches the noise with one of them says nothing of the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.world_fit.prefixes import of_contact
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import descend
from polyworld.estimation.world_fit.result import FitResult
from polyworld.estimation.world_fit.search import Cancelled
from polyworld.estimation.world_fit.settings import AlternativeSettings

Array = NDArray[np.float64]


def alternative_minima(
    problem: FitProblem,
    best: FitResult,
    *,
    settings: AlternativeSettings | None = None,
    seed: int = 0,
    cancelled: Cancelled | None = None,
) -> list[FitResult]:
    """Return outcomes of descents from a slippery and a rough world and from the likeliest of draws from the priors.

    Initial states are kept. Descents that end in a minimum reached before are left out; empty where no contact
    parameter or spin is fitted.
    """
    settings = settings or AlternativeSettings()
    space = problem.space
    drawn = np.array([of_contact(u.paths[0]) for u in space.unknowns])
    if not drawn.any() or problem.world.coupled:
        return []
    rng = np.random.default_rng([seed, 0xA7])
    start = space.coordinates(best.by_name)
    draws = np.repeat(start[None], settings.draws, axis=0)
    draws[:, drawn] = _from_priors(problem, settings.draws, rng)[:, drawn]
    losses = problem.losses(draws, problem.samples)
    starts = _slippery_and_rough(problem, start, settings)
    for row in np.argsort(losses, kind="stable")[: settings.descents]:
        if np.isfinite(losses[row]):
            starts.append(draws[row])
    found: list[FitResult] = []
    ends = [start]
    for begin in starts:
        at, history, status = descend(
            problem,
            begin,
            problem.samples,
            iterations=settings.iterations,
            tolerance=settings.tolerance,
            cancelled=cancelled,
        )
        if status == "cancelled":
            break
        if not any(_near(problem, at, other, drawn, settings.same) for other in ends):
            ends.append(at)
            found.append(problem.finish("prefixes", status, at, None, history, seed))
    return found


def _slippery_and_rough(problem: FitProblem, start: Array, settings: AlternativeSettings) -> list[Array]:
    """Return candidates (P,) with every friction far below and far above its prior's mean, and the likeliest spins.

    Below the one every contact slides, above the other none does: what a bounce does with a spin differs in kind.
    """
    space = problem.space
    found = []
    for away in (-settings.extreme, settings.extreme):
        values = space.values(start[None])[0].copy()
        for i, u in enumerate(space.unknowns):
            if u.prior is not None and u.paths[0].endswith(".friction"):
                values[i] = max(u.prior[0] + away * u.prior[1], settings.least * u.prior[0])
            elif u.prior is not None and ".angular_velocity." in u.paths[0]:
                values[i] = u.prior[0]
        found.append(space.coordinates({u.name: float(v) for u, v in zip(space.unknowns, values, strict=True)}))
    return found


def _from_priors(problem: FitProblem, count: int, rng: np.random.Generator) -> Array:
    """Return draws (count, P) of all unknowns, by their priors or evenly within their bounds, in search coordinates."""
    space = problem.space
    found = rng.uniform(space.lower, space.upper, (count, len(space.lower)))
    for i, u in enumerate(space.unknowns):
        if u.prior is not None and u.scale != "log":
            found[:, i] = np.clip(rng.normal(*u.prior, count), u.lower, u.upper)
    return found


def _near(problem: FitProblem, a: Array, b: Array, drawn: NDArray[np.bool_], same: float) -> bool:
    """Return whether two candidates differ in none of what is drawn by more than a share of its typical deviation."""
    return bool(np.all(np.abs(a - b)[drawn] <= same * problem.space.sd[drawn]))
