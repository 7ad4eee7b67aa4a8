"""Names found for what balls hide that SciPy moved: one effect, two, none, one not on offer; and how a search ends."""

import json
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.catalogue import named
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

FEW = ("gravity_error", "restitution_error", "tilt", "linear_drag", "quadratic_drag")


def hidden(ball: Bouncing, *, sigma: float = 0.003, seed: int = 0, runs: int = 4) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, runs), rng, sigma, duration=1.0, rate=60.0)


def found(recording: Recording, names: Sequence[str] = FEW) -> GapReport:
    return find_gap(ball_world(), recording, candidates=named(names))


def power(k: float, exponent: float = 2.0) -> Callable[..., np.ndarray]:
    return lambda _t, _x, v, _w: -k / MASS * np.linalg.norm(v) ** (exponent - 1.0) * v


def lossy(speed: float, along: np.ndarray) -> tuple[float, np.ndarray]:
    return 0.7 * speed, along


def test_a_wrong_restitution_is_distinguished_from_drag() -> None:
    report = found(hidden(Bouncing(after=lossy)))
    assert (report.verdict.kind, report.names) == ("identified", ("restitution_error",))
    assert report.world.objects[0].restitution == pytest.approx(0.7, abs=0.01)


def test_two_effects_are_found_together() -> None:
    push = np.array([0.6, -0.4, 0.0])
    ball = Bouncing(acceleration=lambda _t, _x, _v, _w: push, after=lossy)
    report = found(hidden(ball), ("restitution_error", "tilt", "quadratic_drag"))
    assert report.verdict.kind == "identified"
    assert set(report.names) == {"restitution_error", "tilt"}


def test_nothing_is_named_where_nothing_is_missing() -> None:
    report = found(hidden(Bouncing()))
    assert (report.verdict.kind, report.names) == ("nothing_missing", ())


def test_an_effect_that_is_not_on_offer_stays_unexplained() -> None:
    centre = np.array([0.0, 0.0, 1.0])
    ball = Bouncing(acceleration=lambda _t, x, _v, _w: -4.0 * (x - centre))
    report = found(hidden(ball, sigma=0.001), ("linear_drag", "restitution_error"))
    assert report.verdict.kind == "unexplained"


def test_drag_of_an_exponent_between_those_of_the_catalogue_is_no_quadratic_drag() -> None:
    """The nearest law takes most of the effect; an expression with the true exponent predicts better."""
    report = found(hidden(Bouncing(acceleration=power(0.06, 1.75)), sigma=0.0005), ("quadratic_drag", "tilt"))
    assert (report.verdict.kind, report.names) == ("unexplained", ("quadratic_drag",))
    assert 1.5 < report.verdict.after < 0.5 * report.verdict.before
    assert report.force is not None
    assert report.force.to_dict()["speed_exponent"][0]["value"] == pytest.approx(1.75, abs=0.05)


def test_drag_of_the_catalogue_is_named_although_an_expression_can_have_any_exponent() -> None:
    report = found(hidden(Bouncing(acceleration=power(0.06)), sigma=0.0005), ("quadratic_drag", "tilt"))
    assert (report.verdict.kind, report.names) == ("identified", ("quadratic_drag",))


def test_a_push_that_decays_is_no_tilt() -> None:
    """Of half a second, so weak that tilt reaches the noise by ordinary measures."""
    push = np.array([0.0, 0.6, 0.0])
    ball = Bouncing(acceleration=lambda t, _x, _v, _w: push * np.exp(-t / 0.3))
    report = found(hidden(ball, runs=6), ("tilt", "linear_drag"))
    assert report.verdict.after < 1.5
    assert report.verdict.kind == "unexplained"


def test_a_base_unknown_is_fitted_and_not_offered_as_an_effect() -> None:
    free = Unknown("restitution", ("objects.ball.restitution",), "1", 0.8, 0.0, 1.0, 0.1)
    recording = hidden(Bouncing(after=lossy))
    report = find_gap(ball_world(), recording, base=(free,), candidates=named(["restitution_error", "linear_drag"]))
    assert report.verdict.kind == "nothing_missing"
    assert report.to_dict()["base"]["restitution"] == pytest.approx(0.7, abs=0.01)


def test_equal_questions_give_equal_reports_and_steps_are_reported() -> None:
    recording = hidden(Bouncing(acceleration=power(0.02)))
    steps: list[tuple[float, str]] = []
    offered = named(["linear_drag", "quadratic_drag"])
    reports = []
    for _ in range(2):
        report = find_gap(ball_world(), recording, candidates=offered, progress=lambda s, w: steps.append((s, w)))
        payload = report.to_dict()
        for step in payload["history"]:
            del step["seconds"]
        reports.append(json.dumps(payload))
    assert reports[0] == reports[1]
    assert steps[-1] == (1.0, "done")
    assert all(0.0 < share <= 1.0 for share, _ in steps)


def test_a_cancelled_search_stops() -> None:
    recording = hidden(Bouncing(acceleration=power(0.02)))
    fits: list[object] = []
    with pytest.raises(InterruptedError):
        find_gap(ball_world(), recording, fitted=fits.append, cancelled=lambda: len(fits) > 0)
    assert len(fits) == 1


def test_a_search_ends_at_its_time_limit_with_a_verdict() -> None:
    recording = hidden(Bouncing(acceleration=power(0.06, 1.75)))
    report = find_gap(ball_world(), recording, settings=GapSettings(time_limit=0.5))
    steps = [step["step"] for step in report.history]
    assert "plain laws" in steps
    assert "1 effects" not in steps  # where a search goes on whose time is not over
    assert report.limited == 0.5
    assert report.to_dict()["time_limit"] == 0.5
