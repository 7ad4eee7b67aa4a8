"""From a fitted world with a gap to a better one, tool by tool, on a ball whose hidden drag is known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from mcp import Client

from atw_mcp.gap.numbers import GapNumbers
from evidence_store import EvidenceStore
from tests.atw_mcp.gap.thrown_ball import DRAG, EFFECTS, MASS, SIGMA, flown, world, write_table
from tests.atw_mcp.session import Session

WAIT = {"patience_seconds": 300}


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_table(tmp_path_factory.mktemp("gap") / "ball.csv", flown())


@pytest.fixture(scope="module")
def call(table: Path) -> Session:
    session = Session(table.parent / "atw.db")
    session("OpenCase", data=str(table), name="ball")
    session("ImportObservation", case="ball", kind="recording", path=str(table))
    session("BuildWorld", case="ball", world=world())
    return session


@pytest.fixture(scope="module")
def start(call: Session) -> str:
    rows = call.store_rows("SELECT world_id FROM case_worlds WHERE case_id = 'ball' AND origin = 'given'")
    return str(rows[0][0])


@pytest.fixture(scope="module")
def discrepancy(call: Session, start: str) -> dict[str, Any]:
    return call("FindDiscrepancy", case="ball", world=start, **WAIT)


@pytest.fixture(scope="module")
def proposals(call: Session, start: str) -> dict[str, Any]:
    return call("ProposeEffects", case="ball", world=start, effects=EFFECTS, max_effects=1, **WAIT)


@pytest.fixture(scope="module")
def added(call: Session, proposals: dict[str, Any]) -> dict[str, Any]:
    return call("AddEffect", case="ball", proposal=proposals["evidence"], **WAIT)


def test_a_recording_lists_its_runs_and_which_are_sealed(call: Session, table: Path) -> None:
    imported = call("ImportObservation", case="ball", kind="recording", path=str(table))
    assert [row["run"] for row in imported["data"]["runs"]] == ["r0", "r1", "r2", "r3"]
    assert [row["sealed"] for row in imported["data"]["runs"]] == [False, False, False, True]
    assert imported["data"]["objects"] == ["ball"]


def test_runs_to_seal_can_be_chosen(tmp_path: Path) -> None:
    call = Session(tmp_path / "atw.db")
    table = write_table(tmp_path / "ball.csv", flown())
    call("OpenCase", data=str(table), name="c")
    imported = call("ImportObservation", case="c", kind="recording", path=str(table), sealed_runs=["r1"])
    assert [row["run"] for row in imported["data"]["runs"] if row["sealed"]] == ["r1"]
    imported = call("ImportObservation", case="c", kind="recording", path=str(table), sealed_runs=[])
    assert not any(row["sealed"] for row in imported["data"]["runs"])
    refused = call.refused("ImportObservation", case="c", kind="recording", path=str(table), sealed_runs=["r9"])
    assert "r9" in refused
    assert "r0" in refused


def test_columns_that_are_not_used_are_reported(tmp_path: Path) -> None:
    call = Session(tmp_path / "atw.db")
    table = write_table(tmp_path / "ball.csv", flown(), "run,object,t,x,y,depth")
    call("OpenCase", data=str(table), name="c")
    read = call("ImportObservation", case="c", kind="recording", path=str(table), columns={"y": "y"})
    assert "depth" in read["summary"]


def test_the_gap_is_seen_and_where_the_ball_is_fast(discrepancy: dict[str, Any]) -> None:
    data = discrepancy["data"]
    assert data["explained"] is False
    by_run = data["share_of_gap"]["run"]
    assert max(by_run, key=by_run.get) == "r2"  # the fastest of the runs that are not sealed, 9.9 m/s
    assert "r3" not in by_run
    assert "ProposeEffects" in data["next"]


def test_a_world_that_explains_its_data_has_nothing_missing(tmp_path: Path) -> None:
    call = Session(tmp_path / "atw.db")
    table = write_table(tmp_path / "ball.csv", flown(drag=0.0))
    call("OpenCase", data=str(table), name="c")
    call("ImportObservation", case="c", kind="recording", path=str(table))
    call("BuildWorld", case="c", world=world())
    assert call("FindDiscrepancy", case="c", **WAIT)["data"]["explained"] is True
    found = call("ProposeEffects", case="c", effects=EFFECTS, max_effects=1, **WAIT)
    assert found["data"]["verdict"] == "nothing_missing"
    refused = call.refused("AddEffect", case="c", proposal=found["evidence"])
    assert "nothing_missing" in refused


def test_the_hidden_drag_is_named_with_its_strength(proposals: dict[str, Any]) -> None:
    data = proposals["data"]
    assert data["verdict"] == "identified"
    effect = data["proposals"][0]["effects"][0]
    assert effect["name"] == "quadratic_drag"
    low, high = effect["unknowns"]["coefficient"]["interval95"]
    # 99.99% of the intervals that are right hold the truth when they are twice as wide.
    middle, half = 0.5 * (low + high), high - low
    assert abs(middle - DRAG) < half < 0.01 * DRAG
    assert "AddEffect" in data["next"]


def test_adding_it_closes_the_gap_on_the_run_that_no_step_has_seen(added: dict[str, Any]) -> None:
    sealed = added["data"]["sealed"]
    assert "r3" in added["data"]["sealed_data"]
    assert sealed["gap_before"] > 10 * SIGMA
    assert sealed["closed"] > 0.95
    assert sealed["noise_floor"] == pytest.approx(SIGMA, rel=0.3)


def test_results_leave_an_agent_room(
    discrepancy: dict[str, Any], proposals: dict[str, Any], added: dict[str, Any]
) -> None:
    for result in (discrepancy, proposals, added):
        assert len(str(result["data"])) < 3500, result["tool"]


def test_equal_questions_are_answered_from_the_store(call: Session, start: str, proposals: dict[str, Any]) -> None:
    again = call("ProposeEffects", case="ball", world=start, effects=EFFECTS[::-1], max_effects=1, patience_seconds=0)
    assert again["status"] == "completed"
    assert again["evidence"] != proposals["evidence"]
    assert again["data"] == proposals["data"]


def test_the_whole_result_can_be_read_later(call: Session, proposals: dict[str, Any]) -> None:
    steps = call("ReadEvidence", evidence=proposals["evidence"], path="history")
    assert steps["data"]["of"] >= 3


def test_the_numbers_behind_the_pictures_are_kept_beside_the_evidence(
    call: Session, discrepancy: dict[str, Any], added: dict[str, Any]
) -> None:
    store = EvidenceStore(call.store)
    payload = store.evidence.get(discrepancy["evidence"]).payload
    kept = store.fits.get(payload["record"])
    numbers = GapNumbers.of_record(kept.document["numbers"], kept.arrays)
    assert [item.run for item in numbers.residuals] == ["r0", "r1", "r2"]
    for item, rows in zip(numbers.residuals, flown(), strict=False):
        np.testing.assert_allclose(item.observed, rows[:, 1:], atol=1e-6)
        # The world has gravity alone: whatever was fitted, its paths are parabolas.
        np.testing.assert_allclose(
            np.diff(item.before, n=2, axis=0) * 60**2, [[0.0, 0.0, -9.81]] * 59, atol=0.05
        )  # times have six decimals
        sigma = np.median((item.before - item.observed) / item.residual_before, axis=0)
        np.testing.assert_allclose(item.residual_before * sigma, item.before - item.observed, atol=1e-5)
        np.testing.assert_allclose(sigma, SIGMA, rtol=0.3)  # as so few samples show it
    assert numbers.jumps == ()  # air brakes little by little
    kept = store.fits.get(store.evidence.get(added["evidence"]).payload["record"])
    numbers = GapNumbers.of_record(kept.document["numbers"], kept.arrays)
    assert [(item.run, item.held_out) for item in numbers.residuals] == [
        ("r0", False),
        ("r1", False),
        ("r2", False),
        ("r3", True),
    ]
    assert all(
        np.abs(item.residual_after).mean() < 1.0 < np.abs(item.residual_before).mean() / 3 for item in numbers.residuals
    )


def test_agents_are_not_shown_the_numbers(call: Session, discrepancy: dict[str, Any]) -> None:
    again = call("ReadEvidence", evidence=discrepancy["evidence"], detail="full")
    assert "record" not in str(again["data"]).replace("recording", "")
    assert "residuals" not in again["data"]


def test_a_law_of_ones_own_is_fitted_and_can_be_switched_off(tmp_path: Path) -> None:
    call = Session(tmp_path / "atw.db")
    table = write_table(tmp_path / "ball.csv", flown())
    call("OpenCase", data=str(table), name="c")
    call("ImportObservation", case="c", kind="recording", path=str(table))
    call("BuildWorld", case="c", world=world())
    law = {
        "name": "air",
        "kind": "expression",
        "expression": "-k*speed*v",
        "parameters": {"k": 0.0},
        "parameter_units": {"k": "1/m"},
    }
    added = call("AddEffect", case="c", effect=law, **WAIT)["data"]
    assert added["explains"] is True
    assert added["effects"][0]["unknowns"]["k"]["value"] == pytest.approx(DRAG / MASS, rel=0.01)
    assert added["sealed"]["closed"] > 0.95
    buys = added["evidence"]
    assert buys["error_after"] < 1.5 < 10.0 < buys["error_before"]
    assert buys["gained"] > 100.0
    assert buys["further_unknowns"] == 1
    call("CommitWorld", case="c", world=added["world"])
    on = call("Rollout", case="c", horizon_seconds=1.0)["data"]["rollout"]
    edit = {"action": "toggle_effect", "effect": "air", "enabled": False}
    off = call("Rollout", case="c", horizon_seconds=1.0, edits=[edit])["data"]["rollout"]
    apart = call("CompareWorlds", base=on, edited=off)["data"]["objects"][0]["final_distance"]
    # From rest: g t^2 / 2 against (m / k) log cosh(t sqrt(g k / m)), 4.905 m and 4.482 m.
    assert apart == pytest.approx(0.4171, abs=0.005)


def test_an_expression_that_is_no_acceleration_is_refused(call: Session, start: str) -> None:
    law = {"name": "air", "kind": "expression", "expression": "-k*v", "parameters": {"k": 0.1}}
    refused = call.refused("AddEffect", case="ball", world=start, effect=law)
    assert "m/s" in refused


def test_refusals_name_the_valid_choices_and_the_next_step(call: Session) -> None:
    assert "quadratic_drag" in call.refused("ProposeEffects", case="ball", effects=["dragg"])
    assert "ProposeEffects" in call.refused("AddEffect", case="ball", proposal="ev-999999")
    assert "one of the two" in call.refused("AddEffect", case="ball")
    assert "initial state" in call.refused("FindDiscrepancy", case="ball", base=["objects.ball.velocity.x"])
    assert "restitution" in call.refused("FindDiscrepancy", case="ball", base=["objects.ball.restitutionn"])


def test_a_case_without_measurements_is_refused_with_how_to_bring_them_in(tmp_path: Path) -> None:
    call = Session(tmp_path / "atw.db")
    table = write_table(tmp_path / "ball.csv", flown())
    call("OpenCase", data=str(table), name="c")
    call("BuildWorld", case="c", world=world())
    assert "ImportObservation" in call.refused("FindDiscrepancy", case="c")


def test_a_search_can_be_stopped(call: Session, start: str) -> None:
    async def session() -> str:
        async with Client(call.server) as client:
            asked = {"case": "ball", "world": start, "seed": 7, "patience_seconds": 0.2}
            running = json.loads((await client.call_tool("ProposeEffects", asked)).content[0].text)
            assert running["status"] == "running"
            await client.call_tool("CancelWork", {"evidence": running["evidence"]})
            waiting = {"evidence": running["evidence"], "wait_seconds": 30}
            stopped = json.loads((await client.call_tool("ReadEvidence", waiting)).content[0].text)
        return str(stopped["status"])

    assert anyio.run(session) == "cancelled"
