"""Noise read off tracks, against noise that was put into smooth motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.noise import track_sigma
from tests.polyworld.estimation.pucks import CROSSING, discs, tracks
from tests.scenes.discs import slide

TIMES = np.arange(150) / 60.0
PATH = slide(discs([0.1, 0.05]), CROSSING, TIMES)


def measured(sigma: float, stated: float, *, seed: int = 0, frames: int = 150) -> ObservedTracks:
    found = tracks(PATH[:frames], sigma=sigma, seed=seed)
    return replace(found, position_sigma=np.full_like(found.position_sigma, stated))


@pytest.mark.parametrize("sigma", [0.0005, 0.005, 0.03])
def test_noise_that_is_not_stated_is_read_off_motion_with_a_collision(sigma: float) -> None:
    found = np.array([track_sigma(measured(sigma, 0.0, seed=s)) for s in range(6)])
    assert found.mean() == pytest.approx(sigma, rel=0.15)
    assert found == pytest.approx(np.full_like(found, sigma), rel=0.5)


def test_a_stated_noise_is_believed_between_the_scatter_and_three_times_it() -> None:
    assert track_sigma(measured(0.004, 0.008)) == pytest.approx([0.008, 0.008])
    assert track_sigma(measured(0.004, 0.001)) == pytest.approx([0.004, 0.004], rel=0.4)
    assert track_sigma(measured(0.004, 0.100)) == pytest.approx([0.012, 0.012], rel=0.4)


def test_a_track_too_short_to_tell_has_what_is_stated() -> None:
    assert track_sigma(measured(0.004, 0.007, frames=6)) == pytest.approx([0.007, 0.007])


def test_a_track_that_looks_smooth_by_chance_has_half_of_what_its_neighbours_have() -> None:
    found = measured(0.0, 0.0)
    noise = np.random.default_rng(0).normal(0.0, 0.004, found.positions[:, 1].shape)
    positions = found.positions.copy()
    positions[:, 1] += noise
    first, second = track_sigma(replace(found, positions=positions))
    assert second == pytest.approx(0.004, rel=0.4)
    assert first == pytest.approx(0.25 * second, rel=0.2)  # half the median of the two
