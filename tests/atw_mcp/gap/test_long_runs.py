"""Gap tools on one long run, which is cut into parts: reported, fitted, and compared before and after."""

import numpy as np

from atw_mcp.calls.jobs import Progress
from atw_mcp.gap.shown import shown_discrepancy
from atw_mcp.gap.work import examine, fitted_effect, worth
from polyworld.data.recording import Recording, Run
from polyworld.gap.held_out import Split, hold_out
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


def test_where_a_long_run_disagrees_is_reported_with_the_caution_that_it_is_in_parts() -> None:
    outcome = examine(TABLE, Split(slide(1600), None, ""), (), False, Progress())
    assert not outcome.data["explained"]
    (said,) = [c for c in shown_discrepancy(outcome.data)["cautions"] if "parts" in c]
    assert said.startswith("run slide is long: it was fitted in 3 parts of")
    assert set(outcome.pictures) == {"residuals.png", "paths.png", "map.png"}
    assert outcome.numbers is not None
    assert {item.run for item in outcome.numbers.residuals} == {"slide"}  # the parts go by the clock of the whole
    times = np.concatenate([item.times for item in outcome.numbers.residuals])
    np.testing.assert_allclose(times, np.arange(1600) / 200.0, atol=1e-9)


def test_an_effect_added_to_a_long_run_is_fitted_and_closes_the_sealed_gap() -> None:
    parts = hold_out(slide(2400))
    drag = Effect(name="drag", kind="linear_drag", parameters={"coefficient": 0.0})
    proposal = fitted_effect(TABLE, drag, parts.fitted, (), Progress())
    low, high = proposal.effects[0]["unknowns"]["coefficient"]["interval95"]
    assert low < TABLE.objects[0].mass * DRAG < high
    outcome = worth(proposal, parts, Progress())
    assert outcome.data["explains"]
    assert outcome.data["sealed"]["closed"] > 0.9
    assert outcome.world is not None
    np.testing.assert_allclose(outcome.world.objects[0].velocity[:2], [1.5, -0.7], atol=0.005)
    assert outcome.numbers is not None
    held_out = [item for item in outcome.numbers.residuals if item.held_out]
    assert {item.run for item in held_out} == {"slide"}
    np.testing.assert_allclose(np.concatenate([i.times for i in held_out]), np.arange(1800, 2400) / 200.0, atol=1e-9)
