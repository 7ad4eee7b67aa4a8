"""Rhythms above the low modes: how seldom noise shows one, and that a table which shakes is found and named."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.goodness import MODES, projected
from polyworld.estimation.lines import Line, strongest_line
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.examine import fitted_base
from tests.polyworld.gap_scenes import puck_world

SIGMA = 0.001
AMPLITUDE, PHASE = np.array([0.24, 0.18]), 0.4  # of the table's shaking [m/s^2]
TABLE = puck_world(friction=0.0)
Drawn = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]  # noise


def shaken(frequency: float, seconds: float, seed: int = 1, noise: Drawn | None = None) -> Recording:
    """A puck that slides without friction while a = A sin(2 pi f t + phi): twice integrated, at 60 Hz, with noise."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, 1.0 / 60.0)
    w = 2.0 * np.pi * frequency
    shift = (np.sin(PHASE) - np.sin(w * times + PHASE)) / w**2 + np.cos(PHASE) * times / w
    places = np.full((len(times), 1, 3), np.nan)
    clear = np.array([0.2, -0.1]) + np.array([0.3, 0.1]) * times[:, None] + AMPLITUDE * shift[:, None]
    drawn = rng.normal(0.0, SIGMA, clear.shape) if noise is None else noise(rng, clear.shape)
    places[:, 0, :2] = clear + drawn
    return Recording((Run("slide", ("puck",), times, places, np.full((len(times), 1, 4), np.nan)),))


def still(seed: int, noise: Drawn | None = None) -> Recording:
    (run,) = shaken(1.0, 8.0, seed, noise).runs
    (calm,) = shaken(1.0, 8.0, seed, lambda _rng, shape: np.zeros(shape)).runs
    along = np.array([0.2, -0.1]) + np.array([0.3, 0.1]) * run.times[:, None]
    places = run.positions.copy()
    places[:, 0, :2] += along - calm.positions[:, 0, :2]
    return Recording((Run("slide", ("puck",), run.times, places, run.orientations),))


def correlated(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    drawn = rng.normal(0.0, SIGMA, shape)
    for k in range(1, len(drawn)):
        drawn[k] = 0.9 * drawn[k - 1] + np.sqrt(1.0 - 0.81) * drawn[k]
    return drawn


def with_outliers(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.normal(0.0, SIGMA, shape) * np.where(rng.random((shape[0], 1)) < 0.03, 20.0, 1.0)


def line_of(recording: Recording) -> Line:
    trial = fitted_base(design(TABLE, recording), ())
    return strongest_line(trial.context.design, trial.context.noise, projected(trial.fit)[0], MODES)


@pytest.mark.parametrize("noise", [None, correlated, with_outliers])
def test_noise_shows_a_line_as_seldom_as_its_p_says(noise: Drawn | None) -> None:
    p = np.array([line_of(still(seed, noise)).p for seed in range(10)])
    assert np.mean(p < 0.1) < 0.35
    assert p.min() > 1e-3


def test_what_was_rounded_coarsely_is_not_asked_for_lines() -> None:
    """Slow motion in coarse steps is a saw, as regular as a rhythm."""
    rounded = still(3)
    (run,) = rounded.runs
    coarse = Recording((Run("slide", ("puck",), run.times, np.round(run.positions, 2), run.orientations),))
    assert line_of(coarse).p == 1.0


@cache
def found(frequency: float, seconds: float) -> GapReport:
    return find_gap(TABLE, shaken(frequency, seconds), settings=GapSettings(null_control=False))


@pytest.mark.parametrize(("frequency", "seconds"), [(1.7, 15.0), (0.09, 25.0), (1.7, 25.0)])
def test_a_table_that_shakes_is_found_in_long_runs_too(frequency: float, seconds: float) -> None:
    """25 cycles; and in two parts 2, about one in each, and 42."""
    summary = found(frequency, seconds).to_dict()
    assert summary["verdict"] == "identified"
    (effect,) = summary["effects"]
    assert effect["name"] == "periodic_forcing"
    true = {"frequency": frequency, "amplitude_x": AMPLITUDE[0], "amplitude_y": AMPLITUDE[1], "phase": PHASE}
    for name, value in true.items():
        low, high = effect["unknowns"][name]["interval95"]
        assert low < value < high


def test_the_rhythm_is_reported() -> None:
    base = found(1.7, 15.0).base
    assert "a rhythm of 1.7 Hz in puck position" in base.goodness.summary()
    rhythm = base.goodness.to_json()["rhythm"]
    assert isinstance(rhythm, dict)
    assert rhythm["frequency"] == pytest.approx(1.7, abs=0.05)
    assert rhythm["run"] == "slide"
