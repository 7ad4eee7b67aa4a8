"""Numbers that a fit may change: of the world, and coordinates of the initial state of one run or stretch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.world import World, geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unknown:
    """A number of the world that a fit may change.

    paths: parameter paths (`polyworld.world.parameters`) that take its value, all the same. start: its value where
    nothing is known, the neutral one for a missing effect. lower, upper: bounds. typical: a change of it that would be
    ordinary, from which steps take their scale. run: the one run that it is of; in all others the paths keep the
    world's value. plausible: departure from `start` that physics makes ordinary: the width of a normal prior by which
    hypotheses are compared; None where nothing is known. scale: "log" varies the natural logarithm, of which `typical`
    is then a change. prior: mean and standard deviation of a Gaussian prior with which it is fitted, of the logarithm
    on that scale. powers: exponents with which each path takes the value, as a factor beside those of other unknowns,
    on a log scale; on a linear one factors, as a summand; default 1. elsewhere: runs and paths that do not take it,
    since there another object has the name.
    """

    name: str
    paths: tuple[str, ...]
    unit: str
    start: float
    lower: float
    upper: float
    typical: float
    run: str | None = None
    plausible: float | None = None
    prior: tuple[float, float] | None = None
    scale: Literal["linear", "log"] = "linear"
    powers: tuple[float, ...] = ()
    elsewhere: frozenset[tuple[str, str]] = frozenset()


Guess = tuple[float, float]  # a first guess, and a change that is ordinary


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


def of_paths(
    guesses: Mapping[str, Guess],
    priors: Mapping[str, tuple[float, float]] | None = None,
    fixed: Mapping[str, float] | None = None,
) -> StateMap:
    """Return coordinates that are parameters themselves, by path. priors: means and deviations of some of them. fixed:
    parameters that take a value of their own and are not fitted."""

    def overrides(values: Array, _: Mapping[str, Array]) -> dict[str, Array]:
        known = {path: np.full(len(values), v) for path, v in (fixed or {}).items()}
        return known | {path: values[:, i].copy() for i, path in enumerate(guesses)}

    start, typical = np.array(list(guesses.values()), dtype=float).reshape(-1, 2).T
    prior = np.array([(priors or {}).get(path, (0.0, np.inf)) for path in guesses], dtype=float).reshape(-1, 2)
    return StateMap(tuple(path.removeprefix("objects.") for path in guesses), start, typical, prior, overrides)


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


def free_axes(world: World) -> str:
    """World axes along which objects move: an oblique motion plane needs all three to be varied."""
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return "".join(a for i, a in enumerate("xyz") if not (world.planar and abs(normal[i]) > 1.0 - 1e-9))
