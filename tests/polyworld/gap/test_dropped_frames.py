"""Frames that a camera dropped: their onset and length from one fit that knows nothing of them."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.hypothesis import extended
from polyworld.gap.catalogue import catalogue
from polyworld.gap.dropped_frames import score_test_dropped_frames
from polyworld.gap.examine import fitted_base
from tests.polyworld.gap_scenes import ball_world

RATE, ONSET, DROPPED = 100.0, 0.7, 3  # frames a second, seconds, frames


def turning(velocity: float, spin: float, sigma: float = 0.001, dropped: float = DROPPED) -> Recording:
    """Two flights of a turning ball without a bounce; the first loses so many frames."""
    rng = np.random.default_rng(4)
    stamps = np.arange(100) / RATE
    runs = []
    for k in range(2):
        times = stamps + (stamps > ONSET) * (dropped / RATE if k == 0 else 0.0)
        places = np.stack([velocity * times, 0.0 * times, 8.0 - 0.5 * 9.81 * times**2], axis=-1)
        half = 0.5 * (spin * times + rng.normal(0.0, sigma, len(times)))
        turned = np.stack([np.cos(half), 0.0 * half, np.sin(half), 0.0 * half], axis=-1)
        places += rng.normal(0.0, sigma, places.shape)
        runs.append(Run(f"run{k}", ("ball",), stamps, places[:, None], turned[:, None]))
    return Recording(tuple(runs))


@pytest.mark.parametrize("shown_by", ["places and turns", "turns alone"])
def test_onset_and_length_of_a_gap_in_the_frames(shown_by: str) -> None:
    recording = turning(4.0, 15.0)
    if shown_by == "turns alone":
        still = turning(0.0, 15.0).runs
        recording = Recording(
            tuple(replace(r, positions=np.where([True, False, False], r.positions, np.nan)) for r in still)
        )
    base = fitted_base(design(ball_world(), recording), ())
    ways = [h for h in extended(base.hypothesis, catalogue()["dropped_frames"], recording)]
    best = score_test_dropped_frames(base.context, base, ways, 3)[0]
    values = dict(zip((u.name for u in best.hypothesis.unknowns), best.values, strict=True))
    assert best.hypothesis.world.observer is not None
    assert best.hypothesis.world.observer.shift_run == "run0"
    assert values["shift_time"] == pytest.approx(ONSET, abs=1.5 / RATE)
    assert values["shift"] == pytest.approx(DROPPED / RATE, rel=0.1)


def test_a_lag_of_a_third_of_a_frame_is_no_frame_that_was_dropped() -> None:
    """So late is a model that makes an impact in no time of what took some milliseconds."""
    for lag, found in ((0.3, False), (1.0, True)):
        recording = turning(4.0, 15.0, dropped=lag)
        base = fitted_base(design(ball_world(), recording), ())
        ways = extended(base.hypothesis, catalogue()["dropped_frames"], recording)
        onsets = score_test_dropped_frames(base.context, base, ways, 3)
        assert bool(onsets) is found
        assert all(abs(tested.values[0]) > 0.5 / RATE for tested in onsets)
