"""Random search: independent uniform samples of the box, the best kept. The yardstick for any better search."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def generation(
    rng: np.random.Generator,
    evaluate: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    population: int,
    keep: int,
    best: Array,
    best_losses: Array,
) -> tuple[Array, Array]:
    """Draw and evaluate one population (N, P), merge it with the best so far, keep the `keep` best in order."""
    candidates = rng.uniform(lower, upper, size=(population, len(lower)))
    losses = evaluate(candidates)
    merged, merged_losses = np.concatenate([best, candidates]), np.concatenate([best_losses, losses])
    order = np.argsort(merged_losses, kind="stable")[:keep]
    return merged[order], merged_losses[order]


def minimise(
    evaluate: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    generations: int,
    population: int = 64,
    keep: int = 8,
    seed: int = 0,
) -> tuple[Array, Array]:
    """The `keep` best of generations x population samples, best first, and their losses."""
    rng = np.random.default_rng(seed)
    best, losses = np.zeros((0, len(lower))), np.zeros(0)
    for _ in range(generations):
        best, losses = generation(rng, evaluate, lower, upper, population, keep, best, losses)
    return best, losses
