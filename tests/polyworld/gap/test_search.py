"""Names found for what SciPy's balls hide: one effect, two, none, and one that is not on offer."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.catalogue import catalogue
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

QUICK = GapSettings(null_control=False, experiment=False)
PLAIN = replace(QUICK, residual_force=False)  # what is left over is not described by an expression
FEW = ("gravity_error", "restitution_error", "tilt", "linear_drag", "quadratic_drag")


def hidden(ball: Bouncing, *, sigma: float = 0.003, seed: int = 0, runs: int = 5) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, runs), rng, sigma, duration=1.0, rate=60.0)


def found(recording: Recording, names: tuple[str, ...] = FEW, settings: GapSettings = QUICK) -> GapReport:
    return find_gap(ball_world(), recording, candidates=[catalogue()[n] for n in names], settings=settings)


def drag(k: float) -> Callable[..., np.ndarray]:
    return lambda _t, _x, v, _w: -k / MASS * np.linalg.norm(v) * v


def test_quadratic_drag_is_named_and_its_coefficient_lies_in_the_interval() -> None:
    report = found(hidden(Bouncing(acceleration=drag(0.02)))).to_dict()
    assert report["verdict"] == "identified"
    assert report["credible_set"] == [["quadratic_drag"]]
    low, high = report["effects"][0]["unknowns"]["coefficient"]["interval95"]
    assert low < 0.02 < high
    assert high - low < 0.004


def test_a_wrong_restitution_is_distinguished_from_drag() -> None:
    report = found(hidden(Bouncing(after=lambda speed, along: (0.7 * speed, along)))).to_dict()
    assert report["credible_set"] == [["restitution_error"]]
    assert report["effects"][0]["unknowns"]["restitution"]["value"] == pytest.approx(0.7, abs=0.01)


def test_two_effects_are_found_together() -> None:
    push = np.array([0.6, -0.4, 0.0])
    ball = Bouncing(acceleration=lambda _t, _x, _v, _w: push, after=lambda speed, along: (0.7 * speed, along))
    report = found(hidden(ball, runs=4), ("restitution_error", "tilt", "quadratic_drag")).to_dict()
    assert report["verdict"] == "identified"
    assert sorted(report["credible_set"][0]) == ["restitution_error", "tilt"]


def test_nothing_is_named_where_nothing_is_missing() -> None:
    report = found(hidden(Bouncing()))
    assert report.verdict.kind == "nothing_missing"
    assert report.names == ()
    assert report.world is None


def test_an_effect_that_is_not_on_offer_stays_unexplained() -> None:
    centre = np.array([0.0, 0.0, 1.0])
    ball = Bouncing(acceleration=lambda _t, x, _v, _w: -4.0 * (x - centre))
    report = found(hidden(ball, sigma=0.001, runs=3), ("linear_drag", "restitution_error"), PLAIN)
    assert report.verdict.kind == "unexplained"


def test_a_base_unknown_is_fitted_and_not_offered_as_an_effect() -> None:
    free = Unknown("restitution", ("objects.ball.restitution",), "1", 0.8, 0.0, 1.0, 0.1)
    recording = hidden(Bouncing(after=lambda speed, along: (0.7 * speed, along)))
    offered = [catalogue()[n] for n in ("restitution_error", "linear_drag")]
    report = find_gap(ball_world(), recording, base=(free,), candidates=offered, settings=QUICK)
    assert report.verdict.kind == "nothing_missing"
    assert report.to_dict()["base"]["unknowns"]["restitution"]["value"] == pytest.approx(0.7, abs=0.01)


def test_equal_questions_give_equal_reports_and_steps_are_reported() -> None:
    recording = hidden(Bouncing(acceleration=drag(0.02)), runs=3)
    steps: list[str] = []
    offered = [catalogue()[n] for n in ("linear_drag", "quadratic_drag")]
    reports = [
        find_gap(
            ball_world(),
            recording,
            candidates=offered,
            settings=QUICK,
            progress=lambda _share, step: steps.append(step),
        ).to_dict()
        for _ in range(2)
    ]
    assert json.dumps(reports[0]) == json.dumps(reports[1])
    assert steps[0] == "base fit"
    assert steps[-1] == "done"


def test_a_cancelled_search_stops() -> None:
    recording = hidden(Bouncing(acceleration=drag(0.02)), runs=3)
    calls = iter(range(1000))
    with pytest.raises(InterruptedError):
        find_gap(ball_world(), recording, settings=QUICK, cancelled=lambda: next(calls) > 5)
