"""The verdict on a fit: good where the error is noise, failed where a body is off by more than contacts bear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from atw_mcp.fitting.verdict import SETTINGS, BodyFit, FitVerdict, chance_of_wrong, is_far_off, judge
from atw_mcp.probing.ensemble_answers import chance_of
from atw_mcp.probing.ensembles import Ensemble
from polyworld.estimation.accuracy import errors
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fitted import FittedRun
from polyworld.estimation.readout import tracks_readout
from polyworld.estimation.unknown import Unknown
from polyworld.probing.predicates import Collides
from polyworld.probing.query import QueryResult
from tests.polyworld.estimation.closed_form import ClosedForm, observe, thrown_ball
from tests.polyworld.synthetic import of_one

RADIUS, SIGMA = 0.1, 0.01  # [m]


def fitted(*, held: float | None = None) -> tuple[FittedRun, FitVerdict]:
    """A thrown ball fitted to its noisy track, all it may vary, or nothing but damping and a speed `held` too low."""
    world, tracks = thrown_ball(), observe(thrown_ball(), sigma=SIGMA)
    if held is not None:
        ball = world.objects[0].model_copy(update={"velocity": (2.0 - held, 1.0, 3.0), "linear_damping": 0.5})
        world = world.model_copy(update={"objects": (ball,)})
    known = FitOptions(states=False, edit=lambda _: [SPIN], share=0.0)
    (run,) = fit(of_one(world, tracks), FitOptions() if held is None else known).runs
    return run, judge(run, tracks)


SPIN = Unknown("spin", ("objects.ball.angular_velocity.z",), "rad/s", 2.0, -5.0, 5.0, 1.0)


def test_an_error_of_the_size_of_the_noise_is_good() -> None:
    _, verdict = fitted()
    (body,) = verdict.bodies
    assert verdict.verdict == "good"
    assert body.noise == pytest.approx(np.sqrt(3.0) * SIGMA)
    assert body.error == pytest.approx(body.noise, rel=0.2)
    assert body.radius == pytest.approx(RADIUS, rel=1e-3)
    assert verdict.to_dict()["why"] == ""


@pytest.mark.parametrize(("held", "expected"), [(0.08, "doubtful"), (0.4, "doubtful"), (3.0, "poor")])
def test_a_speed_that_is_off_is_doubtful_or_poor_by_the_way_it_makes(held: float, expected: str) -> None:
    """Over 0.96 s with damping 0.5 1/s the rms of the distance is about 0.46 s times the error of speed."""
    _, verdict = fitted(held=held)
    (body,) = verdict.bodies
    assert body.error == pytest.approx(np.hypot(0.46 * held, body.noise), rel=0.15)
    assert verdict.verdict == expected
    assert "ball" in str(verdict.to_dict()["why"])


def test_a_world_that_diverges_is_poor() -> None:
    result, _ = fitted()
    verdict = judge(replace(result, accuracy=None), observe(thrown_ball()))
    assert (verdict.verdict, verdict.diverged) == ("poor", True)
    assert "diverges" in str(verdict.to_dict()["why"])


def off(by: float, name: str = "a") -> BodyFit:
    return BodyFit(name, by, SIGMA, RADIUS, motion=0.05, far_off=is_far_off(by, SIGMA, RADIUS))


def test_a_whole_is_poor_with_half_of_its_bodies_and_doubtful_with_one() -> None:
    assert FitVerdict((off(0.005),) * 4).verdict == "good"
    assert FitVerdict((off(0.03), *[off(0.005)] * 3)).verdict == "doubtful"
    assert FitVerdict((off(0.09), *[off(0.005)] * 3)).verdict == "doubtful"
    assert FitVerdict((off(0.09), off(0.09), *[off(0.005)] * 2)).verdict == "poor"
    assert FitVerdict(()).verdict == "good"


def test_a_body_that_moves_far_is_poor_only_where_its_motion_is_not_explained() -> None:
    assert BodyFit("a", 0.09, SIGMA, RADIUS, motion=1.0).verdict == "doubtful"  # as where one force is missing
    assert BodyFit("a", 1.1, SIGMA, RADIUS, motion=1.0).verdict == "poor"


def test_a_fit_is_good_by_what_it_predicts_alone() -> None:
    followed = BodyFit("a", 0.004, SIGMA, RADIUS, motion=1.0, ahead=0.004)
    assert followed.verdict == "good"
    assert replace(followed, ahead=0.05).verdict == "doubtful"
    assert "0.05 m where it was predicted" in replace(followed, ahead=0.05).in_words()


def test_a_noisy_track_is_no_fault_of_the_fit_and_a_small_error_none_of_an_exact_one() -> None:
    assert BodyFit("a", 0.03, 0.02, RADIUS, 0.1).verdict == "good"
    assert BodyFit("a", 0.004, 1e-5, RADIUS, 0.1).verdict == "good"
    assert BodyFit("a", 0.006, 1e-5, RADIUS, 0.1).verdict == "doubtful"


def test_a_body_off_by_more_than_contacts_bear_makes_answers_less_sure() -> None:
    """All forty members agree: of a world that follows its data that is certain, of one that does not it is not."""
    assert chance_of_wrong(None) == (0.0, "")
    assert chance_of_wrong(FitVerdict((off(0.03), off(0.005))).to_dict()) == (0.0, "")
    wrong, why = chance_of_wrong(FitVerdict((off(0.09, "cube"), off(0.005))).to_dict())
    assert (wrong, "cube" in why) == (SETTINGS.wrong, True)
    true = QueryResult(value=True, decided=True, reason=None, intervals=(), covered=None, evidence={})
    none: tuple[()] = ()
    for chance, expected in ((0.0, 1.0), (0.35, 0.825)):
        members = Ensemble(worlds=none, rollouts=none, parameters={}, units={}, wrong=chance, why=why)
        members = replace(members, worlds=(thrown_ball(),) * 40)
        about = chance_of(members, range(40), [true] * 40, Collides(a="ball"))
        assert about["probability"] == pytest.approx(expected)
        assert (about["less_sure_because"] is not None) == (chance > 0.0)


def test_errors_along_the_line_of_sight_count_by_what_is_known_there() -> None:
    """The misfit of a place is r' C^-1 r with the covariance C = sigma^2 I + s s'."""
    rng = np.random.default_rng(3)
    world = thrown_ball()
    tracks = observe(world, sigma=SIGMA)
    spread = rng.normal(0.0, 0.05, tracks.positions.shape)
    spread[::3] = 0.0
    uneven = replace(tracks, position_spread=spread)
    batch = ClosedForm(world, uneven.times, n_worlds=1).run()
    readout = tracks_readout(world, uneven)
    found = (readout.standardised(batch, len(uneven.times))[0, :, :3] ** 2).sum(axis=1)
    apart = batch.positions[0, :, 0] - tracks.positions[:, 0]
    covariance = SIGMA**2 * np.eye(3) + spread[:, 0, :, None] * spread[:, 0, None, :]
    np.testing.assert_allclose(found, np.einsum("ti,tij,tj->t", apart, np.linalg.inv(covariance), apart), rtol=1e-9)
    np.testing.assert_allclose(readout.differences(batch, len(uneven.times))[0, :, 0, :3], apart, atol=1e-12)
    again = type(uneven).from_dict(uneven.to_dict()).window(3, 9).select(["ball"])
    assert again.position_spread is not None
    np.testing.assert_array_equal(again.position_spread, spread[3:10])
    np.testing.assert_allclose(again.coordinate_sigma**2, SIGMA**2 + (spread[3:10] ** 2).sum(axis=2) / 3.0)


@pytest.mark.parametrize(("along", "across", "far"), [(0.15, 0.0, False), (0.0, 0.15, True), (0.5, 0.0, True)])
def test_errors_along_the_line_of_sight_are_excused_by_what_is_not_known_there(
    along: float, across: float, far: bool
) -> None:
    """Off by 1.5 radii where depth is known to a radius: along the line of sight that is noise, across it is not."""
    world = thrown_ball()
    tracks = observe(world, sigma=1e-4)
    sight, side = np.array([0.6, 0.8, 0.0]), np.array([0.8, -0.6, 0.0])
    away = replace(
        tracks,
        positions=tracks.positions + along * sight + across * side,
        position_sigma=np.full(tracks.position_sigma.shape, SIGMA),
        position_spread=np.broadcast_to(0.1 * sight, tracks.positions.shape).copy(),
    )
    batch = ClosedForm(world, tracks.times, n_worlds=1).run()
    found = errors(tracks_readout(world, away), batch, 0, len(tracks.times))
    assert found.position_by_object["ball"] == pytest.approx(np.hypot(along, across), rel=1e-2)
    unexplained = found.unexplained_by_object["ball"]
    assert unexplained == pytest.approx(np.hypot(max(along - 0.4, 0.0), across), abs=1e-3)
    assert is_far_off(unexplained, np.sqrt(3.0) * SIGMA, RADIUS) == far
