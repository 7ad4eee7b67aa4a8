"""Whether there are samples, runs and distinct courses enough."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.screening import Screening, screen
from tests.polyworld.screening import cases

Launch = tuple[tuple[float, float, float], tuple[float, float, float]]

WORLD = cases.ball_world()
OPEN = cases.ball_world(floor=None)
TIMES = cases.sampling(120.0, 0.6)


def kinds(screening: Screening) -> list[str]:
    return [f.kind for f in screening.findings]


def thrown(launches: Sequence[Launch], times: cases.Array = TIMES, noise: float = 1e-3) -> Recording:
    return cases.recorded(times, cases.bounces(times, launches, floor=False), noise)


def test_as_many_unknown_starts_as_numbers_are_refused() -> None:
    times = cases.sampling(24.0, 0.1)
    found = screen(WORLD, cases.recorded(times, cases.bounces(times)))
    assert found.refused
    assert found.findings[0].kind == "few_samples"
    assert cases.numbers(found.findings[0]) == [48.0, 48.0]


def test_few_samples_of_a_moving_object_are_a_caution_that_names_the_runs() -> None:
    times = cases.sampling(24.0, 1.0)
    recording = cases.recorded(times, cases.bounces(times))
    short = Recording((recording.runs[0].rows(times < 0.25), *recording.runs[1:]))
    (found,) = screen(WORLD, short).findings
    assert (found.kind, found.severity, "run run_0 " in found.message) == ("few_samples", "caution", True)
    assert 6.0 in cases.numbers(found)


def test_a_single_run_is_a_caution() -> None:
    assert "single_run" in kinds(screen(OPEN, thrown([((0, 0, 1), (1, 0, 2))])))
    assert "single_run" not in kinds(screen(OPEN, thrown([((0, 0, 1), (1, 0, 2)), ((0, 0, 1), (2, 0, 2))])))


def test_bounces_between_samples_are_a_caution() -> None:
    for rate, coarse in ((3.0, True), (30.0, False)):
        times = cases.sampling(rate, 8.0)
        found = screen(WORLD, cases.recorded(times, cases.bounces(times)))
        assert ("coarse_sampling" in kinds(found)) is coarse


def test_positions_that_jump_from_sample_to_sample_are_a_caution() -> None:
    """A puck between two walls that crosses the table nearly twice between samples."""
    rng = np.random.default_rng(0)
    for rate, coarse in ((1.1, True), (60.0, False)):
        times = np.arange(60) / rate
        way = np.array([1.5 + 0.1 * k for k in range(4)])[:, None] * times
        x = np.abs((way + 0.5) % 2.0 - 1.0)  # walls at 0 and 1
        paths = np.stack([x, 0.0 * x, 0.0 * x], axis=-1) + 1e-3 * rng.standard_normal((4, 60, 3))
        assert ("coarse_sampling" in kinds(screen(cases.table_world(), cases.recorded(times, paths)))) is coarse


def test_noise_that_hides_even_gravity_is_a_caution() -> None:
    launches: list[Launch] = [((0, 0, 1), (0.3 * k, 0, 1)) for k in range(4)]
    times = cases.sampling(60.0, 0.25)
    large = cases.ball_world(floor=None, radius=0.2)
    assert "noisy" not in kinds(screen(large, thrown(launches, times, 5e-3)))
    assert "noisy" in kinds(screen(large, thrown(launches, times, 3e-2)))


def test_launches_of_one_kind_are_one_course() -> None:
    found = screen(WORLD, cases.recorded(TIMES, cases.bounces(TIMES, [cases.LAUNCHES[0]] * 4)))
    assert found.course_of == (0, 0, 0, 0)
    assert kinds(found) == ["one_course"]
    assert "All 4 runs follow one course" in found.findings[0].message


def test_a_hand_that_repeats_a_launch_within_two_percent_gives_the_same_course() -> None:
    found = screen(
        OPEN,
        thrown([((0, 0, 1), (1, 0, 2)), ((0.01, 0, 1.01), (1.02, 0, 1.98)), ((0, 0, 1), (1.3, 0, 2))]),
    )
    assert found.course_of == (0, 0, 1)
    assert kinds(found) == []


@pytest.mark.parametrize(
    "other",
    [
        ((0.0, 0.0, 1.0), (-1.0, 0.0, 2.0)),  # another direction
        ((0.0, 0.0, 1.0), (1.2, 0.0, 2.0)),  # another speed
        ((0.0, 0.5, 1.0), (1.0, 0.0, 2.0)),  # the same path elsewhere
        ((0.0, 0.0, 1.0), (0.0, 1.0, 2.0)),
    ],
)
def test_another_direction_speed_or_place_is_another_course(other: Launch) -> None:
    found = screen(OPEN, thrown([((0.0, 0.0, 1.0), (1.0, 0.0, 2.0)), other]))
    assert found.distinct_courses == 2
    assert kinds(found) == []
