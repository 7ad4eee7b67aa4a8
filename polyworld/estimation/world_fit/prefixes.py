"""Least squares over growing stretches of the tracks, from several starts: the deepest minimum is kept.

The first frames show initial states nearly linearly; every longer stretch starts from what the shorter one found, so
that each collision is met with a path that reaches it at about the right place and time. Where the whole is not
described within the noise, further starts are drawn from the priors, the initial states kept but for distances from a
camera that are hardly known; one that falls behind the best start over a stretch is abandoned there (racing, Maron &
Moore 1994).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.world_fit.multistart import Start, in_order
from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.refine import GOOD, descend
from polyworld.estimation.world_fit.result import LossPoint, Status
from polyworld.estimation.world_fit.search import Cancelled
from polyworld.estimation.world_fit.settings import PrefixSettings
from polyworld.estimation.world_fit.sight_lines import sight_lines

Array = NDArray[np.float64]


def fit_by_prefixes(
    problem: FitProblem,
    settings: PrefixSettings | None = None,
    *,
    progress: Callable[[int, int, int, int], None] | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[Start, ...]:
    """Fit from each start over growing stretches; the starts that were not abandoned in order of their best loss.

    progress: called as a stretch begins, with start, starts at most, stretch, stretches. A cancelled fit returns what
    was reached, with status `cancelled`.
    """
    settings = settings or PrefixSettings()
    rng = np.random.default_rng([settings.seed, 0x9F])
    space = problem.space
    contact = np.array([of_contact(u.paths[0]) for u in space.unknowns])
    stages = _stages(problem, settings.stages)
    reached = np.full(len(stages), np.inf)  # lowest loss over each stretch
    starts: list[Start] = []
    lines = sight_lines(problem)
    most = settings.starts + (settings.distances if len(lines) and settings.starts > 1 else 0)
    for number in range(most):
        problem.begin()
        at = space.mean.copy()
        if number:
            at = np.where(contact, at + settings.scatter * space.sd * rng.standard_normal(len(at)), at)
            at = np.clip(at, space.lower, space.upper)
        status: Status = "completed"
        history: list[LossPoint] = []
        behind = False
        for stage, (samples, iterations) in enumerate(zip(stages, settings.iterations, strict=True)):
            if progress is not None:
                progress(number + 1, most, stage + 1, len(stages))
            if number and stage == 1:  # the first stretch shows all but the distance; what follows may hang on it
                at = at + settings.distance * rng.standard_normal(len(lines)) @ lines
                at = np.clip(at, space.lower, space.upper)
            at, points, status = descend(
                problem,
                at,
                samples,
                iterations=iterations,
                tolerance=settings.tolerance,
                enough=GOOD,
                cancelled=cancelled,
            )
            history += points
            if status == "cancelled":
                break
            loss = float(problem.losses(at[None], samples)[0])
            behind = loss > settings.behind * reached[stage]
            reached[stage] = min(reached[stage], loss)
            if behind:
                break
        if behind:
            continue
        starts.append(Start(problem.finish("prefixes", status, at, None, history, settings.seed)))
        if status == "cancelled" or starts[-1].best.loss <= GOOD:
            break
    return in_order(starts)


def _stages(problem: FitProblem, shares: Sequence[float]) -> list[int]:
    least = min(6, problem.samples)
    return [max(least, round(share * problem.samples)) for share in shares]


def of_contact(path: str) -> bool:
    """Return whether a path is of what contacts depend on, rather than of an initial state."""
    return path.rsplit(".", 1)[1] in ("friction", "restitution", "rolling_resistance", "mass") or (
        ".angular_velocity." in path
    )
