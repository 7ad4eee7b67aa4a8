"""Positions rounded to whole pixels: their noise is that of rounding, however evenly a run moves."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.noise import measured_noise
from polyworld.world import World

PIXEL = 0.005  # [m]
WORLD = World.model_validate(
    {
        "objects": [{"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "position": [0, 0, 1]}],
        "environment": {"gravity": [0, 0, 0]},
        "time": {"seconds_per_frame": 0.02, "substep": 0.002},
    }
)


def rounded(speed: float, name: str) -> Run:
    """A run along x at constant speed [m/s], at rest in y and z, seen in whole pixels."""
    times = 0.02 * np.arange(60)
    places = np.stack([0.1 + speed * times, np.full(60, 0.2), np.full(60, 1.0)], axis=1)
    places = PIXEL * np.round(places / PIXEL)
    return Run(name, ("ball",), times, places[:, None], np.full((60, 1, 4), np.nan))


def test_a_run_that_moves_by_whole_pixels_has_the_noise_of_rounding() -> None:
    """One run moves by exactly two pixels a frame, so that its differences scatter by nothing; others do not."""
    even, *others = (rounded(v, f"run{k}") for k, v in enumerate((0.5, 0.37, 0.613, 0.741)))
    noise = measured_noise(design(WORLD, Recording((even, *others))))
    rounding = PIXEL / np.sqrt(12.0)
    for own in noise.sigma:
        assert own.min() >= 0.99 * rounding
        assert own.max() < 3.0 * rounding
    assert noise.levels[0].sigma == pytest.approx(rounding, rel=0.5)
