"""Errors of prediction after the last fitted frame, on a ball in even motion: its distances are known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import cauchy

from atw_mcp.calls.intervals import Span
from atw_mcp.probing.ensemble_answers import chance_of, trajectory_answer
from atw_mcp.probing.ensembles import Ensemble
from atw_mcp.probing.prediction_errors import SETTINGS, chances, distance, speeds, travelled_since
from polyworld.estimation.fit_settings import ModelSettings
from polyworld.probing.predicates import AtRest, ComesToRest, InsideRegion, Moving
from polyworld.probing.query import QueryResult, query
from polyworld.solver.rollout import rollout
from polyworld.world import MotionPlane
from tests.verification.planar_scenes import body, disc, top_view

SPEED, UNTIL, END = 1.0, 0.5, 2.0


@pytest.fixture(scope="module")
def members() -> Ensemble:
    """Five balls that move by SPEED along x without resistance; the fit ended at UNTIL."""
    world = top_view(body("ball", disc(), (0.0, 0.0, 0.2), velocity=(SPEED, 0.0, 0.0)), gravity=0.0)
    run = rollout(world, END)
    return Ensemble((world,) * 5, (run,) * 5, {}, {}, fitted_until=UNTIL)


def beyond(x: float) -> InsideRegion:
    return InsideRegion(object="ball", lower=(x, -9.0, -9.0), upper=(9.0, 9.0, 9.0))


def past(members: Ensemble, x: float, time: float) -> QueryResult:
    return query(members.rollouts[0], members.worlds[0], beyond(x), (time, time))


def test_distance_is_that_of_the_path_between_two_times(members: Ensemble) -> None:
    assert distance(members.rollouts[0], ["ball"], UNTIL, END) == pytest.approx(SPEED * (END - UNTIL), rel=1e-6)
    assert distance(members.rollouts[0], ["ball", "ball"], 0.0, 1.0) == pytest.approx(np.sqrt(2.0) * SPEED, rel=1e-6)
    assert distance(members.rollouts[0], ["floor"], 0.0, 1.0) == 0.0


@pytest.mark.parametrize("by", [-0.5, -0.01, 0.02, 0.4])
def test_a_place_is_as_probable_as_its_margin_beside_the_distance_travelled(members: Ensemble, by: float) -> None:
    time = 1.5
    result = past(members, SPEED * time - by, time)
    (found,) = chances(members, [0], [result], beyond(0.0))
    assert found == pytest.approx(cauchy.cdf(by, scale=ModelSettings().path * SPEED * (time - UNTIL)), rel=1e-6)


def test_a_place_is_the_less_sure_the_farther_it_is_from_the_last_fitted_frame(members: Ensemble) -> None:
    about = trajectory_answer(members, "ball", Span(0.0, END, 0.04), ["time", "x", "speed"], [(0.4, 10), (1.5, 38)])
    (_, _, early, _), (_, _, late, speed) = about["rows"]
    half = ModelSettings().path * SPEED * (1.5 - UNTIL)
    assert early[2] - early[1] == pytest.approx(0.0, abs=1e-9)  # all members go alike
    assert late[0] == pytest.approx(1.5 * SPEED, rel=1e-3)
    assert late[2] - late[0] == pytest.approx(cauchy.ppf(0.95, scale=half), rel=0.15)
    assert speed[2] - speed[1] == pytest.approx(0.0, abs=1e-9)


def test_what_is_decided_within_the_fitted_frames_is_as_sure_as_the_members(members: Ensemble) -> None:
    early = past(members, SPEED * 0.4 - 0.001, 0.4)
    assert chances(members, [0], [early], beyond(0.0))[0] == 1.0
    about = chance_of(members, range(5), [early] * 5, beyond(0.0))
    assert about["probability"] == 1.0
    assert about["less_sure_because"] is None


def test_a_narrow_answer_about_what_comes_is_less_sure_and_says_why(members: Ensemble) -> None:
    narrow = past(members, SPEED * 1.5 - 0.01, 1.5)
    about = chance_of(members, range(5), [narrow] * 5, beyond(0.0))
    assert 0.5 < about["probability"] < 0.7
    assert "after the last fitted frame" in about["less_sure_because"]


@pytest.mark.parametrize("by", [0.02, 0.5])
def test_a_speed_is_as_probable_as_its_margin_beside_the_mean_speed(members: Ensemble, by: float) -> None:
    """Pace and path are off by the same factor, whose logarithm is Cauchy; nineteen of its quantiles are tried."""
    slower = AtRest(object="ball", speed=SPEED - by)
    result = query(members.rollouts[0], members.worlds[0], slower, (1.0, 1.0))
    assert result.value is False
    (found,) = chances(members, [0], [result], slower)
    assert found == pytest.approx(cauchy.cdf(np.log(1.0 - by / SPEED), scale=ModelSettings().path), abs=1.0 / 19)
    assert np.median(speeds(members, 0, "ball", 1.5)) == pytest.approx(SPEED, rel=1e-6)
    low, high = np.percentile(speeds(members, 0, "ball", 1.5), (25, 75))
    assert np.log([low, high]) == pytest.approx([-ModelSettings().path, ModelSettings().path], rel=0.15)


def test_what_stopped_long_ago_is_at_rest_and_what_just_stops_may_not_be() -> None:
    """A block with friction mu stops after v / (mu g), 0.51 s: at 1.5 s for sure, at 0.52 s perhaps."""
    world = top_view(
        body("ball", disc(), (0.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0), friction=0.2),
        motion_plane=MotionPlane(friction=0.2),
    )
    run = rollout(world, 2.0)
    stopping = Ensemble((world,) * 5, (run,) * 5, {}, {}, fitted_until=0.2)
    for time, low, high in ((0.45, 0.0, 0.3), (0.53, 0.5, 0.8), (1.5, 0.95, 1.0)):
        for statement, likely in ((AtRest(object="ball"), True), (Moving(object="ball"), False)):
            result = query(run, world, statement, (time, time))
            (found,) = chances(stopping, [0], [result], statement)
            assert low <= (found if likely else 1.0 - found) <= high, (time, statement)
    since = query(run, world, AtRest(object="ball"), (0.0, 2.0))
    assert chances(stopping, [0], [since], AtRest(object="ball"))[0] == 1.0
    stops = query(run, world, ComesToRest(object="ball"), (0.0, 0.6))
    assert 0.6 < chances(stopping, [0], [stops], ComesToRest(object="ball"))[0] < 1.0
    assert speeds(stopping, 0, "ball", 1.5).max() == pytest.approx(0.0, abs=1e-9)


def test_what_has_no_margin_is_less_sure_by_a_share(members: Ensemble) -> None:
    result = replace(past(members, SPEED * 1.5 - 0.4, 1.5), margin=None)
    assert chances(members, [0], [result], beyond(0.0))[0] == pytest.approx(1.0 - 0.5 * SETTINGS.other)


def test_a_ball_on_a_plane_errs_along_it_alone(members: Ensemble) -> None:
    assert travelled_since(members, 0, "ball", np.array([0.2, 1.5])) == pytest.approx(
        np.array([[0.0, 0.0, 0.0], [SPEED, SPEED, 0.0]]), rel=1e-6
    )
