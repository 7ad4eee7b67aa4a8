"""Derivatives by differences, of parameters that no residual shares in one rollout."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.problem import Flags, Ints

Array = NDArray[np.float64]


def difference_slopes(values: Array, colour: Ints, width: Array, moved: Flags | None) -> Array:
    """Return slopes (m, K) of values (1 + colours, m) by coordinates that were moved together by colour.

    width (K, 1): of the moves. moved (K, m): which values a coordinate can move; None where it may move all.
    """
    change = (values[1:] - values[0])[colour] / width
    found: Array = (change if moved is None else change * moved).T
    return found


def coloured(touched: Flags) -> Ints:
    """Return a colour for every coordinate (K,): those of one colour move different groups (K, G)."""
    used: list[Flags] = []
    found = np.zeros(len(touched), dtype=np.int64)
    for i, row in enumerate(touched):
        free = next((c for c, taken in enumerate(used) if not (taken & row).any()), len(used))
        if free == len(used):
            used.append(np.zeros(len(row), dtype=bool))
        used[free] = used[free] | row
        found[i] = free
    return found
