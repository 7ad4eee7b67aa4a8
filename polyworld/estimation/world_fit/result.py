"""Result of a fit: the fitted world, how well it follows the data, and how well the data determine it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from polyworld.estimation.world_fit.accuracy import Accuracy, json_ready
from polyworld.world import World

Method = Literal["cem", "random_search", "refine", "prefixes"]
Status = Literal["completed", "cancelled"]


@dataclass(frozen=True)
class FittedValue:
    """A fitted parameter: its value and how well it is known, in its own unit.

    spread: standard deviation of the last elite set (None for methods without one); standard_error: from the
    sensitivity of the observations around the optimum. at_bound: the value lies within one standard error,
    or a hundredth of the range, of one of the bounds of the search.
    """

    name: str
    value: float
    unit: str
    bounds: tuple[float, float]
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
    time; everything else is reproducible from the inputs and the seed. unobserved: objects without observations;
    unmodelled: observed objects that the world lacks.
    """

    method: Method
    status: Status
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
        """Return a fitted value by parameter name; raises KeyError naming the choices."""
        for candidate in self.values:
            if candidate.name == name:
                return candidate
        raise KeyError(f"unknown parameter {name!r}; fitted: {[v.name for v in self.values]}")

    @property
    def by_name(self) -> dict[str, float]:
        """Fitted values by parameter name, from which another fit can start."""
        return {value.name: value.value for value in self.values}

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values; the world by its id only."""
        found = dict(vars(self)) | {"world": self.world.id}
        for key in ("values", "undetermined", "history"):
            found[key] = [vars(item) for item in found[key]]
        for key in ("accuracy_start", "accuracy", "held_out_start", "held_out"):
            found[key] = None if found[key] is None else found[key].to_dict()
        ready: dict[str, Any] = json_ready(found)
        return ready
