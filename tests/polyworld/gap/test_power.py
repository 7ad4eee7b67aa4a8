"""Effects that could have been seen, against the closed form for a constant push, and by planting it."""

import json

import numpy as np
import pytest
from scipy import stats

from polyworld.estimation.criteria import extended_bic
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.hypothesis import extended
from polyworld.estimation.score_test import score_test_starts
from polyworld.gap.catalogue import catalogue
from polyworld.gap.examine import fitted_base
from polyworld.gap.power import noncentrality_needed, power_check
from polyworld.gap.settings import PowerSettings
from tests.polyworld.linear_case import Array, flight_design, white

RUNS, COUNT, RATE, SIGMA = 4, 96, 60.0, 0.01


def fitted(seed: int, push: Array | None = None) -> FittedHypothesis:
    plan = flight_design(np.random.default_rng(seed), white, SIGMA, runs=RUNS, count=COUNT, rate=RATE, push=push)
    return fitted_base(plan, (), candidates=30)


def test_least_tilt_is_that_of_the_closed_form() -> None:
    """The push a leaves 0.5 a t^2 less its line: squared length a^2 T^4 n / 720 in each run of n samples in time T."""
    trial = fitted(0)
    rows = [p for p in power_check(trial, [catalogue()["tilt"]]) if p.unknown in ("x", "y")]
    assert len(rows) == 2
    sigma = trial.context.noise.sigma[0][0]
    for row in rows:
        length = COUNT * (COUNT**2 - 1) * (COUNT**2 - 4) / 720.0 / RATE**4 * RUNS  # of even samples, exactly
        assert row.strength == pytest.approx(sigma * np.sqrt(row.needed / length), rel=0.05)
        assert row.seen


def test_noncentrality_needed_gives_the_power_stated() -> None:
    needed = noncentrality_needed(2, 1000.0, 20)
    price = 2.0 * np.log(1000.0) + 2.0 * np.log(20.0) + 10.0
    drawn = stats.ncx2.rvs(2, needed, size=20000, random_state=0)
    assert np.mean(drawn > price) == pytest.approx(PowerSettings().power, abs=0.01)


@pytest.mark.parametrize(("times", "seen"), [(1.3, True), (0.3, False)])
def test_planted_pushes_are_seen_from_the_strength_reported_on(times: float, seen: bool) -> None:
    tilt = catalogue()["tilt"]
    least = min(p.strength for p in power_check(fitted(1), [tilt]))
    alarms = 0
    for seed in range(3):
        trial = fitted(10 + seed, np.array([times * least, 0.0, 0.0]))
        ways = extended(trial.hypothesis, tilt, trial.context.design.recording)
        alarms += any(
            extended_bic(tested.chi2, 2, trial.context.observations, 1, 30) < trial.ebic - PowerSettings().alarm
            for tested in score_test_starts(trial.context, trial, ways, 1)
        )
    assert alarms == (3 if seen else 0)


def test_spin_damping_cannot_be_seen_where_no_rotation_is_measured() -> None:
    rows = power_check(fitted(2), [catalogue()["spin_damping"]])
    assert not any(p.seen for p in rows)
    for p in rows:
        summary = json.loads(json.dumps(p.to_json()))
        assert summary["detectable"] is None
        assert "cannot be seen" in summary["summary"]


def test_rows_come_weakest_first() -> None:
    rows = power_check(fitted(3), [catalogue()[name] for name in ("tilt", "quadratic_drag", "linear_drag")])
    ratios = [p.noncentrality / p.needed for p in rows]
    assert ratios == sorted(ratios)
