"""Limits of a recording are stated, whatever the verdict."""

from dataclasses import replace

import numpy as np

from polyworld.data.recording import Recording
from polyworld.gap.cautions import cautions
from tests.polyworld.gap_scenes import Bouncing, ball_recording, ball_world, launches


def seen(*axes: int, count: int = 60) -> Recording:
    """Two throws of which only some components were measured."""
    rng = np.random.default_rng(0)
    whole = ball_recording(Bouncing(), launches(rng, 2), rng, 0.001, duration=1.0, rate=60.0)
    runs = []
    for run in whole.runs:
        places = run.positions.copy()
        for axis in {0, 1, 2} - set(axes):
            places[..., axis] = np.nan
        keep = np.arange(len(run.times)) < count
        runs.append(replace(run, positions=places).rows(keep))
    return Recording(tuple(runs))


def with_turns(recording: Recording) -> Recording:
    """The same with orientations: the ball does not turn."""
    still = np.array([1.0, 0.0, 0.0, 0.0])
    return Recording(
        tuple(replace(r, orientations=np.broadcast_to(still, r.orientations.shape).copy()) for r in recording.runs)
    )


def test_a_whole_recording_calls_for_no_caution() -> None:
    assert cautions(ball_world(), with_turns(seen(0, 1, 2))) == ()


def test_a_spin_that_nobody_measured_is_reported_with_what_it_is_taken_for() -> None:
    (said,) = cautions(ball_world(), seen(0, 1, 2))
    assert said.startswith("neither turns nor spins of ball were measured")
    assert "(0, 0, 0) rad/s" in said


def test_components_that_were_never_measured_are_named() -> None:
    (said,) = cautions(ball_world(), with_turns(seen(0, 2)))
    assert said.startswith("y of ball was never measured")


def test_short_series_make_the_verdict_a_guess() -> None:
    (said,) = cautions(ball_world(), with_turns(seen(0, 1, 2, count=12)))
    assert said.startswith("series of 12 instants")
