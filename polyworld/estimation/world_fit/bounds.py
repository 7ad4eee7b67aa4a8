"""Widen bounds of a search that the data want to leave, and refit."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.multistart import Start
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import GOOD, descend
from polyworld.estimation.world_fit.result import FitResult
from polyworld.estimation.world_fit.search import Cancelled
from polyworld.estimation.world_fit.settings import WideningSettings
from polyworld.world.parameters import specification


def refit_with_wider_bounds(
    problem: FitProblem,
    start: Start,
    *,
    keep: Collection[str] = (),
    settings: WideningSettings | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[FitProblem, Start, dict[str, tuple[float, float]]]:
    """Refit while a value lies on a bound that is not physical; returns the bounds that were widened, by name.

    keep: paths whose bounds were given. A fit that does not become better is dropped, and its bounds with it.
    """
    settings = settings or WideningSettings()
    widened: dict[str, tuple[float, float]] = {}
    for _ in range(settings.rounds):
        if start.best.status == "cancelled" or (cancelled is not None and cancelled()):
            break
        unknowns, moved = _widened(problem, start.best, keep, settings)
        if not moved:
            break
        wider = problem.with_unknowns(unknowns, problem.world)
        wider.begin()
        at, history, status = descend(
            wider,
            wider.space.coordinates(start.best.by_name),
            wider.samples,
            iterations=settings.iterations,
            enough=GOOD,
            cancelled=cancelled,
        )
        found = wider.finish(start.best.method, status, at, None, history, start.best.seed)
        if not found.loss < start.best.loss:
            break
        widened |= moved
        problem, start = wider, Start(start.searched, found)
    return problem, start, widened


def _widened(
    problem: FitProblem, result: FitResult, keep: Collection[str], settings: WideningSettings
) -> tuple[tuple[Unknown, ...], dict[str, tuple[float, float]]]:
    values = result.by_name
    unknowns, moved = [], {}
    for u in problem.space.unknowns:
        specs = [specification(problem.world, path) for path in u.paths]
        least, most = max(s.lower for s in specs), min(s.upper for s in specs)
        lower, upper, value = u.lower, u.upper, values[u.name]
        if not set(keep) & set(u.paths):
            if u.scale == "log":
                near = (u.upper / u.lower) ** settings.near
                lower = max(least, u.lower / settings.wider) if value < u.lower * near else lower
                upper = min(most, u.upper * settings.wider) if value > u.upper / near else upper
            else:
                near = settings.near * (u.upper - u.lower)
                grown = (settings.wider - 1.0) * (u.upper - u.lower)
                lower = max(least, u.lower - grown) if value < u.lower + near else lower
                upper = min(most, u.upper + grown) if value > u.upper - near else upper
        if (lower, upper) != (u.lower, u.upper):
            moved[u.name] = (lower, upper)
        unknowns.append(replace(u, lower=lower, upper=upper))
    return tuple(unknowns), moved
