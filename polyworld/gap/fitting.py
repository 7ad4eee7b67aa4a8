"""Fit hypotheses by robust least squares, initial states eliminated by run, and score them by what was left out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.least_squares import Linearised, Normal, Point, Problem
from polyworld.gap.ground import DESCENT, Ground
from polyworld.gap.hypothesis import Hypothesis

Array = NDArray[np.float64]

FEWEST = 6  # residuals of a channel that show its scale
REST = 0.02  # fall of chi-square, in squared scales, below which an iteration gains nothing
OPENINGS = (0.12, 0.35, 0.7, 1.0)  # shares of the time of growing fits, after the first samples
UNCORRELATED = 0.1  # correlation below which residuals count as independent
MOST = 0.98  # correlation that is believed


@dataclass
class Fitted:
    """A fitted hypothesis.

    scale: robust standard deviation of its residuals in those of the noise, at least 1. cost: robust chi-square over
    squared scales. early: the point that a short horizon gave. Held out: errors (F,) by fold in standard deviations of
    the noise; expected (F,): those of a hypothesis that is right, whose unknowns the noise leaves uncertain; grids:
    residuals by run (T, C), each fold as it was predicted; left_out (F, S): values without each fold. simplicity: cost
    of its effects in nats, price: that and what is surprising in its values. scores (F,), total: as compared
    with others.
    """

    hypothesis: Hypothesis
    ground: Ground
    problem: Problem
    point: Point
    early: Point
    normal: Normal
    scale: float
    cost: float
    errors: Array = field(default_factory=lambda: np.zeros(0))
    expected: Array = field(default_factory=lambda: np.ones(1))
    grids: tuple[Array, ...] = ()
    left_out: Array = field(default_factory=lambda: np.zeros((0, 0)))
    simplicity: float = 0.0
    price: float = 0.0
    scores: Array = field(default_factory=lambda: np.zeros(0))
    total: float = np.inf

    @property
    def values(self) -> Array:
        """Values (S,) of shared unknowns."""
        return self.point.shared

    @property
    def slopes(self) -> list[Linearised]:
        """Residuals and derivatives, by run."""
        return self.normal.slopes

    @property
    def objective(self) -> float:
        """Twice the negative log-likelihood with the scale profiled out."""
        return self.cost + 2.0 * float(self.ground.counts.sum()) * float(np.log(self.scale))

    @property
    def error(self) -> float:
        """Root mean square of held-out errors over folds, in those that noise alone makes."""
        return float(np.sqrt(np.mean((self.errors / self.expected) ** 2)))

    @property
    def quiet(self) -> bool:
        """Whether nothing is left: held-out errors near the noise, or too small beside the motion to be modelled."""
        settings = self.ground.settings
        return self.error < settings.near_noise or self.error * self.ground.relative_noise < settings.negligible

    def of_states(self) -> list[Array]:
        """Return the initial states by run."""
        return [own[0] for own in self.point.states]


def fit(ground: Ground, hypothesis: Hypothesis, start: Point | None = None, growing: bool = False, iterations: int = 12,
        scale: float = 2.0) -> Fitted:  # fmt: skip
    """Fit a hypothesis from a point, or over growing parts of each run's time from where the data suggest.

    scale: of the residuals, as far as it is known. Residuals count linearly beyond `soft` scales, so that model error,
    which is never normal, does not let single runs or impacts decide.
    """
    problem = ground.problem(hypothesis)
    point = start or problem.start()
    early = point
    soft = ground.settings.soft
    if growing or start is None:
        _soften(problem, soft, scale, iterations)
        shares = (float(DESCENT.opening), *OPENINGS)
        for share in shares[:-1]:
            found = problem.descend(point, share)
            point = found.point
            _soften(problem, soft, scale_of(ground, found.normal), iterations)
            if share <= 0.12:
                early = point
        scale = scale_of(ground, found.normal)
    _soften(problem, soft, scale, iterations)
    found = problem.descend(point, 1.0)
    last = scale_of(ground, found.normal)
    if last < 0.5 * scale:  # what was model error is explained: large residuals count again
        _soften(problem, soft, last, iterations)
        found = problem.descend(found.point, 1.0)
    scale = scale_of(ground, found.normal)
    _soften(problem, soft, scale, iterations)
    cost = float(problem.costs([found.point], 1.0)[0]) / scale**2
    return Fitted(hypothesis, ground, problem, found.point, early, found.normal, scale, cost)


def scale_of(ground: Ground, normal: Normal) -> float:
    """Return the robust standard deviation of residuals in those of the noise, at least 1."""
    every = np.concatenate([one.residuals for one in normal.slopes])
    columns = [g.columns()[: len(one.residuals)] for g, one in zip(ground.readouts, normal.slopes, strict=True)]
    return max(1.0, robust_scale(every, np.concatenate(columns)))


def robust_scale(residuals: Array, columns: NDArray[np.int64]) -> float:
    """Return the robust standard deviation of residuals (m,), of the channel (m,) that is described worst.

    What is wrong along one axis alone, as at a wall, is no outlier among what is right along others, and spins that
    never change are described by every law.
    """
    counts = np.bincount(columns)
    own = [np.abs(residuals[columns == c]) for c in np.flatnonzero(counts >= FEWEST)]
    return 1.4826 * max([float(np.median(o)) for o in own] or [float(np.median(np.abs(residuals)))])


def neighbours(fitted: Fitted) -> tuple[Array, Array, Array]:
    """Return by run (R,), each scaled to unit size since no single one decides, the sums of products of held-out
    residuals that follow each other and of squares of the later ones, and how many pairs there are."""
    sums = []
    for grid in fitted.grids:
        grid = grid / max(float(np.sqrt(np.nanmean(grid**2))), 1e-300)
        both = grid[1:] * grid[:-1]
        pairs = np.isfinite(both)
        sums.append((np.nansum(both), np.nansum(grid[1:] ** 2 * pairs), pairs.sum()))
    product, square, count = np.array(sums, dtype=float).reshape(-1, 3).T
    return product, square, count


def independent_share(fitted: Fitted) -> float:
    """Return the share (1 - phi) / (1 + phi) of held-out residuals that count as independent, by their lag-1
    correlation phi."""
    product, square, _ = neighbours(fitted)
    phi = float(np.clip(product.sum() / max(square.sum(), 1e-300), 0.0, MOST))
    return (1.0 - phi) / (1.0 + phi) if phi > UNCORRELATED else 1.0


def correlation_evidence(fitted: Fitted) -> Array:
    """Return by run (R,) the evidence in nats that its held-out residuals are no white noise: z^2 / 2 of their lag-1
    correlation, less the logarithm of how many runs are looked through (Bartlett 1946, JRSS Suppl. 8, 27)."""
    product, square, count = neighbours(fitted)
    z = np.maximum(product, 0.0) / np.maximum(square, 1e-300) * np.sqrt(count)
    found: Array = 0.5 * z**2 - np.log(len(z))
    return found


def share_left(before: float, after: float) -> float:
    """Return the share of a gap beyond the noise that is left; before, after: errors in standard deviations of it."""
    return float(np.sqrt(max(after**2 - 1.0, 0.0)) / np.sqrt(max(before**2 - 1.0, 1e-12)))


def _soften(problem: Problem, soft: float, scale: float, iterations: int) -> None:
    problem.settings = replace(problem.settings, huber=soft * scale, rest=REST, iterations=iterations)
    problem.scale = scale
