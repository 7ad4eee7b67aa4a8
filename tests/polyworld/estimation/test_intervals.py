"""Intervals where chi2 is no parabola: discs that collide, a ball that grips the floor, a double pendulum."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.descent import Estimate, covariances, first_steps, linearised_centrally, standard_steps
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.intervals import LEVEL, intervals95
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.run_segments import in_segments
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue import catalogue
from polyworld.gap.stepping import coarsened
from polyworld.solver.rollout import simulator
from polyworld.world import Effect, Environment, TimeBase, World
from polyworld.world.parameters import with_parameters
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from tests.polyworld.estimation.colliding_discs import recordings, scene, world
from tests.scenes.ball import Ball, Launch, fly


@pytest.fixture(scope="module")
def discs() -> tuple[World, Recording, float]:
    """Four discs whose restitution is not that of the world, in three runs; and the true restitution."""
    discs, starts = scene(4, 6)
    data, _ = recordings(replace(discs, restitution=0.75), [*starts, starts[0]], 6)
    return world(discs, starts[0]), data, 0.75


def test_an_interval_ends_where_the_best_fit_with_that_value_is_worse_by_its_level(
    discs: tuple[World, Recording, float],
) -> None:
    described, data, true = discs
    plan = design(coarsened(described, data), data)
    context = FitContext(plan, measured_noise(plan), 1)
    (hypothesis,) = extended(Hypothesis(plan.world, ()), catalogue()["restitution_error"], data)
    start = np.array([u.start for u in hypothesis.unknowns])
    trial = context.fit(hypothesis, start, profile.start_states(plan), horizons=profile.FINE_HORIZONS)
    trial = context.refit(trial)
    ((low, high),) = intervals95(context, trial)
    assert low < true < high
    for end in (low, high):
        pinned = with_parameters(hypothesis.world, dict.fromkeys(hypothesis.unknowns[0].paths, float(end)))
        fixed = Forward(plan, pinned, ())
        worse = profile.fit(fixed, context.noise, np.zeros(0), trial.fit.states)
        assert worse.chi2 - trial.chi2 == pytest.approx(LEVEL**2, rel=0.15)


@pytest.mark.parametrize("start", [0.0, 0.1])
def test_a_grip_that_was_enough_says_nothing_of_a_greater_one(start: float) -> None:
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
    context = FitContext(plan, measured_noise(plan), 1)
    (hypothesis,) = extended(Hypothesis(plan.world, ()), catalogue()["friction_error"], data)
    trial = context.fit(hypothesis, np.array([start]), profile.start_states(plan))
    ((low, high),) = intervals95(context, context.refit(trial))
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
    context = FitContext(plan, measured_noise(plan), 1)
    choices = extended(Hypothesis(world, ()), catalogue()["joint_damping"], data)
    hypothesis = next(h for h in choices if len(h.unknowns[0].paths) == 2)
    trial = context.fit(hypothesis, np.array([true]), profile.start_states(plan), horizons=profile.FINE_HORIZONS)
    return context.refit(trial)


def test_the_damping_of_a_double_pendulum_has_the_interval_that_fits_at_its_ends_confirm(
    double_pendulum: tuple[World, Recording, float],
) -> None:
    world, data, true = double_pendulum
    cut = in_segments(data, world)
    assert len(cut.runs) > 2  # a whole run is too chaotic
    trial = damped(world, cut, true)
    ((low, high),) = intervals95(trial.context, trial)
    assert low < true < high
    for end in (low, high):
        pinned = with_parameters(world, dict.fromkeys(trial.hypothesis.unknowns[0].paths, float(end)))
        fixed = Forward(trial.context.design, pinned, ())
        worse = profile.fit(fixed, trial.context.noise, np.zeros(0), trial.fit.states, iterations=30)
        assert worse.chi2 - trial.chi2 == pytest.approx(LEVEL**2, rel=0.3)


def test_central_slopes_give_an_error_that_one_sided_ones_miss(
    double_pendulum: tuple[World, Recording, float],
) -> None:
    """2.4 s of chaos, not cut: start and damping act much alike there. The reference has steps a hundredth as long."""
    world, data, true = double_pendulum
    run = data.runs[0]
    trial = damped(world, Recording((run.rows(run.times < 2.4),)), true)
    forward, at = trial.context.forward(trial.hypothesis), Estimate(trial.values, trial.fit.states)
    shared, own = standard_steps(forward, trial.fit.linear)
    small = (0.01 * shared, tuple(0.01 * s for s in own))
    exact = covariances(forward, linearised_centrally(forward, trial.context.noise, at, small))[0][0, 0]
    central = profile.with_central_slopes(forward, trial.context.noise, trial.fit).covariance[0, 0]
    assert np.sqrt(central / exact) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(trial.fit.covariance[0, 0] / exact) < 0.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_slope_of_which_one_side_diverges_is_taken_from_the_other(side: float) -> None:
    """A ball at rest a metre before a place behind which a force grows without bound."""
    times = np.arange(40) / 60.0
    path = np.random.default_rng(0).normal(0.0, 1e-3, (len(times), 1, 3))
    data = Recording((Run("rest", ("ball",), times, path, np.full((len(times), 1, 4), np.nan)),))
    ball = RigidObject(name="ball", shape=Sphere(radius=0.1), mass=0.5, position=(0, 0, 0))
    runaway = Effect(
        name="runaway",
        kind="expression",
        expression="a*exp(20*(s*x.x/1[m] - 1))*ex",
        parameters={"a": side, "s": side},
        parameter_units={"a": "m/s^2"},
    )
    world = World(objects=(ball,), environment=Environment(gravity=(0, 0, 0)), effects=(runaway,))
    plan = design(world, data)
    forward = Forward(plan, world, (Unknown("pull", ("environment.gravity.x",), "m/s^2", 0.0, -20.0, 20.0, 1.0),))
    noise, at = measured_noise(plan), Estimate(np.zeros(1), profile.start_states(plan))
    _, own = first_steps(forward)
    both, one = (linearised_centrally(forward, noise, at, (np.array([step]), own)) for step in (1e-3, 10.0))
    outside = at.values[None] + np.array([[side * 10.0], [-side * 10.0]])
    (residuals,) = forward.residuals([Settings(0, outside, np.repeat(at.states[0][None], 2, axis=0))])
    assert np.isnan(residuals[0]).any()
    assert np.isfinite(residuals[1]).all()
    assert np.linalg.norm(both.a[0]) > 1.0
    assert np.linalg.norm(one.a[0] - both.a[0]) < 0.02 * np.linalg.norm(both.a[0])
    np.testing.assert_array_equal(one.b[0], both.b[0])
