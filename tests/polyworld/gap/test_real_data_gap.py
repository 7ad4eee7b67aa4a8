"""Effects that measurements of others show, each fitted by its name: short versions of the benchmark `real_gap`."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import catalogue
from polyworld.gap.examine import fitted_base
from polyworld.gap.stepping import coarsened
from polyworld.world import World
from tests.real_data import ball_drop, clevrer_slides, cube_flight, needs, pendulum_swings


def ground(world: World, recording: Recording, base: tuple[Unknown, ...] = ()) -> FittedHypothesis:
    """The base world fitted."""
    return fitted_base(design(coarsened(world, recording), recording), base)


def with_effect(trial: FittedHypothesis, name: str, label: str = "") -> FittedHypothesis:
    """One more effect fitted on top of a fitted hypothesis, from the data's own states."""
    plan = trial.context.design
    ways = extended(trial.hypothesis, catalogue()[name], plan.recording)
    way: Hypothesis = next(h for h in ways if h.parts[-1].variant.label == label)
    states = profile.start_states(plan)
    return trial.context.fit(way, way.starts(trial.values)[0], states, horizons=profile.HORIZONS, iterations=20)


@needs("ball_drop")
def test_dropped_balls_meet_the_air_with_less_drag_the_denser_they_are_for_their_size() -> None:
    world, recording = ball_drop()
    base = ground(world, recording.select(tuple(r.name for r in recording.runs if r.name.endswith("-1"))))
    assert not base.passes
    one = with_effect(base, "quadratic_drag", "one drag coefficient, by area")
    assert one.chi2 < 0.25 * base.chi2
    assert 0.3 < one.values[0] < 0.7
    each = with_effect(base, "quadratic_drag", "each body by itself")
    assert each.chi2 < 0.25 * one.chi2
    coefficients = each.hypothesis.of_part(0, each.values)
    # As a fit of the same law with SciPy has it: 0.50 of the whiffle ball, 0.2 of the volleyball.
    assert coefficients["drag_coefficient_whiffle_ball_1"] == pytest.approx(0.505, abs=0.02)
    assert coefficients["drag_coefficient_volleyball"] == pytest.approx(0.18, abs=0.03)


@needs("ball_drop")
def test_one_drop_of_one_ball_gets_no_single_name() -> None:
    """Its height alone over time: drag, a tilted camera and a slow force all write that."""
    world, recording = ball_drop(("baseball",))
    settings = GapSettings(null_control=False, experiment=False, residual_force=False)
    report = find_gap(world, recording.select(("baseball-1",)), settings=settings)
    assert report.verdict.kind == "ambiguous"
    named = {name for trial in report.verdict.credible for name in trial.hypothesis.names}
    assert len(named) > 3


@needs("ball_drop")
def test_a_camera_that_looks_askew_at_all_drops_leaves_every_ball_a_drag_as_of_spheres() -> None:
    world, recording = ball_drop()
    base = ground(world, recording.select(tuple(r.name for r in recording.runs if r.name.endswith("-1"))))
    each = with_effect(base, "quadratic_drag", "each body by itself")
    askew = with_effect(each, "observer_keystone")
    assert askew.chi2 < 0.25 * each.chi2
    for other in ("observer_scale", "observer_distortion"):
        label = "about the origin" if other == "observer_distortion" else ""
        assert askew.chi2 < with_effect(each, other, label).chi2
    coefficients = askew.hypothesis.of_part(0, askew.values)
    assert all(0.25 < coefficient < 0.7 for coefficient in coefficients.values())  # about 0.5: Achenbach 1972


@needs("pendulum")
def test_the_swing_is_damped_in_proportion_to_its_rate() -> None:
    world, recording = pendulum_swings((1.0, 10.0, 24.0), 1.2)
    base = ground(world, recording)
    assert not base.passes
    damped = with_effect(base, "joint_damping")
    for other in ("joint_friction", "quadratic_drag"):
        assert damped.chi2 < 0.5 * with_effect(base, other).chi2 < 0.2 * base.chi2
    # A fit of the whole swing with SciPy has a rate of 0.055 1/s; the bob is 1 kg.
    (arm,) = (np.linalg.norm(o.position) for o in world.objects)
    assert damped.values[0] / arm**2 == pytest.approx(0.055, abs=0.005)


@needs("clevrer")
def test_annotated_objects_slow_down_in_proportion_to_speed_and_to_its_square_beside_friction() -> None:
    world, recording = clevrer_slides(("02000", "03000"))
    names = ("02000_brown_metal_cube_0", "03000_yellow_metal_sphere_15", "03000_green_metal_sphere_52")
    friction = Unknown("friction", ("objects.cube.friction",), "1", 0.03, 0.0, 0.5, 0.01)
    base = ground(world, recording.select(names), (friction,))
    assert not base.passes
    square = with_effect(base, "quadratic_drag", "one coefficient for all bodies")
    both = with_effect(square, "linear_drag")
    # Found before by fits of the decelerations themselves.
    assert both.values[0] == pytest.approx(0.0297, abs=0.0005)
    assert both.values[1] == pytest.approx(0.040, abs=0.002)
    assert both.values[2] == pytest.approx(0.040, abs=0.004)
    residuals = np.concatenate(both.context.raw_residuals(both))
    assert np.sqrt(np.mean(residuals**2)) < 1e-4  # the rounding of the annotations


@needs("cube_toss")
def test_flights_of_the_cube_are_short_of_gravity_and_cannot_show_why() -> None:
    world, recording = cube_flight((0, 10, 20, 30))
    base = ground(world, recording)
    gravity = with_effect(base, "gravity_error")
    assert -9.75 < gravity.values[0] < -9.5
    scale = with_effect(base, "observer_scale")
    clock = with_effect(base, "observer_clock")
    assert scale.chi2 == pytest.approx(gravity.chi2, rel=1e-3)
    assert clock.chi2 == pytest.approx(gravity.chi2, rel=1e-3)
    assert scale.values[0] == pytest.approx(gravity.values[0] / -9.81, rel=1e-3)
    assert clock.values[0] == pytest.approx(np.sqrt(-9.81 / gravity.values[0]), rel=1e-3)
