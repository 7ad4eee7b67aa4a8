"""Weights and moves that turn draws from an approximation into draws from the posterior itself.

Importance resampling (Rubin 1988) alone needs enough draws where the posterior is. Where few are, as where only some of
them let a ball hit another one, its weights are raised to powers that grow from 0 to 1, and in between draws are
resampled and moved (Del Moral, Doucet & Jasra 2006, J. R. Stat. Soc. B 68, 411).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.world_fit.truncated import TruncatedGaussian

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TemperingSettings:
    """How draws are moved.

    well: power of the weights, of plain resampling, below which draws are moved as well.
    stages: of growing powers, at most.
    kept: share of the draws that go on after the first resampling.
    moves: of all these in each stage.
    share: of the draws that count at least before they are resampled.
    directions: share of the directions along which a move goes.
    """

    well: float = 0.5
    stages: int = 12
    kept: float = 0.5
    moves: int = 3
    share: float = 0.5
    directions: float = 0.15


def tempered(logarithms: Array, least: float) -> tuple[Array, float]:
    """Return normalised weights exp(t l) of log-weights l (n,), and the largest exponent t <= 1 that leaves an
    effective sample size, 1 / sum of squared weights, of `least`."""

    def weights(exponent: float) -> Array:
        scaled = np.where(np.isfinite(logarithms), exponent * logarithms, -np.inf)
        w = np.exp(scaled - scaled.max())
        normalised: Array = w / w.sum()
        return normalised

    if not np.isfinite(logarithms).any():
        return np.full(len(logarithms), 1.0 / len(logarithms)), 0.0
    low, high = 0.0, 1.0
    if 1.0 / (weights(1.0) ** 2).sum() >= least:
        return weights(1.0), 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if 1.0 / (weights(middle) ** 2).sum() >= least else (low, middle)
    return weights(low), low


def systematic(weights: Array, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return `count` indices drawn with probabilities `weights` (n,) by systematic resampling.

    Carpenter, Clifford & Fearnhead (1999).
    """
    positions = (np.arange(count) + rng.uniform()) / count
    found: NDArray[np.int64] = np.minimum(np.searchsorted(np.cumsum(weights), positions), len(weights) - 1)
    return found


def annealed(
    draws: Array,
    logarithms: Array,
    owner: NDArray[np.int64],
    approximations: Sequence[TruncatedGaussian],
    log_ratio: Callable[[Array, NDArray[np.int64]], Array],
    rng: np.random.Generator,
    settings: TemperingSettings | None = None,
) -> tuple[Array, float]:
    """Return draws (K, P) moved towards the posterior, and the power of the weights that was reached.

    draws: from the approximations that `owner` (N,) points to. logarithms (N,): of the posterior over the
    approximation; log_ratio: (draws, owner) -> the same of others.
    """
    settings = settings or TemperingSettings()
    power, kept = 0.0, max(int(settings.kept * len(draws)), 1)
    steps = max(1, round(settings.directions * len(approximations[0].directions)))
    for _ in range(settings.stages):
        if power >= 1.0:
            break
        weights, share = tempered((1.0 - power) * logarithms, max(settings.share * kept, 1.0))
        power += (1.0 - power) * share
        chosen = systematic(weights, kept, rng)
        draws, logarithms, owner = draws[chosen], logarithms[chosen], owner[chosen]
        for _ in range(settings.moves):
            other = draws.copy()
            for number, approximation in enumerate(approximations):
                own = owner == number
                if own.any():
                    other[own] = approximation.moved(draws[own], steps, rng)
            found = log_ratio(other, owner)
            with np.errstate(invalid="ignore"):
                better = np.log(rng.uniform(size=len(draws))) < power * (found - logarithms)
            draws = np.where(better[:, None], other, draws)
            logarithms = np.where(better, found, logarithms)
    return draws, power
