"""The unknowns of a fit: which numbers of a world are searched, where, and from where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.parameters import check_differs_per_world, specification
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FitParameter:
    """One unknown: a value given to one or several paths of the world.

    paths: parameter paths tied to this one value. lower, upper: bounds. mean, sd: where the search begins, in
    the parameter's own unit (for scale "log", sd is that of the natural logarithm). prior: (mean, sd) of a
    Gaussian prior, or None. enters [s]: time before which the value cannot show in the observations; the
    search leaves it alone until the horizon gets there.
    """

    name: str
    paths: tuple[str, ...]
    lower: float
    upper: float
    mean: float
    sd: float
    prior: tuple[float, float] | None = None
    scale: Literal["linear", "log"] = "linear"
    enters: float = 0.0

    def __post_init__(self) -> None:
        if not self.paths:
            raise ValueError(f"parameter {self.name!r} needs at least one path")
        if not self.lower < self.upper:
            raise ValueError(f"parameter {self.name!r}: lower {self.lower} must be below upper {self.upper}")
        if not self.lower <= self.mean <= self.upper:
            raise ValueError(f"parameter {self.name!r}: mean {self.mean} lies outside {self.lower} to {self.upper}")
        if not (self.sd > 0.0 and np.isfinite(self.sd)):
            raise ValueError(f"parameter {self.name!r}: sd must be positive, got {self.sd}")
        if self.scale == "log" and self.lower <= 0.0:
            raise ValueError(f"parameter {self.name!r}: a log scale needs a positive lower bound, got {self.lower}")
        if self.prior is not None and not self.prior[1] > 0.0:
            raise ValueError(f"parameter {self.name!r}: the prior's sd must be positive, got {self.prior[1]}")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "name": self.name,
            "paths": list(self.paths),
            "lower": self.lower,
            "upper": self.upper,
            "mean": self.mean,
            "sd": self.sd,
            "prior": None if self.prior is None else list(self.prior),
            "scale": self.scale,
            "enters": self.enters,
        }


@dataclass(frozen=True)
class SearchSpace:
    """The parameters as a box of search coordinates (P,): values, or logarithms of values.

    lower, upper, mean, sd (P,) are in search coordinates.
    """

    parameters: tuple[FitParameter, ...]
    lower: Array
    upper: Array
    mean: Array
    sd: Array
    logarithmic: NDArray[np.bool_]

    @classmethod
    def of(cls, world: World, parameters: Sequence[FitParameter]) -> SearchSpace:
        """Check the parameters against the world and lay out their box.

        Raises ValueError for repeated names or paths and for bounds beyond the path's own, KeyError for an
        unknown path.
        """
        if not parameters:
            raise ValueError("nothing to fit: give at least one parameter")
        names = [p.name for p in parameters]
        paths = [path for p in parameters for path in p.paths]
        for kind, items in (("names", names), ("paths", paths)):
            repeated = sorted({i for i in items if items.count(i) > 1})
            if repeated:
                raise ValueError(f"parameter {kind} must be unique; repeated: {repeated}")
        for p in parameters:
            for path in p.paths:
                spec = specification(world, path)
                check_differs_per_world(world, path)
                if p.lower < spec.lower or p.upper > spec.upper:
                    raise ValueError(
                        f"parameter {p.name!r}: bounds {p.lower} to {p.upper} exceed those of {path}, "
                        f"{spec.lower} to {spec.upper} {spec.unit}"
                    )
        logarithmic = np.array([p.scale == "log" for p in parameters])

        def search(values: list[float]) -> Array:
            given = np.asarray(values, dtype=float)
            return np.where(logarithmic, np.log(np.where(logarithmic, given, 1.0)), given)

        return cls(
            parameters=tuple(parameters),
            lower=search([p.lower for p in parameters]),
            upper=search([p.upper for p in parameters]),
            mean=search([p.mean for p in parameters]),
            sd=np.array([p.sd for p in parameters], dtype=float),
            logarithmic=logarithmic,
        )

    def values(self, coordinates: Array) -> Array:
        """Parameter values (..., P) of search coordinates (..., P), within their bounds."""
        bounded = np.clip(coordinates, self.lower, self.upper)
        values: Array = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, bounded, 0.0)), bounded)
        low = np.array([p.lower for p in self.parameters])
        high = np.array([p.upper for p in self.parameters])
        return np.clip(values, low, high)  # exp(log(x)) may miss a bound by one rounding

    def overrides(self, coordinates: Array) -> dict[str, Array]:
        """Parameter path -> values (N,) of candidates (N, P)."""
        values = self.values(coordinates)
        return {path: values[:, i].copy() for i, p in enumerate(self.parameters) for path in p.paths}

    def assignments(self, coordinates: Array) -> dict[str, float]:
        """Parameter path -> value of one candidate (P,)."""
        values = self.values(coordinates)
        return {path: float(values[i]) for i, p in enumerate(self.parameters) for path in p.paths}

    def coordinates(self, values: dict[str, float]) -> Array:
        """Search coordinates (P,) of values by parameter name, projected on their bounds."""
        given = np.array([values[p.name] for p in self.parameters], dtype=float)
        low = np.array([p.lower for p in self.parameters])
        high = np.array([p.upper for p in self.parameters])
        bounded = np.clip(given, low, high)
        result: Array = np.where(self.logarithmic, np.log(np.where(self.logarithmic, bounded, 1.0)), bounded)
        return result

    def prior_residuals(self, coordinates: Array) -> Array:
        """(value - prior mean) / prior sd of candidates (N, P), one column for each parameter with a prior."""
        values = self.values(coordinates)
        columns = [
            (values[:, i] - p.prior[0]) / p.prior[1] for i, p in enumerate(self.parameters) if p.prior is not None
        ]
        return np.stack(columns, axis=1) if columns else np.zeros((len(values), 0))

    def entered(self, horizon: float) -> NDArray[np.bool_]:
        """Which parameters can show in observations up to `horizon` [s], shape (P,)."""
        return np.array([p.enters <= horizon for p in self.parameters])
