"""How often the gate of goodness of fit raises a false alarm, and how small a push it sees.

    python -m tests.benchmarks.gate_calibration [--cases 500] [--seed 0]

Balls in free flight, fitted in closed form (so nothing but noise, gate and their estimates is judged): 8 runs of 192
samples at 120 Hz, 2 such runs, and 8 runs of 40 samples at 24 Hz; white noise, AR(1) noise of correlation 0.9, and 2%
outliers of 10 standard deviations. Prints one JSON object.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from polyworld.estimation.goodness import Goodness, goodness
from polyworld.estimation.noise import measured_noise, refined_noise
from tests.polyworld.linear_case import (
    Array,
    Draw,
    correlated,
    flight_design,
    flight_fit,
    white,
    with_outliers,
)

SIGMA = 0.01
NOISES: dict[str, Draw] = {"white": white, "ar1_0.9": correlated, "outliers": with_outliers}
DESIGNS = {"8x192": (8, 192, 120.0), "2x192": (2, 192, 120.0), "8x40": (8, 40, 24.0)}
NONCENTRALITIES = (25.0, 50.0, 100.0, 200.0)
REFINEMENTS = 2


def judged(seed: int, draw: Draw, runs: int, count: int, rate: float, push: Array | None = None) -> Goodness:
    """Return the gate's verdict on one drawn recording."""
    plan = flight_design(np.random.default_rng(seed), draw, SIGMA, runs=runs, count=count, rate=rate, push=push)
    noise = measured_noise(plan)
    for _ in range(REFINEMENTS):
        noise = refined_noise(plan, noise, flight_fit(plan, noise)[1])
    return goodness(plan, noise, flight_fit(plan, noise)[0])


def push_of(noncentrality: float, runs: int, count: int, rate: float) -> Array:
    """Return the acceleration whose trace in white noise, less its line, has this squared length."""
    length = runs * count * (count**2 - 1) * (count**2 - 4) / 720.0 / rate**4
    return np.array([SIGMA * np.sqrt(noncentrality / length), 0.0, 0.0])


def main() -> None:
    """Print false alarms by noise and design, and detections of pushes in white noise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    seeds = range(chosen.seed, chosen.seed + chosen.cases)
    alarms = {
        f"{noise} {name}": sum(not judged(seed, draw, *shape).passes for seed in seeds) / chosen.cases
        for noise, draw in NOISES.items()
        for name, shape in DESIGNS.items()
    }
    shape = DESIGNS["8x192"]
    few = seeds[: max(1, chosen.cases // 10)]
    seen = {
        str(n): sum(not judged(seed, white, *shape, push=push_of(n, *shape)).passes for seed in few) / len(few)
        for n in NONCENTRALITIES
    }
    print(json.dumps({"cases": chosen.cases, "false_alarms": alarms, "seen_by_noncentrality": seen}, indent=1))


if __name__ == "__main__":
    main()
