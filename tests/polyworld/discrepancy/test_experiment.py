"""The proposed experiment: where two laws differ by theory, the proposal goes there."""

import numpy as np
import pytest

from polyworld.discrepancy import profile
from polyworld.discrepancy.candidate import Unknown
from polyworld.discrepancy.design import design
from polyworld.discrepancy.experiment import ENOUGH, Contender, propose_experiment
from polyworld.discrepancy.forward import Forward
from polyworld.discrepancy.noise import measured_noise
from polyworld.recording import Recording, Run
from tests.polyworld.discrepancy.test_profile import ball_world, thrown

SIGMA = 0.01


def one_launch(seed):
    times, places = thrown(np.random.default_rng(seed), 0.03, SIGMA)
    return Recording((Run("r", ("ball",), times, places[:, None], np.full((len(times), 1, 4), np.nan)),))


def contender(plan, noise, kind, coefficient):
    world = ball_world(effects=[{"name": "drag", "kind": kind}])
    unknown = Unknown("drag", ("effects.drag.coefficient",), "kg/m", 0.0, 0.0, 1.0, 0.05)
    found = profile.fit(
        Forward(plan, world, (unknown,)),
        noise,
        np.array([coefficient]),
        profile.start_states(plan),
        horizons=profile.HORIZONS,
    )
    return Contender((f"{kind}",), world, (unknown,), found.values, found.covariance), found


def test_linear_and_quadratic_drag_are_told_apart_by_a_faster_launch():
    plan = design(ball_world(), one_launch(0))
    noise = measured_noise(plan)
    quadratic, one = contender(plan, noise, "quadratic_drag", 0.03)
    linear, other = contender(plan, noise, "linear_drag", 0.1)
    assert abs(one.chi2 - other.chi2) < 60  # this design tells them apart poorly
    proposed = propose_experiment(plan, noise, (quadratic, linear))
    assert proposed is not None
    measured = np.linalg.norm(plan.runs[0].start[[1, 3, 5]])
    assert np.linalg.norm(proposed.velocity) > 2.0 * measured
    assert proposed.decides
    assert proposed.separations[0].sigmas > ENOUGH
    assert set(proposed.forecasts) == {"quadratic_drag", "linear_drag"}


def test_two_names_for_the_same_motion_are_not_claimed_to_be_separable():
    plan = design(ball_world(), one_launch(1))
    noise = measured_noise(plan)
    first, _ = contender(plan, noise, "quadratic_drag", 0.03)
    second = Contender(("twin",), first.world, first.unknowns, first.values, first.covariance)
    proposed = propose_experiment(plan, noise, (first, second))
    assert proposed is not None
    assert not proposed.decides
    assert proposed.separations[0].sigmas == pytest.approx(0.0, abs=1e-6)


def test_one_contender_needs_no_experiment():
    plan = design(ball_world(), one_launch(2))
    noise = measured_noise(plan)
    first, _ = contender(plan, noise, "quadratic_drag", 0.03)
    assert propose_experiment(plan, noise, (first,)) is None
