"""Jumps of velocity between segments: what a missing push makes them, and what noise does."""

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.gap.examine import fitted_base
from polyworld.gap.segment_jumps import SegmentJump, segment_jumps
from tests.polyworld.gap_scenes import puck_world

TABLE = puck_world(friction=0.0)
COUNT, STEP, NOISE = 96, 0.01, 1e-3  # samples of a run, [s], [m]


def jumps(acceleration: tuple[float, float], runs: int, kick: float = 0.0) -> tuple[SegmentJump, ...]:
    """Jumps of pucks on a frictionless table, which something pushes steadily [m/s^2] and kicks half-way [m/s] in x."""
    rng, times = np.random.default_rng(5), np.arange(COUNT) * STEP
    found = []
    for k in range(runs):
        places = np.full((COUNT, 1, 3), np.nan)
        way = np.outer(times, rng.normal(size=2)) + 0.5 * np.outer(times**2, acceleration)
        way[:, 0] += kick * np.maximum(times - times[COUNT // 2], 0.0)
        places[:, 0, :2] = way + rng.normal(scale=NOISE, size=way.shape)
        found.append(Run(f"r{k}", ("puck",), times, places, np.full((COUNT, 1, 4), np.nan), sigma=NOISE))
    trial = fitted_base(design(TABLE, Recording(tuple(found))), ())
    cut = segment_jumps(trial)
    assert cut is not None
    return cut


def test_a_steady_push_shows_at_all_joints_as_its_acceleration_over_a_segment() -> None:
    found = jumps((0.4, -0.3), runs=2)
    assert len(found) == 2 * (COUNT // 16 - 1)
    for jump in found:
        np.testing.assert_allclose(jump.change[:2], np.array([0.4, -0.3]) * 16 * STEP, atol=5 * jump.sigma)
        assert np.isnan(jump.change[2])  # heights were not measured
        assert jump.sigmas > 5


def test_a_kick_shows_at_its_time_and_place_alone() -> None:
    found = jumps((0.0, 0.0), runs=1, kick=0.3)
    largest = max(found, key=lambda jump: jump.sigmas)
    assert largest.time == pytest.approx(STEP * COUNT / 2, abs=8 * STEP)
    assert largest.change[0] == pytest.approx(0.3, rel=0.2)
    others = [jump for jump in found if abs(jump.time - largest.time) > 20 * STEP]
    assert others
    assert all(jump.sigmas < 4 for jump in others)


def test_of_noise_alone_jumps_are_as_large_as_their_standard_deviations_say() -> None:
    squares = [jump.sigmas**2 for jump in jumps((0.0, 0.0), runs=12)]
    assert len(squares) == 60
    assert np.mean(squares) == pytest.approx(2.0, abs=4 * 2.0 / np.sqrt(60))  # chi2 of two components


def test_runs_whose_places_nobody_measured_have_none() -> None:
    times = np.arange(COUNT) * STEP
    turned = np.zeros((COUNT, 1, 4))
    turned[:, 0, 0], turned[:, 0, 3] = np.cos(times / 2), np.sin(times / 2)  # 1 rad/s about z
    run = Run("r", ("puck",), times, np.full((COUNT, 1, 3), np.nan), turned)
    assert segment_jumps(fitted_base(design(TABLE, Recording((run,))), ())) is None
