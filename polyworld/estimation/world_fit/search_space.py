"""The unknowns of a fit as a box of search coordinates: values, or logarithms of values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.support_constraints import SupportConstraint
from polyworld.world import World
from polyworld.world.parameters import check_differs_per_world, specification

Array = NDArray[np.float64]


class SearchSpace:
    """A box of P search coordinates.

    lower, upper, mean, sd (P,): the box, and where a search begins, in search coordinates. logarithmic (P,).
    constraints: on what several unknowns do together.
    """

    def __init__(
        self, world: World, unknowns: Sequence[Unknown], constraints: Sequence[SupportConstraint] = ()
    ) -> None:
        """Lay out the box of some unknowns.

        Raises ValueError for repeated names or paths, impossible bounds, starts, widths or priors, and bounds beyond
        the path's own; KeyError for an unknown path.
        """
        if not unknowns:
            raise ValueError("nothing to fit: give at least one parameter")
        names = [u.name for u in unknowns]
        paths = [path for u in unknowns for path in u.paths]
        for kind, items in (("names", names), ("paths", paths)):
            repeated = sorted({i for i in items if items.count(i) > 1})
            if repeated:
                raise ValueError(f"parameter {kind} must be unique; repeated: {repeated}")
        for u in unknowns:
            _check(world, u)
        self.unknowns = tuple(unknowns)
        self.constraints = tuple(constraints)
        self.logarithmic = np.array([u.scale == "log" for u in unknowns])
        self._least = np.array([u.lower for u in unknowns])
        self._most = np.array([u.upper for u in unknowns])
        self.lower, self.upper = self._searched(self._least), self._searched(self._most)
        self.mean = self._searched(np.array([u.start for u in unknowns]))
        self.sd = np.array([u.typical for u in unknowns])

    @property
    def width(self) -> Array:
        """Widths of the bounds (P,)."""
        width: Array = self.upper - self.lower
        return width

    def values(self, coordinates: Array) -> Array:
        """Return values (..., P) of search coordinates (..., P), within their bounds."""
        bounded = np.clip(coordinates, self.lower, self.upper)
        values = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, bounded, 0.0)), bounded)
        inside: Array = np.clip(values, self._least, self._most)  # exp(log(x)) may miss a bound by one rounding
        return inside

    def overrides(self, coordinates: Array) -> dict[str, Array]:
        """Parameter path -> values (N,) of candidates (N, P)."""
        values = self.values(coordinates)
        return {path: values[:, i].copy() for i, u in enumerate(self.unknowns) for path in u.paths}

    def coordinates(self, values: dict[str, float]) -> Array:
        """Search coordinates (P,) of values by name, projected on their bounds."""
        return self._searched(np.clip([values[u.name] for u in self.unknowns], self._least, self._most))

    def prior_residuals(self, coordinates: Array) -> Array:
        """Return (value - prior mean) / prior sd of candidates (N, P), one column for each unknown with a prior, and
        those of the constraints."""
        values = self.values(coordinates)
        columns = [(values[:, i] - u.prior[0]) / u.prior[1] for i, u in enumerate(self.unknowns) if u.prior is not None]
        priors = np.stack(columns, axis=1) if columns else np.zeros((len(values), 0))
        by_path = {path: values[:, i] for i, u in enumerate(self.unknowns) for path in u.paths}
        return np.concatenate([priors, *(c.residuals(by_path, len(values)) for c in self.constraints)], axis=1)

    def entered(self, horizon: float) -> NDArray[np.bool_]:
        """Return which unknowns (P,) can show in observations up to `horizon` [s]."""
        return np.array([u.enters <= horizon for u in self.unknowns])

    def _searched(self, values: Array) -> Array:
        searched: Array = np.where(self.logarithmic, np.log(np.where(self.logarithmic, values, 1.0)), values)
        return searched


def _check(world: World, u: Unknown) -> None:
    head = f"parameter {u.name!r}"
    if not u.paths:
        raise ValueError(f"{head} needs at least one path")
    if not (u.lower <= u.start <= u.upper and u.lower < u.upper):
        raise ValueError(f"{head}: {u.start} must lie within {u.lower} to {u.upper}, of which the second is larger")
    if not 0.0 < u.typical < np.inf or (u.prior is not None and not u.prior[1] > 0.0):
        raise ValueError(f"{head}: standard deviations must be positive, got {u.typical} and the prior {u.prior}")
    if u.scale == "log" and u.lower <= 0.0:
        raise ValueError(f"{head}: a log scale needs a positive lower bound, got {u.lower}")
    for path in u.paths:
        spec = specification(world, path)
        check_differs_per_world(world, path)
        if u.lower < spec.lower or u.upper > spec.upper:
            raise ValueError(
                f"{head}: bounds {u.lower} to {u.upper} exceed those of {path}, "
                f"{spec.lower} to {spec.upper} {spec.unit}"
            )
