"""Gaps on data that no fit has seen, against what is known of how they were made."""

import numpy as np
import pytest

from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import catalogue
from polyworld.gap.held_out import held_out_gap
from polyworld.world import World
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

K = 0.03
DRAG = Bouncing(acceleration=lambda _t, _x, v, _w: -K / MASS * np.linalg.norm(v) * v)


def with_drag(k: float) -> World:
    effect = {"name": "drag", "kind": "quadratic_drag", "parameters": {"coefficient": k}}
    return World.model_validate({**ball_world().model_dump(), "effects": [effect]})


def test_the_true_law_leaves_the_noise_alone_and_the_base_world_more() -> None:
    rng = np.random.default_rng(3)
    held_out = ball_recording(DRAG, launches(rng, 3), rng, 0.001, duration=1.0, rate=60.0)
    gap = held_out_gap(ball_world(), with_drag(K), held_out)
    assert gap.noise_floor == pytest.approx(0.001, rel=0.15)
    assert gap.gap_before > 0.005
    assert gap.gap_after < 0.0006
    assert gap.closed is not None
    assert gap.closed > 0.9


def test_held_out_data_on_which_something_else_acts_contradict_the_verdict() -> None:
    """Nothing is missing in what is fitted, but drag acts in the held-out data: that nothing is missing is not said."""
    rng = np.random.default_rng(6)
    fitted = ball_recording(Bouncing(), launches(rng, 3), rng, 0.001, duration=1.0, rate=60.0)
    dragged = ball_recording(DRAG, launches(rng, 2), rng, 0.001, duration=1.0, rate=60.0)
    settings = GapSettings(null_control=False, experiment=False)
    report = find_gap(
        ball_world(), fitted, held_out=dragged, candidates=[catalogue()["quadratic_drag"]], settings=settings
    )
    assert report.verdict.kind == "unexplained"
    assert [check.name for check in report.checks] == ["held_out_remainder"]
    assert "sealed data do not support this" in report.checks[0].found
    assert held_out_gap(ball_world(), with_drag(K), dragged).contradicts is None
    assert held_out_gap(ball_world(), ball_world(), fitted).contradicts is None


def test_a_law_that_does_nothing_closes_nothing() -> None:
    rng = np.random.default_rng(4)
    held_out = ball_recording(DRAG, launches(rng, 2), rng, 0.001, duration=1.0, rate=60.0)
    gap = held_out_gap(ball_world(), with_drag(0.0), held_out)
    assert gap.closed == pytest.approx(0.0, abs=1e-6)


def test_the_null_control_finds_nothing_and_the_effect_gains_little_there() -> None:
    rng = np.random.default_rng(5)
    recording = ball_recording(DRAG, launches(rng, 4), rng, 0.003, duration=1.0, rate=60.0)
    offered = [catalogue()[n] for n in ("tilt", "quadratic_drag")]
    report = find_gap(ball_world(), recording, candidates=offered, settings=GapSettings(experiment=False))
    assert report.names == ("quadratic_drag",)
    assert report.null is not None
    assert report.null.verdict == "nothing_missing"
    assert report.null.chi2_before == pytest.approx(report.null.count, rel=0.2)
    assert report.null.chi2_after is not None
    assert report.null.chi2_before - report.null.chi2_after < 11.0  # chi-squared with 1 degree of freedom: p < 0.001
