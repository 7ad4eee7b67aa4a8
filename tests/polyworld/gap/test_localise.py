"""Where the gap is, for gaps put at a known place, time and axis."""

import json

import numpy as np
import pytest

from polyworld.estimation import profile
from polyworld.estimation.design import Design, design
from polyworld.estimation.forward import Forward
from polyworld.estimation.noise import measured_noise
from polyworld.gap.localise import Localisation, localise
from polyworld.gap.onset import onsets, recursive_residuals
from polyworld.gap.phases import motions
from tests.polyworld import gap_scenes as scenes
from tests.polyworld.linear_case import Array, flight_design, flight_fit, white


def located(plan: Design) -> Localisation:
    noise = measured_noise(plan)
    return localise(plan, noise, flight_fit(plan, noise)[0])


def test_noise_alone_is_alike_everywhere() -> None:
    found = located(flight_design(np.random.default_rng(0), white, 0.01))
    assert found.ratio == pytest.approx(1.0, abs=0.3)
    assert "residuals are those of noise" in found.summary()
    assert not found.onsets
    assert all(level.ratio < 1.0 + 4.5 * level.error for levels in found.factors.values() for level in levels)


def test_the_axis_of_a_push_is_reported() -> None:
    found = located(flight_design(np.random.default_rng(1), white, 0.001, push=np.array([0.0, 0.5, 0.0])))
    axis = found.factors["axis"][0]
    assert axis.level == "position y"
    assert axis.share > 0.95
    assert "position y" in found.summary()
    assert found.factors["axis"][-1].ratio < 2.0


def test_the_run_that_differs_is_reported() -> None:
    rng = np.random.default_rng(2)
    plan = flight_design(rng, white, 0.001)
    run = plan.recording.runs[3]
    run.positions[:, 0, 0] += 0.25 * (run.times - run.times[0]) ** 2
    found = located(design(plan.world, plan.recording))
    assert found.factors["run"][0].level == "run3"
    assert found.factors["run"][0].share > 0.95
    assert {o.run for o in found.onsets} == {"run3"}


@pytest.mark.parametrize("since", [0.4, 0.8, 1.2])
def test_the_onset_of_a_sudden_push_is_found(since: float) -> None:
    """The push is strong: five standard deviations are reached within 0.05 s."""
    plan = flight_design(np.random.default_rng(3), white, 0.001, push=np.array([20.0, 0.0, 0.0]), since=since)
    noise = measured_noise(plan)
    fit, _ = flight_fit(plan, noise)
    for r in plan.runs:
        (found,) = onsets(r, fit, noise.kept[r.index])
        assert found.time == pytest.approx(since, abs=0.06)
        assert found.strength > 5.0


def test_forecast_errors_of_noise_are_white_with_unit_variance() -> None:
    plan = flight_design(np.random.default_rng(4), white, 0.01)
    noise = measured_noise(plan)
    fit, _ = flight_fit(plan, noise)
    errors = np.concatenate([recursive_residuals(r, fit.linear.r[r.index], fit.linear.b[r.index]) for r in plan.runs])
    assert errors.std() == pytest.approx(1.0, abs=0.06)
    assert abs(np.mean(errors[1:] * errors[:-1])) < 0.06


def test_forecast_errors_are_those_of_ordinary_least_squares_on_all_that_came_before() -> None:
    plan = flight_design(np.random.default_rng(5), white, 0.01, runs=1, count=30)
    noise = measured_noise(plan)
    fit, _ = flight_fit(plan, noise)
    own = plan.runs[0]
    r, b = fit.linear.r[0], fit.linear.b[0]
    s = own.series[0]
    errors = recursive_residuals(own, r, b)[s.where]
    x = b[s.where][:, [i for i, label in enumerate(own.labels) if label.endswith(".x")]]
    y = r[s.where]
    for k in (10, 20, 29):
        inverse = np.linalg.inv(x[:k].T @ x[:k])
        forecast = x[k] @ inverse @ x[:k].T @ y[:k]
        assert errors[k] == pytest.approx((y[k] - forecast) / np.sqrt(1.0 + x[k] @ inverse @ x[k]), abs=1e-3)


def bounced(rng: np.random.Generator, friction: float) -> Design:
    def after(speed: float, along: Array) -> tuple[float, Array]:
        return 0.8 * speed, (1.0 - friction) * along

    ball = scenes.Bouncing(after=after)
    begins = [scenes.Launch(np.array([0.0, 0.0, 1.0]), np.array([2.0 + k, 0.5, 0.0])) for k in range(3)]
    return design(scenes.ball_world(), scenes.ball_recording(ball, begins, rng, 0.001, duration=1.0))


def test_phases_follow_the_bounces() -> None:
    """A ball dropped from 1 m with its centre 0.1 m above the floor at impact hits it after sqrt(1.8 / g)."""
    plan = bounced(np.random.default_rng(6), 0.0)
    motion = motions(plan, plan.runs[0], np.zeros(0), profile.start_states(plan)[0])["ball"]
    impact = np.sqrt(1.8 / scenes.G)
    times = plan.runs[0].times
    hit = times[motion.phases == "just after a collision"]
    assert hit[0] == pytest.approx(impact, abs=0.02)
    assert np.all(motion.phases[times < impact - 0.02] == "free")


def test_what_bounces_lose_shows_by_axis_and_as_plain_data() -> None:
    plan = bounced(np.random.default_rng(7), 0.2)
    noise = measured_noise(plan)
    fit = profile.fit(
        Forward(plan, plan.world, ()), noise, np.zeros(0), profile.start_states(plan), horizons=profile.HORIZONS
    )
    found = localise(plan, noise, fit)
    assert found.factors["axis"][0].level == "position x"
    impact = np.sqrt(1.8 / scenes.G)
    assert found.onsets[0].time == pytest.approx(impact, abs=0.06)
    summary = json.loads(json.dumps(found.to_json()))
    assert set(summary["factors"]) == {"run", "object", "time", "phase", "region", "speed", "axis"}
