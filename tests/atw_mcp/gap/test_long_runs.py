"""Gap tools on one long run: reported, fitted, and compared before and after."""

import numpy as np
import pytest

from atw_mcp.calls.jobs import Progress
from atw_mcp.gap.work import examine, fitted_effect, worth
from polyworld.data.recording import Recording, Run
from polyworld.gap.sealed import Split, hold_out
from polyworld.world import Effect
from tests.polyworld.gap_scenes import puck_world

DRAG = 0.12  # [1/s]
TABLE = puck_world(friction=0.0)


def slide(count: int) -> Recording:
    """One run of a puck that air slows in proportion to its speed: x = x0 + v0 (1 - exp(-c t)) / c."""
    times = np.arange(count) / 200.0
    places = np.full((count, 1, 3), np.nan)
    way = np.array([1.5, -0.7]) * ((1.0 - np.exp(-DRAG * times)) / DRAG)[:, None]
    places[:, 0, :2] = way + np.random.default_rng(7).normal(0.0, 1e-3, way.shape)
    return Recording((Run("slide", ("puck",), times, places, np.full((count, 1, 4), np.nan)),))


def test_where_a_long_run_disagrees_is_reported_by_its_clock() -> None:
    outcome = examine(TABLE, Split(slide(1600), None, ""), (), False, Progress())
    assert not outcome.data["explained"]
    assert outcome.data["error"] > 3.0
    assert {item["axis"] for item in outcome.data["worst"]} == {"x", "y"}
    assert outcome.data["worst"][0]["axis"] == "x"  # along which it is faster
    assert set(outcome.pictures) == {"residuals.png", "paths.png", "map.png"}
    assert outcome.numbers is not None
    (item,) = outcome.numbers.residuals
    assert item.run == "slide"
    assert (item.times[0], item.times[-1]) == (0.0, pytest.approx(1599 / 200.0, abs=0.04))  # every few samples
    assert outcome.numbers.jumps == ()


def test_an_effect_added_to_a_long_run_is_fitted_and_closes_the_sealed_gap() -> None:
    parts = hold_out(slide(2400))
    drag = Effect(name="drag", kind="linear_drag", parameters={"coefficient": 0.0})
    proposal = fitted_effect(TABLE, drag, parts.fitted, (), Progress())
    low, high = proposal["effects"][0]["unknowns"]["coefficient"]["interval95"]
    assert low < TABLE.objects[0].mass * DRAG < high
    outcome = worth(proposal, parts, Progress())
    assert outcome.data["explains"]
    assert outcome.data["sealed"]["closed"] > 0.9
    assert outcome.world is not None
    np.testing.assert_allclose(outcome.world.objects[0].velocity[:2], [1.5, -0.7], atol=0.005)
    assert outcome.numbers is not None
    early, late = outcome.numbers.residuals
    assert (early.run, early.held_out, late.run, late.held_out) == ("slide", False, "slide", True)
    assert late.times[0] == pytest.approx(1800 / 200.0)
    np.testing.assert_allclose(np.diff(late.times), late.times[1] - late.times[0], atol=1e-9)
