"""The screening on ordinary recordings, generated and measured: no refusal, and no caution without a cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.screening import Finding, Screening, ScreenSettings, screen
from polyworld.world import World
from tests import real_data
from tests.polyworld.screening import cases
from tests.real_data import needs

LAWS = {
    "nothing": None,
    "drag": cases.drag(0.05),
    "strong drag": cases.drag(0.5),
    "wind": cases.wind(0.2, 6.0),
    "lift sideways": cases.lift((0.0, 0.0, 3.0)),
    "lift up and down": cases.lift((0.0, 4.0, 0.0)),
    "spring": cases.spring(30.0),
    "stiff spring": cases.spring(400.0),
    "repulsion": cases.spring(-20.0),
}


def kinds(screening: Screening) -> list[str]:
    return [f.kind for f in screening.findings]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("noise", [0.0, 1e-2])
def test_eight_launches_of_a_bouncing_ball_give_no_finding(law: str, noise: float) -> None:
    times = cases.sampling()
    found = screen(cases.ball_world(), cases.recorded(times, cases.bounces(times, law=LAWS[law]), noise))
    assert kinds(found) == []
    assert found.distinct_courses == 8


def test_video_of_a_bouncing_ball_gives_no_finding() -> None:
    times = cases.sampling(24.0)
    assert kinds(screen(cases.ball_world(), cases.recorded(times, cases.bounces(times), 5e-3))) == []


@pytest.mark.parametrize("rate", [24.0, 240.0])
def test_a_ball_that_bounces_until_it_rests_gives_no_finding(rate: float) -> None:
    times = cases.sampling(rate, 6.0)
    drops = [((0.0, 0.0, 0.5 + 0.1 * k), (0.3 * k, 0.0, 0.0)) for k in range(6)]
    assert kinds(screen(cases.ball_world(), cases.recorded(times, cases.bounces(times, drops), 1e-4))) == []


def test_blocks_that_slide_with_a_friction_of_one_are_not_taken_for_falling_sideways() -> None:
    times = cases.sampling()
    speeds = 3.0 + 0.4 * np.arange(6)
    sliding = np.minimum(times, speeds[:, None] / cases.G)
    x = speeds[:, None] * sliding - 0.5 * cases.G * sliding**2
    paths = np.stack([x, np.zeros_like(x), np.full_like(x, cases.RADIUS)], axis=-1)
    assert kinds(screen(cases.ball_world(), cases.recorded(times, paths))) == []


@pytest.mark.parametrize("push", [0.6, 1.5])
def test_slow_falls_and_strong_pulls_to_the_side_are_not_taken_for_units_or_axes(push: float) -> None:
    """A buoyant ball that rises at 0.6 g or 1.5 g: an effect, not a flipped axis."""
    times = cases.sampling(120.0, 0.8)
    starts = [((0.0, 0.0, 1.0 + 0.5 * k), (0.4 * k, 0.3 * k, 0.0)) for k in range(5)]

    def rising(_t: float, _x: cases.Array, v: cases.Array) -> cases.Array:
        return np.tile([0.0, 0.0, (1.0 + push) * cases.G], (len(v), 1))

    found = screen(cases.ball_world(), cases.recorded(times, cases.bounces(times, starts, rising)))
    assert "units" not in kinds(found)
    assert "axes" not in kinds(found)


def test_colliding_discs_give_no_finding() -> None:
    world, recording = cases.colliding_discs(cases.sampling(60.0, 1.0))
    found = screen(world, recording)
    assert kinds(found) == []
    assert found.distinct_courses == len(recording.runs)


def test_findings_are_sentences_with_refusals_first() -> None:
    times = cases.sampling(120.0, 0.8)
    recording = cases.scaled(cases.recorded(times, cases.bounces(times, cases.LAUNCHES[:1])), space=1000.0)
    found = screen(cases.ball_world(), recording)
    assert found.refused
    assert found.course_of == (0,)
    severities = [f.severity for f in found.findings]
    assert severities[0] == "refuse"
    assert severities == sorted(severities, reverse=True)
    for finding in found.findings:
        assert isinstance(finding, Finding)
        assert finding.message.endswith(".")


def test_settings_are_checked() -> None:
    with pytest.raises(ValueError, match="significant must be positive"):
        ScreenSettings(significant=0.0)
    with pytest.raises(ValueError, match="agreeing is a share"):
        ScreenSettings(agreeing=1.2)
    with pytest.raises(ValueError, match="must not be below agreeing"):
        ScreenSettings(refusing=0.5)
    with pytest.raises(ValueError, match="factor above 1"):
        ScreenSettings(unlike=0.5)


def test_recordings_of_orientations_alone_are_not_screened() -> None:
    times = cases.sampling(60.0, 1.0)
    turns = replace(
        cases.run("turns", times, np.full((60, 3), np.nan)), orientations=np.tile([1.0, 0.0, 0.0, 0.0], (60, 1, 1))
    )
    assert screen(cases.ball_world(), Recording((turns,))) == Screening((), (0,))


REAL: dict[str, tuple[str, Callable[[], tuple[World, Recording]], list[str], int]] = {
    "drops of four balls": ("ball_drop", real_data.ball_drop, [], 4),
    "drops of one ball": ("ball_drop", lambda: real_data.ball_drop(("golf_ball",)), ["one_course"], 1),
    "swing": ("pendulum", real_data.pendulum, ["single_run", "one_course"], 1),
    "swings": ("pendulum", lambda: real_data.pendulum_swings((1.0, 10.0, 24.0), 1.2, every=2), [], 3),
    "tosses": ("cube_toss", lambda: real_data.cube_toss(tuple(range(16))), [], 16),
    "flights": ("cube_toss", real_data.cube_flight, [], 12),
    "scenes": ("clevrer", lambda: real_data.clevrer(("00000", "02000", "03000", "04000")), [], 4),
    "scene": ("clevrer", real_data.clevrer, ["single_run", "one_course"], 1),
    "slides": ("clevrer", lambda: real_data.clevrer_slides(("00000", "02000", "03000", "04000", "05000")), [], 16),
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=needs(REAL[n][0])) for n in REAL])
def test_measured_recordings_give_only_what_is_true_of_them(name: str) -> None:
    _, read, expected, distinct = REAL[name]
    world, recording = read()
    found = screen(world, recording)
    assert kinds(found) == expected
    assert not found.refused
    assert found.distinct_courses == distinct


@needs("ball_drop")
@needs("cube_toss")
def test_measured_falls_in_wrong_units_and_axes_are_noticed() -> None:
    """A cube that tumbles over its edges after the flight leaves axes in some doubt."""
    for world, recording, axes in (
        (*real_data.ball_drop(("golf_ball", "baseball")), "refuse"),
        (*real_data.cube_toss(), "caution"),
    ):
        (found,) = (f for f in screen(world, cases.scaled(recording, space=1000.0)).findings if f.severity == "refuse")
        assert found.kind == "units"
        assert "--units mm" in found.message
        turned = screen(world, cases.relabelled(recording, (2, 0, 1)))
        assert [f.severity for f in turned.findings if f.kind == "axes"] == [axes]
