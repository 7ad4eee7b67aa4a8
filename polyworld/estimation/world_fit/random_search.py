"""Random search: independent uniform samples of the box, the best kept. The yardstick for any better search."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def generations(
    evaluate: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    *,
    count: int,
    population: int = 64,
    keep: int = 8,
    seed: int = 0,
) -> Iterator[tuple[Array, Array]]:
    """Draw and evaluate `count` populations (N, P); yield after each the `keep` best so far, in order, and losses."""
    rng = np.random.default_rng(seed)
    best, losses = np.zeros((0, len(lower))), np.zeros(0)
    for _ in range(count):
        candidates = rng.uniform(lower, upper, size=(population, len(lower)))
        merged, merged_losses = np.concatenate([best, candidates]), np.concatenate([losses, evaluate(candidates)])
        order = np.argsort(merged_losses, kind="stable")[:keep]
        best, losses = merged[order], merged_losses[order]
        yield best, losses
