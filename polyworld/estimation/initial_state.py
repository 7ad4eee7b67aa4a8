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
    """

    labels: tuple[str, ...]
    start: Array
    typical: Array
    prior: Array
    overrides: Callable[[Array, Mapping[str, Array]], dict[str, Array]]

    @property
    def count(self) -> int:
        """Number N of coordinates."""
        return len(self.labels)


def of_paths(unknowns: Sequence[Unknown]) -> StateMap:
    """Return the map of coordinates that are parameters themselves."""
    paths = [u.paths[0] for u in unknowns]

    def overrides(values: Array, _: Mapping[str, Array]) -> dict[str, Array]:
        return {path: values[:, i].copy() for i, path in enumerate(paths)}

    none = (0.0, np.inf)
    return StateMap(
        tuple(u.name for u in unknowns),
        np.array([u.start for u in unknowns], dtype=float),
        np.array([u.typical for u in unknowns], dtype=float),
        np.array([u.prior or none for u in unknowns], dtype=float).reshape(-1, 2),
        overrides,
    )


def joined(parts: Sequence[StateMap]) -> StateMap:
    """Return the coordinates of several parts one after another."""
    cuts = np.cumsum([p.count for p in parts])[:-1] if parts else np.zeros(0, dtype=int)

    def overrides(values: Array, given: Mapping[str, Array]) -> dict[str, Array]:
        found: dict[str, Array] = {}
        for part, own in zip(parts, np.split(values, cuts, axis=1), strict=True) if parts else ():
            found |= part.overrides(own, given)
        return found

    empty = np.zeros(0)
    return StateMap(
        tuple(label for p in parts for label in p.labels),
        np.concatenate([empty, *(p.start for p in parts)]),
        np.concatenate([empty, *(p.typical for p in parts)]),
        np.concatenate([np.zeros((0, 2)), *(p.prior for p in parts)]),
        overrides,
    )
