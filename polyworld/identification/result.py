"""What a fit returns: the fitted world, how well it follows the data, and how well the data determine it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from polyworld.identification.accuracy import Accuracy
from polyworld.world import World

Method = Literal["cem", "random_search", "refine"]


@dataclass(frozen=True)
class FittedValue:
    """A fitted parameter: its value and how well it is known, in its own unit.

    spread: standard deviation of the last elite set (None for methods without one); standard_error: from the
    sensitivity of the observations around the optimum. at_bound: the value lies within one standard error,
    or a hundredth of the range, of a bound of the search.
    """

    name: str
    value: float
    unit: str
    lower: float
    upper: float
    spread: float | None
    standard_error: float
    at_bound: bool
    paths: tuple[str, ...]


@dataclass(frozen=True)
class Undetermined:
    """A parameter, or a combination of several, which the data cannot determine, and why."""

    parameters: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class LossPoint:
    """Loss after one generation: over `samples` sample times, best so far and median of the population's elite."""

    generation: int
    restart: int
    samples: int
    best: float
    median: float


@dataclass(frozen=True)
class FitResult:
    """Outcome of a fit. loss and loss_start are over the full fitted window, at the result and at the world given.

    accuracy_* compare with the fitted frames; held_out_* with the frames after them, and are None when the fit
    left none out or the rollout diverged. noise_factor and correlation_time: see `Sensitivity`. seconds is wall
    time; everything else is reproducible from the inputs and the seed.
    """

    method: Method
    status: Literal["completed", "cancelled"]
    world: World
    loss: float
    loss_start: float
    values: tuple[FittedValue, ...]
    undetermined: tuple[Undetermined, ...]
    accuracy_start: Accuracy | None
    accuracy: Accuracy | None
    held_out_start: Accuracy | None
    held_out: Accuracy | None
    noise_factor: float
    correlation_time: float
    rollouts: int
    rollouts_for_errors: int
    seconds: float
    seed: int
    history: tuple[LossPoint, ...]
    fitted_frames: tuple[int, int]
    unobserved: tuple[str, ...]
    unmodelled: tuple[str, ...]

    def value(self, name: str) -> FittedValue:
        """A fitted value by parameter name; raises KeyError naming the choices."""
        for candidate in self.values:
            if candidate.name == name:
                return candidate
        raise KeyError(f"unknown parameter {name!r}; fitted: {[v.name for v in self.values]}")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values; the world by its id only."""
        return {
            "method": self.method,
            "status": self.status,
            "world": self.world.id,
            "loss": self.loss,
            "loss_start": self.loss_start,
            "values": [
                {
                    "name": v.name,
                    "value": v.value,
                    "unit": v.unit,
                    "bounds": [v.lower, v.upper],
                    "spread": v.spread,
                    "standard_error": v.standard_error if np.isfinite(v.standard_error) else None,
                    "at_bound": v.at_bound,
                    "paths": list(v.paths),
                }
                for v in self.values
            ],
            "undetermined": [{"parameters": list(u.parameters), "reason": u.reason} for u in self.undetermined],
            **{
                key: None if item is None else item.to_dict()
                for key, item in (
                    ("accuracy_start", self.accuracy_start),
                    ("accuracy", self.accuracy),
                    ("held_out_start", self.held_out_start),
                    ("held_out", self.held_out),
                )
            },
            "noise_factor": self.noise_factor if np.isfinite(self.noise_factor) else None,
            "correlation_time": self.correlation_time if np.isfinite(self.correlation_time) else None,
            "rollouts": self.rollouts,
            "rollouts_for_errors": self.rollouts_for_errors,
            "seconds": self.seconds,
            "seed": self.seed,
            "history": [vars(point).copy() for point in self.history],
            "fitted_frames": list(self.fitted_frames),
            "unobserved": list(self.unobserved),
            "unmodelled": list(self.unmodelled),
        }
