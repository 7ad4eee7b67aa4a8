"""Give bodies that share contact parameters their own where the evidence asks for it.

Bodies of one shape and size are mostly of one material, and a short clip shows the parameters of all better than those
of each. Where they are not, the shared fit leaves more than noise. The same bodies with parameters of their own are
then fitted from there, and kept where twice the log-likelihood grows by more than the logarithm of the number of
observations for each further parameter (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.multistart import Start
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import GOOD, descend
from polyworld.estimation.world_fit.search import Cancelled
from polyworld.estimation.world_fit.settings import PrefixSettings


def release_shared(
    problem: FitProblem,
    start: Start,
    own: Sequence[Unknown],
    *,
    settings: PrefixSettings | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[FitProblem, Start]:
    """Refit with unknowns `own`, of which each has the paths of one body, from the optimum where bodies share them.

    settings: iterations and tolerance of the last stretch are used. Returns the problem and fit that are kept.
    """
    settings = settings or PrefixSettings()
    shared = start.best
    more = len(own) - len(problem.space.unknowns)
    if more <= 0 or shared.loss <= GOOD or shared.status != "completed":
        return problem, start
    values = {path: shared.by_name[u.name] for u in problem.space.unknowns for path in u.paths}
    begin = {u.name: min(max(values.get(u.paths[0], u.start), u.lower), u.upper) for u in own}
    free = problem.with_unknowns(own, problem.world)
    at, points, status = descend(
        free,
        free.space.coordinates(begin),
        free.samples,
        iterations=settings.iterations[-1],
        tolerance=settings.tolerance,
        cancelled=cancelled,
    )
    count = problem.objective.weight(problem.samples)
    loss = free.loss(at)
    noise = max(loss, 1.0)  # variance of the residuals, at least what the tracks state
    if status == "cancelled" or (shared.loss - loss) * count / noise <= more * np.log(max(count, 2.0)):
        return problem, start
    return free, Start(start.searched, free.finish("prefixes", status, at, None, points, shared.seed))
