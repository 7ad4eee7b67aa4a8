"""A branch beside its base: the instants shown, the distances written, and where the lines that join places end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atw_mcp.calls.app import App
from atw_mcp.calls.results import Answer
from atw_mcp.looking.overlay import OBSERVED, ROOM
from atw_mcp.looking.plan_view import PlanView, plan_frame
from atw_mcp.probing.branch_difference import BranchDifference, Side
from atw_mcp.probing.branch_view import BASE, BRANCH, WIDTH, BranchView
from atw_mcp.tools import rollout_pictures
from atw_mcp.tools.querying import compare_worlds
from atw_mcp.worlds.rollouts import compute_rollout
from polyworld.edits.interventions import Remove, branch
from polyworld.solver.rollout import rollout
from polyworld.world import World
from tests.atw_mcp.two_discs import MEETING, SPEED, case_with, two_discs

HORIZON = 1.2  # [s]


@pytest.fixture(scope="module")
def difference() -> BranchDifference:
    """Without the target the striker goes on at SPEED, where it would have stopped at MEETING."""
    sides = [two_discs(), branch(two_discs(), [Remove(object="target")])]
    return BranchDifference(
        *(Side(name, w, rollout(w, HORIZON)) for name, w in zip(("base", "branch"), sides, strict=True))
    )


def near(image: np.ndarray[Any, Any], color: tuple[int, int, int]) -> np.ndarray[Any, Any]:
    found: np.ndarray[Any, Any] = np.abs(image.astype(int) - np.array(color)).max(axis=2) < 60
    return found


def test_displacement_is_the_way_the_striker_goes_on(difference: BranchDifference) -> None:
    times = np.array([0.4, 1.0, HORIZON])
    assert difference.displacement("striker", times) == pytest.approx(
        SPEED * (np.maximum(times - MEETING, 0.0)), abs=5e-3
    )
    assert np.isnan(difference.displacement("target", times)).all()


def test_instants_are_those_of_the_event_gone_and_the_largest_displacement(difference: BranchDifference) -> None:
    chosen = difference.instants(list(difference.names), 3, 0, 60)
    why = {instant.frame: "; ".join(instant.why) for instant in chosen}
    assert list(why) == [0, 40, 60]  # MEETING is frame 40
    assert why[40] == "gone: striker and target collide at 0.8 s"
    assert why[60] == "largest displacement of striker, 0.4 m; end"
    assert [i.frame for i in difference.instants(["striker"], 1, 0, 60)] == [60]
    assert len(difference.instants(["striker"], 12, 0, 60)) == 12


def test_line_in_the_plan_joins_the_two_places_and_measures_them(difference: BranchDifference) -> None:
    view = BranchView(difference, ["striker", "target"])
    drawn, rows = view.draw(difference.instants(["striker"], 1, 60, 60))
    (picture,) = drawn.values()
    assert picture.shape[1] == WIDTH
    (row,) = rows
    (striker,) = row["objects"]  # the target is in the base alone
    frame = plan_frame(
        [(s.world, s.result.trajectory) for s in view.sides], view.camera, view.names, [60], len(picture) - 360
    )
    places = [s.result.trajectory.positions[60, s.result.trajectory.index("striker")] for s in view.sides]
    assert striker["from_base_m"] == pytest.approx(float(np.linalg.norm(places[1] - places[0])), abs=1e-6)
    assert striker["position"] == pytest.approx(places[1].tolist())
    plans = [PlanView(s.world, s.result.trajectory, frame, view.names) for s in view.sides]
    plan = view._plan(plans, [60, 60], row["time"], {"striker": striker["from_base_m"], "target": np.nan})
    ends = [np.array(plans[0].pixel(place)) for place in places]
    between = [np.rint(ends[0] + share * (ends[1] - ends[0])).astype(int) for share in (0.05, 0.5, 0.95)]
    white = near(plan, OBSERVED)
    assert all(white[y - 1 : y + 2, x - 1 : x + 2].any() for x, y in between)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    assert length / frame.pixels_per_metre == pytest.approx(striker["from_base_m"], rel=0.01)
    assert view._label("striker", {"striker": striker["from_base_m"]}) == "striker 0.4 m"


def test_branch_and_base_differ_by_more_than_colour(difference: BranchDifference) -> None:
    """The branch's outline goes round, the base's has gaps: read along the circle of each disc in the plan."""
    view = BranchView(difference, ["striker"])
    frame = plan_frame([(s.world, s.result.trajectory) for s in view.sides], view.camera, ["striker"], [60], 480)
    plans = [PlanView(s.world, s.result.trajectory, frame, ["striker"]) for s in view.sides]
    plan = view._plan(plans, [60, 60], HORIZON, {"striker": 0.4})
    angle = np.linspace(0.0, 2 * np.pi, 90, endpoint=False)
    share = []
    for side, color in zip(view.sides, (BASE, BRANCH), strict=True):
        run = side.result.trajectory
        centre = plans[0].pixel(run.positions[60, run.index("striker")])
        drawn = near(plan, color)
        hits = [
            drawn[
                round(centre[1] + r * np.sin(a)) - 1 : round(centre[1] + r * np.sin(a)) + 2,
                round(centre[0] + r * np.cos(a)),
            ].any()
            for a in angle
            for r in [0.1 * frame.pixels_per_metre]
        ]
        share.append(float(np.mean(hits)))
    assert share[1] > 0.9
    assert 0.3 < share[0] < 0.85


def looked(app: App, world: World, **more: Any) -> Answer:
    identifier, _ = compute_rollout(app, world, HORIZON)
    answer = rollout_pictures.inspect_rollout(app, "discs", rollout=identifier, **more)
    assert isinstance(answer, Answer)
    return answer


def test_tool_shows_a_branch_beside_the_base_that_compare_worlds_compares_it_with(tmp_path: Path) -> None:
    app = App(tmp_path / "store.db")
    base = two_discs()
    case = case_with(app, base, committed=True)
    without = branch(base, [Remove(object="target")])
    app.keep_world(case, without, how="intervention", parent=base, detail={"edits": []})
    answer = looked(app, without, pictures=3)
    assert answer.shown is not None
    assert len(answer.pictures) == len(answer.shown["frames"]) == 3
    assert sum(map(len, answer.pictures.values())) <= ROOM
    assert "0.8 s (gone: striker and target collide at 0.8 s)" in answer.summary
    for time in answer.shown["times"]:
        assert f"{time:.4g} s" in answer.summary
    (striker,) = answer.shown["objects"]
    compared = compare_worlds(app, answer.shown["base"], answer.shown["rollout"])
    assert isinstance(compared, Answer)
    (row,) = [r for r in compared.data["objects"] if r["object"] == "striker"]
    assert max(striker["from_base_m"]) == pytest.approx(row["largest_distance"], abs=1e-9)
    asked = looked(app, without, frames=[10, 50])
    assert [r["frame"] for r in asked.data["frames"]] == [10, 50]
    app.close()
