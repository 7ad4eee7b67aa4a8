"""Where the gap is, for gaps put at a known place, time and axis."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.gap.cross_validation import examined
from polyworld.gap.localise import Localisation, localise, motions, onsets, recursive_residuals
from polyworld.world import World
from tests.polyworld.gap_scenes import Bouncing, G, Launch, ball_recording, ball_world, launches

Array = NDArray[np.float64]


def no_floor() -> World:
    return ball_world().model_copy(update={"statics": ()})


def flights(
    seed: int, noise: float, push: tuple[float, float, float] = (0.0, 0.0, 0.0), since: float = 0.0
) -> Recording:
    """Four flights of a ball through no air, pushed by a constant acceleration [m/s^2] from an instant [s] on."""
    rng = np.random.default_rng(seed)
    whole = ball_recording(Bouncing(planes=()), launches(rng, 4), rng, noise, duration=1.5, rate=60.0)
    runs = []
    for run in whole.runs:
        late = np.maximum(run.times - since, 0.0)
        runs.append(replace(run, positions=run.positions + 0.5 * late[:, None, None] ** 2 * np.array(push)))
    return Recording(tuple(runs))


def located(recording: Recording) -> Localisation:
    return localise(examined(no_floor(), recording))


def test_noise_alone_is_alike_everywhere() -> None:
    found = located(flights(0, 0.01))
    assert found.ratio == pytest.approx(1.0, abs=0.3)  # third differences of 90 samples show the noise to 14%
    assert "residuals are those of noise" in found.summary()
    assert not found.onsets
    assert all(level.ratio < 1.0 + 4.5 * level.error for levels in found.factors.values() for level in levels)


def test_the_axis_of_a_push_is_reported() -> None:
    found = located(flights(1, 0.001, push=(0.0, 0.5, 0.0)))
    axis = found.factors["axis"]
    assert axis[0].level == "position y"
    assert axis[0].share > 0.95
    assert "position y" in found.summary()
    assert axis[-1].ratio < 2.0


def test_the_run_that_differs_is_reported() -> None:
    recording = flights(2, 0.001)
    run = recording.runs[3]
    run.positions[:, 0, 0] += 0.25 * (run.times - run.times[0]) ** 2
    found = located(recording)
    assert found.factors["run"][0].level == run.name
    assert found.factors["run"][0].share > 0.95
    assert {o.run for o in found.onsets} == {run.name}


@pytest.mark.parametrize("since", [0.4, 0.8, 1.2])
def test_the_onset_of_a_sudden_push_is_found(since: float) -> None:
    """The push is strong: five standard deviations are reached within 0.05 s."""
    found = onsets(examined(no_floor(), flights(3, 0.001, push=(20.0, 0.0, 0.0), since=since)))
    assert len(found) == 4
    for onset in found:
        assert onset.time == pytest.approx(since, abs=0.06)
        assert onset.strength > 5.0


def test_forecast_errors_are_those_of_ordinary_least_squares_on_all_that_came_before() -> None:
    rng = np.random.default_rng(5)
    times = np.linspace(0.0, 1.0, 30)
    slopes = np.stack([np.ones(30), times], axis=1)
    y = slopes @ np.array([1.0, -2.0]) + rng.normal(size=30)
    errors = recursive_residuals(y, slopes, np.arange(30), np.ones(2))
    for k in (10, 20, 29):
        inverse = np.linalg.inv(slopes[:k].T @ slopes[:k])
        forecast = slopes[k] @ inverse @ slopes[:k].T @ y[:k]
        assert errors[k] == pytest.approx((y[k] - forecast) / np.sqrt(1.0 + slopes[k] @ inverse @ slopes[k]), abs=1e-3)


def bounced(seed: int, friction: float) -> Recording:
    def after(speed: float, along: Array) -> tuple[float, Array]:
        return 0.8 * speed, (1.0 - friction) * along

    begins = [Launch(np.array([0.0, 0.0, 1.0]), np.array([2.0 + k, 0.5, 0.0])) for k in range(3)]
    return ball_recording(Bouncing(after=after), begins, np.random.default_rng(seed), 0.001, duration=1.0)


def test_phases_follow_the_bounces() -> None:
    """A ball dropped from 1 m with its centre 0.1 m above the floor at impact hits it after sqrt(1.8 / g)."""
    recording = bounced(6, 0.0)
    motion = motions(examined(ball_world(), recording), 0)["ball"]
    impact, times = np.sqrt(1.8 / G), recording.runs[0].times
    hit = times[motion.phases == "just after a collision"]
    assert hit[0] == pytest.approx(impact, abs=0.02)
    assert np.all(motion.phases[times < impact - 0.02] == "free")


def test_what_bounces_lose_shows_by_axis_and_as_plain_data() -> None:
    found = localise(examined(ball_world(), bounced(7, 0.2)))
    assert found.factors["axis"][0].level == "position x"
    assert found.onsets[0].time == pytest.approx(np.sqrt(1.8 / G), abs=0.06)
    summary = json.loads(json.dumps(found.to_json()))
    assert set(summary["factors"]) == {"run", "object", "time", "phase", "region", "speed", "axis"}
