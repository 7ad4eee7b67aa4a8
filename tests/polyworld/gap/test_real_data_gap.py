"""Effects that measurements of others show, found by name: short versions of `python -m tests.benchmarks.gaps real`."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import ground_of
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.propose import proposals
from polyworld.gap.report import effects_of
from polyworld.world import World
from tests.real_data import ball_drop, clevrer_slides, cube_flight, needs, pendulum_swings


def base(world: World, recording: Recording, unknowns: tuple[Unknown, ...] = ()) -> Fitted:
    ground = ground_of(world, recording, GapSettings())
    return fit(ground, Hypothesis(ground.world, unknowns), growing=True, scale=1.0)


def with_effect(parent: Fitted, name: str, label: str = "") -> Fitted:
    """One more effect fitted on top of a fitted hypothesis."""
    starts = [s for s in proposals(parent, named([name]), 2) if s.hypothesis.parts[-1].variant.label == label]
    fits = [fit(parent.ground, s.hypothesis, s.point, s.growing, scale=parent.scale) for s in starts]
    return min(fits, key=lambda f: f.objective)


def values(report: GapReport) -> dict[str, float]:
    return {u: x["value"] for e in effects_of(report.verdict.best) for u, x in e["unknowns"].items()}


@needs("ball_drop")
def test_dropped_balls_meet_the_air_with_less_drag_the_denser_they_are_for_their_size() -> None:
    world, recording = ball_drop()
    first = recording.select(tuple(r.name for r in recording.runs if r.name.endswith("-1")))
    each = with_effect(base(world, first), "quadratic_drag", "each body by itself")
    coefficients = dict(zip([u.name for u in each.hypothesis.unknowns], each.values, strict=True))
    # As a fit of the same law with SciPy has it: 0.50 of the whiffle ball, 0.2 of the volleyball.
    assert coefficients["drag_coefficient_whiffle_ball_1"] == pytest.approx(0.505, abs=0.02)
    assert coefficients["drag_coefficient_volleyball"] == pytest.approx(0.18, abs=0.03)


@needs("ball_drop")
def test_one_drop_of_one_ball_gets_no_single_name() -> None:
    """Its height alone over time: drag, a tilted camera and a slow force all write that."""
    world, recording = ball_drop(("baseball",))
    report = find_gap(world, recording.select(("baseball-1",)))
    assert report.verdict.kind in ("ambiguous", "unexplained")


@needs("pendulum")
def test_the_swing_is_damped_in_proportion_to_its_rate() -> None:
    world, recording = pendulum_swings((1.0, 10.0, 24.0), 1.2)
    report = find_gap(world, recording, candidates=named(["joint_damping", "joint_friction", "quadratic_drag"]))
    assert "joint_damping" in report.names
    # A fit of the whole swing with SciPy has a rate of 0.055 1/s; the bob is 1 kg.
    (arm,) = (np.linalg.norm(o.position) for o in world.objects)
    assert values(report)["damping"] / arm**2 == pytest.approx(0.055, abs=0.005)


@needs("clevrer")
def test_annotated_objects_slow_down_in_proportion_to_speed_and_to_its_square_beside_friction() -> None:
    world, recording = clevrer_slides(("02000", "03000"))
    names = ("02000_brown_metal_cube_0", "03000_yellow_metal_sphere_15", "03000_green_metal_sphere_52")
    friction = Unknown("friction", ("objects.cube.friction",), "1", 0.03, 0.0, 0.5, 0.01)
    square = with_effect(
        base(world, recording.select(names), (friction,)), "quadratic_drag", "one coefficient for all bodies"
    )
    both = with_effect(square, "linear_drag")
    # Found before by fits of the decelerations themselves.
    assert both.values == pytest.approx([0.0297, 0.040, 0.040], abs=0.004)
    residual = np.concatenate(
        [x.residuals * g.sigma[g.measured] for x, g in zip(both.slopes, both.ground.readouts, strict=True)]
    )
    assert np.sqrt(np.mean(residual**2)) < 1e-4  # the rounding of the annotations


@needs("cube_toss")
def test_flights_of_the_cube_are_short_of_gravity_and_cannot_show_why() -> None:
    world, recording = cube_flight((0, 10, 20, 30))
    null = base(world, recording)
    gravity, scale, clock = (with_effect(null, n) for n in ("gravity_error", "observer_scale", "observer_clock"))
    assert -9.75 < gravity.values[0] < -9.5
    assert scale.cost == pytest.approx(gravity.cost, rel=1e-2)
    assert clock.cost == pytest.approx(gravity.cost, rel=1e-2)
    assert scale.values[0] == pytest.approx(gravity.values[0] / -9.81, rel=1e-3)
    assert clock.values[0] == pytest.approx(np.sqrt(-9.81 / gravity.values[0]), rel=1e-3)
