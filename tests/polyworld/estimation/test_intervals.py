"""Intervals where chi2 is no parabola: discs that collide, a ball that grips the floor, a double pendulum."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.descent import Point, covariances, first_steps, linearised_centrally, standard_steps
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.intervals import LEVEL, intervals95
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.run_parts import in_parts
from polyworld.estimation.trial import FitContext, FittedHypothesis
from polyworld.gap.catalogue import catalogue
from polyworld.gap.stepping import coarsened
from polyworld.parameters import with_parameters
from polyworld.recording import Recording, Run
from polyworld.representations.joint import Hinge
from polyworld.representations.rigid import RigidObject
from polyworld.rollout import simulator
from polyworld.shapes import Sphere
from polyworld.world import Environment, TimeBase, World
from tests.benchmarks.hidden_ball import Ball, Launch, fly
from tests.benchmarks.hidden_cases import Case
from tests.benchmarks.hidden_disc_cases import draw_discs


@pytest.fixture(scope="module")
def discs() -> tuple[World, Recording, float]:
    """Four discs whose restitution is not as told, seen with small noise; and the true restitution."""
    case = Case("bodies", 0, 0, ("restitution_error",), 0.001, design="discs", runs=3, rate=60.0, bodies=4)
    drawn = draw_discs(case, 7)
    rows = drawn.runs(np.random.default_rng(1), range(case.runs))
    data = Recording(tuple(Run(n, tuple(drawn.names), t, x, q) for n, t, x, q in rows))
    assert drawn.effect is not None
    return World.model_validate(drawn.world_json()), data, drawn.effect.told(drawn.strength)["restitution"]


def test_an_interval_ends_where_the_best_fit_with_that_value_is_worse_by_its_level(
    discs: tuple[World, Recording, float],
) -> None:
    world, data, true = discs
    plan = design(coarsened(world, data), data)
    bench = FitContext(plan, measured_noise(plan), 1)
    (hypothesis,) = extended(Hypothesis(plan.world, ()), catalogue()["restitution_error"], data)
    start = np.array([u.start for u in hypothesis.unknowns])
    trial = bench.fit(hypothesis, start, profile.start_states(plan), horizons=profile.FINE_HORIZONS)
    trial = bench.refit(trial)
    ((low, high),) = intervals95(bench, trial)
    assert low < true < high
    for end in (low, high):
        told = with_parameters(hypothesis.world, dict.fromkeys(hypothesis.unknowns[0].paths, float(end)))
        fixed = Forward(plan, told, ())
        worse = profile.fit(fixed, bench.noise, np.zeros(0), trial.fit.states)
        assert worse.chi2 - trial.chi2 == pytest.approx(LEVEL**2, rel=0.15)


@pytest.mark.parametrize("start", [0.0, 0.1])
def test_a_grip_that_was_enough_tells_of_no_greater_one(start: float) -> None:
    """A ball that bounces at 1 m/s sideways leaves the floor rolling if mu > 2 v / (7 (1 + e) u), here 0.04.

    The data hold no upper bound: chi2 is steep below 0.04 and level above.
    """
    restitution, drop, sideways, true = 0.8, 0.5, 1.0, 0.5
    enough = 2.0 * sideways / (7.0 * (1.0 + restitution) * np.sqrt(2.0 * 9.81 * drop))
    times = np.arange(90) / 120.0
    rng = np.random.default_rng(2)
    runs = []
    for k in range(3):
        launch = Launch((0.0, 0.0, 0.1 + drop), (sideways * np.cos(k), sideways * np.sin(k), 0.0))
        path = fly(Ball(friction=true, restitution=lambda _: restitution), launch, times)
        places = path.positions + rng.normal(0.0, 0.001, path.positions.shape)
        runs.append(Run(f"run {k}", ("ball",), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "mass": 0.5, "position": [0, 0, 0.6]}
    world = World.model_validate(
        {
            "objects": [ball | {"friction": 0.02, "restitution": restitution}],
            "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
        }
    )
    data = Recording(tuple(runs))
    plan = design(coarsened(world, data), data)
    bench = FitContext(plan, measured_noise(plan), 1)
    (hypothesis,) = extended(Hypothesis(plan.world, ()), catalogue()["friction_error"], data)
    trial = bench.fit(hypothesis, np.array([start]), profile.start_states(plan))
    ((low, high),) = intervals95(bench, bench.refit(trial))
    assert high == hypothesis.unknowns[0].upper
    assert 0.25 * enough < low < enough * 1.02


def swings(world: World, noise: float) -> Recording:
    """A double pendulum let go from two poses, 3 s at 50 Hz."""
    rng = np.random.default_rng(5)
    times = np.arange(150) * 0.02
    runs = []
    for number, (first, second) in enumerate([(1.5, 0.3), (0.8, 1.2)]):
        elbow = 0.2 * np.array([np.sin(first), 0.0, -np.cos(first)])
        tip = elbow + 0.15 * np.array([np.sin(second), 0.0, -np.cos(second)])
        posed = with_parameters(
            world,
            {
                f"objects.{n}.position.{c}": float(x)
                for n, p in (("a", elbow), ("b", tip))
                for c, x in zip("xyz", p, strict=True)
            }
            | {f"joints.elbow.anchor.{c}": float(x) for c, x in zip("xyz", elbow, strict=True)},
        )
        moved = simulator(posed, times).run().positions[0]
        seen = moved + rng.normal(0.0, noise, moved.shape)
        runs.append(Run(f"r{number}", ("a", "b"), times, seen, np.full((len(times), 2, 4), np.nan)))
    return Recording(tuple(runs))


@pytest.fixture(scope="module")
def double_pendulum() -> tuple[World, Recording, float]:
    """A double pendulum without resistance, two runs of one whose hinges are damped, and their damping."""
    true = 2e-4
    hinges = [
        Hinge(name="top", object="a", anchor=(0, 0, 0), axis=(0, 1, 0), damping=true),
        Hinge(name="elbow", object="b", other="a", anchor=(0, 0, -0.2), axis=(0, 1, 0), damping=true),
    ]
    bobs = [
        RigidObject(name=name, shape=Sphere(radius=0.01), mass=mass, position=(0, 0, z))
        for name, mass, z in (("a", 0.3, -0.2), ("b", 0.2, -0.35))
    ]
    world = World(
        objects=tuple(bobs),
        joints=tuple(hinges),
        environment=Environment(gravity=(0, 0, -9.81)),
        time=TimeBase(substep=0.005),
    )
    free = with_parameters(world, {f"joints.{j.name}.damping": 0.0 for j in hinges})
    return free, swings(world, 5e-4), true


def damped(world: World, data: Recording, true: float) -> FittedHypothesis:
    """All hinges' damping fitted, from its true value on."""
    plan = design(world, data)
    bench = FitContext(plan, measured_noise(plan), 1)
    choices = extended(Hypothesis(world, ()), catalogue()["joint_damping"], data)
    hypothesis = next(h for h in choices if len(h.unknowns[0].paths) == 2)
    trial = bench.fit(hypothesis, np.array([true]), profile.start_states(plan), horizons=profile.FINE_HORIZONS)
    return bench.refit(trial)


def test_the_damping_of_a_double_pendulum_has_the_interval_that_fits_at_its_ends_bear_out(
    double_pendulum: tuple[World, Recording, float],
) -> None:
    world, data, true = double_pendulum
    cut = in_parts(data, world)
    assert len(cut.runs) > 2  # a whole run is too chaotic
    trial = damped(world, cut, true)
    ((low, high),) = intervals95(trial.bench, trial)
    assert low < true < high
    for end in (low, high):
        told = with_parameters(world, dict.fromkeys(trial.hypothesis.unknowns[0].paths, float(end)))
        fixed = Forward(trial.bench.design, told, ())
        worse = profile.fit(fixed, trial.bench.noise, np.zeros(0), trial.fit.states, iterations=30)
        assert worse.chi2 - trial.chi2 == pytest.approx(LEVEL**2, rel=0.3)


def test_central_slopes_tell_an_error_that_one_sided_ones_do_not(
    double_pendulum: tuple[World, Recording, float],
) -> None:
    """2.4 s of chaos, not cut: start and damping act much alike there. The reference has steps a hundredth as long."""
    world, data, true = double_pendulum
    run = data.runs[0]
    trial = damped(world, Recording((run.rows(run.times < 2.4),)), true)
    forward, at = trial.bench.forward(trial.hypothesis), Point(trial.values, trial.fit.states)
    shared, own = standard_steps(forward, trial.fit.linear)
    small = (0.01 * shared, tuple(0.01 * s for s in own))
    exact = covariances(forward, linearised_centrally(forward, trial.bench.noise, at, small))[0][0, 0]
    told = profile.with_central_slopes(forward, trial.bench.noise, trial.fit).covariance[0, 0]
    assert np.sqrt(told / exact) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(trial.fit.covariance[0, 0] / exact) < 0.5


@pytest.mark.parametrize("side", [1, 2])
def test_a_slope_of_which_one_side_diverges_is_told_by_the_other(side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    times = np.arange(40) / 60.0
    path = np.stack([2.0 * times, 0.0 * times, 5.0 - 4.905 * times**2], axis=-1)[:, None]
    data = Recording((Run("fall", ("ball",), times, path, np.full((len(times), 1, 4), np.nan)),))
    world = World(objects=(RigidObject(name="ball", shape=Sphere(radius=0.1), mass=0.5, position=(0, 0, 5)),))
    plan = design(world, data)
    hypothesis = extended(Hypothesis(world, ()), catalogue()["quadratic_drag"], data)[0]
    forward = Forward(plan, hypothesis.world, hypothesis.unknowns)
    at = Point(np.array([0.01]), profile.start_states(plan))
    noise, steps = measured_noise(plan), first_steps(forward)
    both = linearised_centrally(forward, noise, at, steps)
    given = Forward.residuals
    row = side if side == 1 else 1 + 1 + plan.runs[0].count  # ahead, and back, by the drag

    def diverging(self: Forward, settings: Sequence[Settings], horizon: float = 1.0) -> list[NDArray[np.float64]]:
        (raw,) = given(self, settings, horizon)
        return [np.where(np.arange(len(raw))[:, None] == row, np.nan, raw)]

    monkeypatch.setattr(Forward, "residuals", diverging)
    one = linearised_centrally(forward, noise, at, steps)
    assert np.linalg.norm(both.a[0]) > 1.0
    assert np.linalg.norm(one.a[0] - both.a[0]) < 0.02 * np.linalg.norm(both.a[0])
    np.testing.assert_array_equal(one.b[0], both.b[0])
