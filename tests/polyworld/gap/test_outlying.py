"""Runs that behave unlike the rest, against what was done to them."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.gap import GapReport, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.report import effects_of
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

K = 0.03
DRAG = Bouncing(acceleration=lambda _t, _x, v, _w: -K / MASS * np.linalg.norm(v) * v)


def flights(ball: Bouncing, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, 6), rng, 0.002, duration=1.0, rate=60.0)


def pushed(recording: Recording, run: int, instant: int, speed: float = 3.0) -> Recording:
    """From an instant on the ball moves sideways, too: struck by something that nobody mentioned."""
    runs = list(recording.runs)
    positions = runs[run].positions.copy()
    since = np.maximum(runs[run].times - runs[run].times[instant], 0.0)
    positions[:, 0, 1] += speed * since
    runs[run] = replace(runs[run], positions=positions)
    return Recording(tuple(runs))


def found(recording: Recording) -> GapReport:
    return find_gap(ball_world(), recording, candidates=named(["quadratic_drag", "tilt"]))


def test_the_law_is_named_beside_a_run_that_was_struck_which_is_reported_with_when() -> None:
    report = found(pushed(flights(DRAG, 8), 2, 36))
    assert (report.verdict.kind, report.names) == ("identified", ("quadratic_drag",))
    (bad,) = report.set_aside
    assert bad.run == "run2"
    assert bad.since is not None
    assert bad.since == pytest.approx(0.6, abs=0.15)
    coefficient = effects_of(report.verdict.best)[0]["unknowns"]["coefficient"]
    low, high = coefficient["interval95"]
    assert abs(coefficient["value"] - K) < high - low < 0.1 * K  # four standard errors


@pytest.mark.benchmark  # a second run that is set aside
def test_a_zoom_of_one_run_is_found_under_the_law_that_explains_the_others() -> None:
    recording = flights(DRAG, 9)
    runs = list(recording.runs)
    runs[5] = replace(runs[5], positions=1.15 * runs[5].positions)
    report = found(Recording(tuple(runs)))
    assert (report.verdict.kind, report.names) == ("identified", ("quadratic_drag",))
    assert [a.run for a in report.set_aside] == ["run5"]


def test_what_happens_in_most_runs_is_no_exception() -> None:
    recording = flights(Bouncing(), 5)
    for run in range(4):
        recording = pushed(recording, run, 30)
    report = found(recording)
    assert report.verdict.kind == "unexplained"
    assert report.set_aside == ()
