"""Runs that behave unlike the rest, against what was done to them."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.outlying import event_runs, without_runs
from polyworld.gap.settings import OutlierSettings
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

K = 0.03
DRAG = Bouncing(acceleration=lambda _t, _x, v, _w: -K / MASS * np.linalg.norm(v) * v)


def flights(ball: Bouncing, seed: int, sigma: float = 0.002) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, 8), rng, sigma, duration=1.2, rate=100.0)


def pushed(recording: Recording, run: int, instant: int, speed: float = 3.0) -> Recording:
    """From an instant on the ball moves sideways, too: struck by something that nobody mentioned."""
    runs = list(recording.runs)
    positions = runs[run].positions.copy()
    late = np.arange(len(runs[run].times)) >= instant
    since = runs[run].times - runs[run].times[instant]
    positions[late, 0, 1] += speed * since[late]
    runs[run] = replace(runs[run], positions=positions)
    return Recording(tuple(runs))


def found_in(recording: Recording) -> tuple[str, ...]:
    return tuple(o.run for o in event_runs(ball_world(), recording, OutlierSettings()))


@pytest.mark.parametrize(("ball", "instant"), [(Bouncing(), 52), (DRAG, 37), (DRAG, 80)])
def test_a_blow_nobody_mentioned_is_found_with_its_run(ball: Bouncing, instant: int) -> None:
    assert found_in(pushed(flights(ball, 5), 3, instant)) == ("run3",)


@pytest.mark.parametrize(("ball", "seed"), [(Bouncing(), 1), (DRAG, 2), (DRAG, 3)])
def test_no_run_is_set_aside_where_all_obey_one_law(ball: Bouncing, seed: int) -> None:
    assert found_in(flights(ball, seed)) == ()


def test_what_happens_in_most_runs_is_no_exception() -> None:
    recording = flights(Bouncing(), 5)
    for run in range(5):
        recording = pushed(recording, run, 50)
    assert found_in(recording) == ()


def test_the_law_is_named_beside_a_bad_run_which_is_reported_with_when() -> None:
    recording = pushed(flights(DRAG, 8), 2, 60)
    settings = GapSettings(null_control=False, experiment=False)
    candidates = named(["quadratic_drag", "linear_drag", "fan", "tilt"])
    report = find_gap(ball_world(), recording, candidates=candidates, settings=settings)
    assert report.verdict.kind == "identified"
    assert report.names == ("quadratic_drag",)
    (bad,) = report.set_aside
    assert bad.run == "run2"
    assert bad.when is not None
    assert bad.when == pytest.approx(0.6, abs=0.2)
    low, high = report.intervals[0]
    assert low < K < high


def test_a_zoom_of_one_run_is_found_under_the_law_that_explains_the_others() -> None:
    recording = flights(DRAG, 9)
    runs = list(recording.runs)
    runs[5] = replace(runs[5], positions=1.15 * runs[5].positions)
    settings = GapSettings(null_control=False, experiment=False)
    candidates = named(["quadratic_drag", "linear_drag", "tilt"])
    report = find_gap(ball_world(), Recording(tuple(runs)), candidates=candidates, settings=settings)
    assert report.names == ("quadratic_drag",)
    assert [o.run for o in report.set_aside] == ["run5"]


def test_settings_refuse_to_set_half_of_the_runs_aside() -> None:
    with pytest.raises(ValueError, match="below one half"):
        OutlierSettings(most=0.5)


def test_runs_are_left_out_by_name() -> None:
    recording = flights(Bouncing(), 1)
    assert [r.name for r in without_runs(recording, ["run1", "run6"]).runs] == [f"run{k}" for k in (0, 2, 3, 4, 5, 7)]
