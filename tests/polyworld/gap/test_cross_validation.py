"""Predictions of data left out, against fits that never had them; and gaps on sealed data."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.cross_validation import folds_of, predict_left_out
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import Ground, ground_of
from polyworld.gap.hypothesis import Hypothesis, extended
from polyworld.gap.sealed import gap_between, hold_out, settled_alike
from polyworld.gap.verdict import intervals
from polyworld.world import World
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

K, SIGMA = 0.03, 0.002
DRAG = Bouncing(acceleration=lambda _t, _x, v, _w: -K / MASS * np.linalg.norm(v) * v)
SETTINGS = GapSettings()


def recorded(ball: Bouncing, runs: int, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, runs), rng, SIGMA, duration=1.0, rate=60.0)


def with_drag(k: float) -> World:
    effect = {"name": "drag", "kind": "quadratic_drag", "parameters": {"coefficient": k}}
    return World.model_validate({**ball_world().model_dump(), "effects": [effect]})


def dragged(ground: Ground) -> Fitted:
    """Quadratic drag fitted, and predicted without each fold in turn."""
    (law,) = extended(Hypothesis(ground.world), named(["quadratic_drag"])[0], ground.recording)
    fitted = fit(ground, law, growing=True, scale=1.0)
    predict_left_out(fitted, folds_of(ground, SETTINGS))
    return fitted


def test_values_without_a_run_are_those_of_a_fit_that_never_had_it() -> None:
    ground = ground_of(ball_world(), recorded(DRAG, 5, 3), SETTINGS)
    fitted = dragged(ground)
    low, high = intervals(fitted)[0]
    for r, run in enumerate(ground.recording.runs):
        others = [i for i, o in enumerate(ground.recording.runs) if o is not run]
        part = ground.cut([ground.recording.runs[i] for i in others], [ground.noise[i] for i in others])
        alone = fit(part, fitted.hypothesis, growing=True, scale=1.0)
        assert fitted.left_out[r, 0] == pytest.approx(alone.values[0], abs=0.05 * (high - low))
    assert np.sqrt(np.mean(fitted.errors**2)) == pytest.approx(1.0, abs=0.15)  # noise is known to a tenth


def test_values_without_a_stretch_are_those_of_a_fit_that_never_saw_it() -> None:
    ground = ground_of(ball_world(), recorded(DRAG, 1, 4), SETTINGS)
    fitted = dragged(ground)
    low, high = intervals(fitted)[0]
    (run,) = ground.recording.runs
    for fold, found in zip(folds_of(ground, SETTINGS), fitted.left_out, strict=True):
        places = run.positions.copy()
        places[fold.first : fold.last] = np.nan
        part = ground.cut([replace(run, positions=places)], ground.noise)
        alone = fit(part, fitted.hypothesis, fitted.point, scale=1.0)
        assert found[0] == pytest.approx(alone.values[0], abs=0.05 * (high - low))


def test_the_true_law_closes_the_gap_on_sealed_runs_and_one_that_does_nothing_none_of_it() -> None:
    sealed = recorded(DRAG, 3, 5)
    true, idle = (gap_between(*settled_alike((ball_world(), with_drag(k)), sealed, SETTINGS)) for k in (K, 0.0))
    assert true.noise_floor == pytest.approx(SIGMA, rel=0.2)
    assert true.gap_after < 0.5 * SIGMA < 0.05 * true.gap_before
    assert true.closed is not None
    assert true.closed > 0.9
    assert idle.closed == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("fitted", "sealed"), [(Bouncing(), DRAG), (DRAG, Bouncing())])
def test_sealed_runs_on_which_something_else_acts_contradict_the_verdict(fitted: Bouncing, sealed: Bouncing) -> None:
    offered = named(["quadratic_drag"])
    report = find_gap(ball_world(), recorded(fitted, 4, 6), held_out=recorded(sealed, 2, 7), candidates=offered)
    assert report.verdict.kind == "unexplained"
    assert any("sealed runs" in reason for reason in report.verdict.reasons)


def test_the_last_quarter_of_the_runs_or_of_the_time_is_sealed() -> None:
    recording = recorded(Bouncing(), 8, 1)
    parts = hold_out(recording)
    assert parts.held_out is not None
    assert [r.name for r in parts.held_out.runs] == ["run6", "run7"]
    assert [r.name for r in parts.fitted.runs] == [f"run{k}" for k in range(6)]
    alone = hold_out(recording.select(("run3",)))
    assert alone.held_out is not None
    (early,), (later,) = alone.fitted.runs, alone.held_out.runs
    assert (len(early.times), len(later.times)) == (45, 15)
    assert alone.into == pytest.approx(0.75)
    with pytest.raises(ValueError, match="all runs would be sealed"):
        hold_out(recording, [r.name for r in recording.runs])
    with pytest.raises(KeyError):
        hold_out(recording, ["run9"])
