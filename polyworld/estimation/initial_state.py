"""Coordinates of the initial state of one run or stretch, and how they become parameters of its world."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.unknown import Unknown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StateMap:
    """Coordinates (N,) of an initial state.

    labels, start, typical (N,): names, first guesses, ordinary changes. prior (N, 2): mean and standard deviation,
    infinite where there is none. overrides: (values (k, N), parameters that differ already) -> path to values (k,).
    paths: coordinate -> path, of those that are parameters themselves.
    """

    labels: tuple[str, ...]
    start: Array
    typical: Array
    prior: Array
    overrides: Callable[[Array, Mapping[str, Array]], dict[str, Array]]
    paths: Mapping[int, str]

    @property
    def count(self) -> int:
        """Number N of coordinates."""
        return len(self.labels)


def of_paths(unknowns: Sequence[Unknown]) -> StateMap:
    """Return the map of coordinates that are parameters themselves."""
    paths = [u.paths[0] for u in unknowns]

    def overrides(values: Array, given: Mapping[str, Array]) -> dict[str, Array]:
        return {path: values[:, i].copy() for i, path in enumerate(paths)}

    none = (0.0, np.inf)
    return StateMap(
        tuple(u.name for u in unknowns),
        np.array([u.start for u in unknowns], dtype=float),
        np.array([u.typical for u in unknowns], dtype=float),
        np.array([u.prior or none for u in unknowns], dtype=float).reshape(-1, 2),
        overrides,
        dict(enumerate(paths)),
    )
