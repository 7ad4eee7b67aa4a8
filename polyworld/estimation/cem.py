"""The cross-entropy method over a box: a diagonal Gaussian drawn towards its best samples.

Rubinstein & Kroese, The Cross-Entropy Method (2004), with the smoothed update and the variance floor:
samples are projected on their bounds, the elite set of lowest losses gives mean and standard deviation, both
are smoothed with the previous ones, and the deviation is kept above a floor. The best candidates so far are
carried into the next generation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Evaluate = Callable[[Array], Array]


@dataclass(frozen=True)
class CemSettings:
    """population N candidates a generation, of which `elites` K form the elite set and the `carried` best so
    far are candidates of the generation before. smoothing: the weight of the old mean and deviation. floor:
    smallest standard deviation as a share of the initial one.
    """

    population: int = 64
    elites: int = 12
    carried: int = 4
    smoothing: float = 0.4
    floor: float = 0.01

    def __post_init__(self) -> None:
        if not 2 <= self.elites <= self.population:
            raise ValueError(f"elites must lie in 2..population ({self.population}), got {self.elites}")
        if not 0 <= self.carried <= min(self.elites, self.population - 1):
            raise ValueError(f"carried must lie in 0..{min(self.elites, self.population - 1)}, got {self.carried}")
        if not 0.0 <= self.smoothing < 1.0:
            raise ValueError(f"smoothing must lie in [0, 1), got {self.smoothing}")
        if not 0.0 <= self.floor <= 1.0:
            raise ValueError(f"floor must lie in 0..1, got {self.floor}")


@dataclass
class CemState:
    """All that the search knows between generations.

    mean, sd (P,): the proposal. elite (K', P): the best candidates so far, best first, and their losses.
    rng: state of the random generator.
    """

    generation: int
    mean: Array
    sd: Array
    elite: Array
    elite_losses: Array
    rng: dict[str, Any]

    @classmethod
    def start(cls, mean: Array, sd: Array, seed: int) -> CemState:
        """Return the state before the first generation."""
        p = len(mean)
        return cls(
            generation=0,
            mean=np.array(mean, dtype=float),
            sd=np.array(sd, dtype=float),
            elite=np.zeros((0, p)),
            elite_losses=np.zeros(0),
            rng=dict(np.random.default_rng(seed).bit_generator.state),
        )


def generation(
    state: CemState,
    evaluate: Evaluate,
    lower: Array,
    upper: Array,
    floor: Array,
    settings: CemSettings,
    *,
    free: NDArray[np.bool_] | None = None,
) -> CemState:
    """Run one generation: sample, project, evaluate, select, update; return the next state.

    evaluate: candidates (N, P) -> losses (N,). floor (P,): smallest standard deviations. free (P,):
    parameters that take part (default all); the others keep their mean in every candidate and their proposal.
    The carried candidates are evaluated again with the rest, so `evaluate` may change between generations
    (a longer horizon) and the elite's losses always belong to the present one.
    """
    rng = np.random.default_rng(0)
    rng.bit_generator.state = state.rng
    active = np.ones(len(state.mean), dtype=bool) if free is None else free
    noise = rng.standard_normal((settings.population, len(state.mean)))
    candidates = np.clip(state.mean + state.sd * noise * active, lower, upper)
    # The mean itself is a candidate, and the best so far are carried over.
    candidates[-1] = np.clip(state.mean, lower, upper)
    carried = state.elite[: settings.carried]
    candidates[: len(carried)] = carried
    losses = evaluate(candidates)
    order = np.argsort(losses, kind="stable")[: settings.elites]
    elite = candidates[order]
    elite_mean, elite_sd = elite.mean(axis=0), elite.std(axis=0)
    a = settings.smoothing
    mean = np.where(active, a * state.mean + (1.0 - a) * elite_mean, state.mean)
    sd = np.where(active, np.maximum(floor, a * state.sd + (1.0 - a) * elite_sd), state.sd)
    return CemState(
        generation=state.generation + 1,
        mean=mean,
        sd=sd,
        elite=elite,
        elite_losses=losses[order],
        rng=dict(rng.bit_generator.state),
    )
