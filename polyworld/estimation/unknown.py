"""A number of the world that a fit may change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Unknown:
    """A number of the world that a fit may change.

    paths: parameter paths (`polyworld.world.parameters`) that take its value, all the same. start: its value where
    nothing is known, the neutral one for a missing effect. lower, upper: bounds. typical: a change of it that would be
    ordinary, from which steps take their scale. run: the one run that it is of; in all others the paths keep the
    world's value. plausible: departure from `start` that physics makes ordinary: the width of a normal prior by which
    hypotheses are compared; None where nothing is known. scale: "log" varies the natural logarithm, of which `typical`
    is then a change. prior: mean and standard deviation of a Gaussian prior with which it is fitted, of the logarithm
    on that scale. powers: exponents with which each path takes the value, as
    a factor beside those of other unknowns, on a log scale; on a linear one factors, as a summand; default 1.
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
