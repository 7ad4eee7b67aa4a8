"""Numbers behind the pictures of a gap: what they are of turns, and that a record gives them back."""

from dataclasses import fields, replace

import numpy as np
import pytest

from atw_mcp.gap.numbers import GapNumbers, Jump, Residuals, jumps_of, residuals_of
from atw_mcp.gap.pictures import residual_picture
from polyworld.data.recording import Recording, Run
from polyworld.gap.cross_validation import examined
from polyworld.gap.report import compared
from polyworld.gap.sealed import hold_out
from tests.polyworld.gap_scenes import puck_world

COUNT, STEP, NOISE = 60, 0.02, 0.01  # samples, [s], [rad]


def test_residuals_of_turns_are_those_of_a_steady_spin() -> None:
    times = np.arange(COUNT) * STEP
    angle = 1.5 * times + np.random.default_rng(3).normal(scale=NOISE, size=COUNT)
    turned = np.zeros((COUNT, 1, 4))
    turned[:, 0, 0], turned[:, 0, 3] = np.cos(angle / 2), np.sin(angle / 2)
    places = np.random.default_rng(4).normal(scale=1e-3, size=(COUNT, 1, 3))
    run = Run("r", ("puck",), 7.0 + times, places, turned)
    seen = compared(examined(puck_world(friction=0.0), Recording((run,))))
    position, rotation = residuals_of(seen)
    assert (position.kind, rotation.kind) == ("position", "rotation")
    np.testing.assert_allclose(rotation.times, times, atol=1e-9)
    assert np.isnan(rotation.residual_before[:, :2]).all()  # a disc on a table turns about z alone
    residual = rotation.residual_before[:, 2]
    (free,) = np.polyfit(np.diff(residual, 2), -np.diff(angle, 2), 1)[:1]  # nothing brakes it
    assert free == pytest.approx(NOISE, rel=0.3)  # the noise, in which residuals are counted
    np.testing.assert_allclose(np.diff(residual * free + angle, 2), 0.0, atol=1e-6)
    assert residual_picture(seen) != residual_picture([replace(item, turning={}) for item in seen])


def test_the_later_part_of_a_run_goes_by_the_clock_of_the_whole() -> None:
    times = 7.0 + np.arange(COUNT) * STEP
    places = np.random.default_rng(4).normal(scale=1e-3, size=(COUNT, 1, 3))
    parts = hold_out(Recording((Run("r", ("puck",), times, places, np.full((COUNT, 1, 4), np.nan)),)))
    assert parts.held_out is not None
    (late,) = residuals_of(compared(examined(puck_world(), parts.held_out)), sealed=parts)
    assert (late.run, late.held_out) == ("r", True)
    np.testing.assert_allclose(late.times, times[-len(late.times) :] - 7.0, atol=1e-9)


def test_a_jump_is_the_change_of_velocity_of_a_puck_that_is_struck() -> None:
    times = np.arange(COUNT) * STEP
    first, struck, change = np.array([1.0, -0.5]), 0.61, np.array([-1.6, 0.4])
    places = np.full((COUNT, 1, 3), np.nan)
    places[:, 0, :2] = first * times[:, None] + change * np.maximum(times - struck, 0.0)[:, None]
    places[:, 0, :2] += np.random.default_rng(4).normal(scale=1e-4, size=(COUNT, 2))
    run = Run("r", ("puck",), 7.0 + times, places, np.full((COUNT, 1, 4), np.nan))
    (jump,) = jumps_of(puck_world(friction=0.0), Recording((run,)))
    assert (jump.run, jump.name) == ("r", "puck")
    assert jump.time == pytest.approx(struck, abs=STEP)
    np.testing.assert_allclose(jump.change[:2], change, atol=0.05)
    np.testing.assert_allclose(jump.place[:2], first * struck, atol=0.02)


def test_a_record_gives_back_what_was_kept() -> None:
    rng = np.random.default_rng(0)
    series = tuple(
        Residuals(run, "puck", kind, held_out, rng.normal(size=n), *(rng.normal(size=(n, 3)) for _ in range(5)))
        for run, kind, held_out, n in (
            ("a", "position", False, 20),
            ("a", "rotation", False, 20),
            ("b", "spin", True, 3),
        )
    )
    series[0].observed[4] = np.nan
    jump = Jump("b", "puck", 0.2, np.array([1.0, 2.0, np.nan]), np.array([0.5, 0.0, np.nan]), 0.1)
    for kept in (GapNumbers(series, (jump,)), GapNumbers(series, ()), GapNumbers(series), GapNumbers(())):
        again = GapNumbers.of_record(*kept.to_record())
        assert (again.jumps is None) == (kept.jumps is None)
        found, expected = [*again.residuals, *(again.jumps or ())], [*kept.residuals, *(kept.jumps or ())]
        for one, other in zip(found, expected, strict=True):
            for item in fields(one):
                value, was = getattr(one, item.name), getattr(other, item.name)
                if isinstance(was, str | bool):
                    assert value == was
                else:
                    np.testing.assert_allclose(value, was, rtol=1e-6)
