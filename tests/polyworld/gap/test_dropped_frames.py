"""Frames that a camera dropped or repeated in one run: which run, since when and how many."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapReport, find_gap
from polyworld.gap.catalogue import named
from polyworld.world import World

RATE, ONSET = 100.0, 0.7  # frames a second, seconds


def turning(velocity: float, frames: float, sigma: float = 0.001) -> Recording:
    """Four flights of a turning ball without a bounce; the second loses so many frames."""
    rng = np.random.default_rng(4)
    stamps = np.arange(100) / RATE
    runs = []
    for k in range(4):
        times = stamps + (stamps > ONSET) * (frames / RATE if k == 1 else 0.0)
        places = np.stack([velocity * (1.0 + 0.05 * k) * times, 0.0 * times, 8.0 - 0.5 * 9.81 * times**2], axis=-1)
        half = 0.5 * (15.0 * times + rng.normal(0.0, sigma, len(times)))
        turned = np.stack([np.cos(half), 0.0 * half, np.sin(half), 0.0 * half], axis=-1)
        places += rng.normal(0.0, sigma, places.shape)
        runs.append(Run(f"run{k}", ("ball",), stamps, places[:, None], turned[:, None]))
    return Recording(tuple(runs))


def found(recording: Recording) -> GapReport:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1], "mass": 0.5}
    world = World.model_validate({"objects": [ball], "time": {"seconds_per_frame": 1.0 / RATE}})
    return find_gap(world, recording, candidates=named(["dropped_frames", "tilt"]))


@pytest.mark.parametrize(("frames", "shown_by"), [(-2, "places and turns"), (3, "turns")])
def test_onset_and_number_of_frames(frames: int, shown_by: str) -> None:
    recording = turning(4.0, frames)
    if shown_by == "turns":
        still = turning(0.0, frames).runs
        recording = Recording(tuple(replace(r, positions=r.positions * [1.0, np.nan, np.nan]) for r in still))
    report = found(recording)
    assert (report.verdict.kind, report.names) == ("identified", ("dropped_frames",))
    observer = report.world.observer
    assert observer is not None
    assert observer.shift_run == "run1"
    assert observer.shift == pytest.approx(frames / RATE, abs=0.1 / RATE)
    assert observer.shift_time == pytest.approx(ONSET + 0.5 / RATE, abs=1.5 / RATE)


def test_a_lag_of_a_third_of_a_frame_is_no_frame_that_was_dropped() -> None:
    """So late is a model that makes an impact in no time of what took some milliseconds."""
    assert "dropped_frames" not in found(turning(4.0, 0.3)).names
