"""The experimentation tools on a world whose motion is known exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer
from atw_mcp.tools import experimentation as tools
from atw_mcp.tools import querying, readings
from atw_mcp.worlds.rollouts import KIND, SERIES, content_of, stored_rollout
from evidence_store import Binding
from polyworld.edits.interventions import SetVelocity, branch
from polyworld.solver.rollout import rollout
from polyworld.trajectory import Truncation
from polyworld.world import StaticObject, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Sphere
from tests.atw_mcp.two_discs import FRAME, GAP, MEETING, RADIUS, SPEED, case_with, two_discs

END = 60 * FRAME
ALONE = {"action": "remove", "object": "target"}
THIRD = {
    "name": "third",
    "representation": "rigid_planar",
    "shape": {"kind": "cylinder", "radius": RADIUS, "half_height": 0.05},
    "position": [0.0, 2.0, 0.05],
    "start_time": 0.5,
}


@pytest.fixture
def app(tmp_path: Path) -> App:
    app = App(tmp_path / "atw.db")
    case_with(app, two_discs(), committed=True)
    return app


def done(app: App, tool: str, outcome: Any) -> Answer:
    """The answer of a tool, computed if it is long work, and recorded as the toolbox would."""
    answer = outcome.work(Progress()) if isinstance(outcome, LongWork) else outcome
    assert isinstance(answer, Answer)
    app.store.evidence.add(answer.to_evidence(tool, {}))
    return answer


@pytest.fixture
def roll(app: App) -> Callable[..., Answer]:
    def run(edits: list[dict[str, Any]] | None = None, **arguments: Any) -> Answer:
        return done(app, "Rollout", tools.roll_out(app, "discs", edits=edits, **arguments))

    return run


def ask(app: App, rollout: str, predicate: dict[str, Any], **arguments: Any) -> dict[str, Any]:
    return querying.query_world(app, rollout, predicate, **arguments).data


def test_rollout_reports_the_collision_and_covers_the_observed_stretch(roll: Callable[..., Answer]) -> None:
    answer = roll()
    assert answer.interval == pytest.approx((0.0, END))
    collisions = [row for row in answer.data["timeline"] if row["what"] == "collision"]
    assert [row["objects"] for row in collisions] == [["striker", "target"]]
    assert collisions[0]["time"] == pytest.approx(MEETING, abs=0.004)  # two substeps
    assert collisions[0]["frame"] == pytest.approx(MEETING / FRAME, abs=0.2)
    assert collisions[0]["impulse_Ns"] == pytest.approx(SPEED, rel=0.01)  # equal masses of 1 kg swap velocities
    ends = {row["object"]: row["end"][0] for row in answer.data["objects"]}
    assert ends["striker"] == pytest.approx(GAP, abs=0.005)
    assert ends["target"] == pytest.approx(GAP + 0.2 + SPEED * (END - MEETING), abs=0.005)


def test_removed_object_lets_the_other_pass(app: App, roll: Callable[..., Answer]) -> None:
    branch = roll([{"action": "remove", "object": "target"}])
    assert branch.data["timeline"] == []
    assert branch.data["objects"][0]["end"][0] == pytest.approx(SPEED * END, abs=1e-6)
    assert app.store.worlds.parents(branch.world or "")[0].parent == branch.data["base_world"]


def test_comparison_finds_the_lost_collision_and_the_displacement(app: App, roll: Callable[..., Answer]) -> None:
    base, edited = roll().rollout or "", roll([{"action": "remove", "object": "target"}]).rollout or ""
    data = querying.compare_worlds(app, base, edited).data
    assert [row["objects"] for row in data["events"]["gone"] if row["what"] == "collision"] == [["striker", "target"]]
    assert data["events"]["new"] == []
    (striker,) = data["objects"]
    assert striker["final_distance"] == pytest.approx(SPEED * (END - MEETING), abs=0.005)
    assert striker["apart_from"] == pytest.approx(MEETING + 0.01 / SPEED, abs=0.005)
    assert data["only_in_base"] == ["target"]


def test_branch_can_be_edited_further(roll: Callable[..., Answer]) -> None:
    slow = roll([{"action": "set_velocity", "object": "striker", "velocity": [0.5, 0, 0]}])
    alone = roll([{"action": "remove", "object": "target"}], world=slow.world)
    assert alone.data["objects"][0]["end"][0] == pytest.approx(0.5 * END, abs=1e-6)


def test_query_is_unknown_beyond_the_horizon_and_false_only_within(app: App, roll: Callable[..., Answer]) -> None:
    short = roll(horizon_seconds=0.5).rollout or ""
    collides = {"predicate": "collides", "a": "striker", "b": "target"}
    assert ask(app, short, collides)["verdict"] == "false"
    beyond = ask(app, short, collides, interval=[0.0, 1.0])
    assert beyond["verdict"] == "unknown"
    assert "0.5" in beyond["reason"]
    long = roll(horizon_seconds=1.0).rollout or ""
    assert ask(app, long, collides)["verdict"] == "true"
    assert ask(app, long, collides, aggregation="first")["value"] == pytest.approx(MEETING, abs=0.004)
    roll([{"action": "add", "object": {**THIRD, "name": "ghost"}}])
    absent = ask(app, long, {"predicate": "moving", "object": "ghost"})  # it is only in the branch
    assert absent["verdict"] == "unknown"
    assert "'ghost' is not in this world" in absent["reason"]


def test_query_covers_the_stretch_in_which_a_late_object_takes_part(app: App, roll: Callable[..., Answer]) -> None:
    """The third disc joins 2 m beside the striker's path; when the target is gone, the striker is at x = t then."""
    branch = roll([ALONE, {"action": "add", "object": THIRD}]).rollout or ""
    answer = querying.query_world(app, branch, {"predicate": "collides", "a": "third", "b": "striker"})
    assert answer.data["verdict"] == "false"
    assert answer.data["asked"] == pytest.approx([0.5, END])
    gap = (2.0**2 + 0.5**2) ** 0.5 - 2 * RADIUS
    assert answer.data["evidence"]["closest_approach"]["gap_m"] == pytest.approx(gap, abs=1e-4)
    assert "from when third joins" in answer.summary
    assert f"closest approach of the surfaces {gap:.3g} m at 0.5 s" in answer.summary
    early = ask(app, branch, {"predicate": "collides", "a": "third", "b": "striker"}, interval=[0.0, 1.0])
    assert early["verdict"] == "unknown"
    assert "'third' joins at 0.5 s. Asked over [0.5, 1] it is false" in early["reason"]


def test_an_edit_may_name_what_an_earlier_one_added(roll: Callable[..., Answer]) -> None:
    moved = {"action": "move", "object": "third", "position": [0.0, 3.0, 0.05]}
    branch = roll([{"action": "add", "object": THIRD}, moved])
    assert {row["object"]: row.get("start") for row in branch.data["objects"]}["third"][1] == pytest.approx(3.0)


def test_what_lies_beyond_the_observed_frames_is_reported_first(roll: Callable[..., Answer]) -> None:
    """The target meets a fourth disc, 1.4 m ahead of it, after the 1.2 s that were observed."""
    fourth = {**THIRD, "name": "fourth", "position": [2.4 + 2 * RADIUS, 0.0, 0.05], "start_time": 0.0, "friction": 0}
    summary = roll([{"action": "add", "object": fourth}], horizon_seconds=3.0).summary
    later, observed = summary.index("fourth and target collide at 2.2 s"), summary.index("striker and target collide")
    assert summary.index("after the last observed frame (1.2 s)") < later < summary.index("Before it") < observed


def test_trajectory_is_thinned_and_keeps_its_ends(app: App, roll: Callable[..., Answer]) -> None:
    answer = readings.read_trajectory(app, roll().rollout or "", "striker", limit=5, fields=["frame", "x"])
    assert len(answer.data["rows"]) == 61
    assert answer.shown is not None
    shown = answer.shown["rows"]
    assert [row[0] for row in shown] == [0, 15, 30, 45, 60]
    assert shown[1][1] == pytest.approx(15 * FRAME * SPEED, abs=1e-6)


def test_frames_and_seconds_select_the_same_rows(app: App, roll: Callable[..., Answer]) -> None:
    rollout = roll().rollout or ""
    by_frames = readings.read_trajectory(app, rollout, "target", frames=[10, 20])
    by_seconds = readings.read_trajectory(app, rollout, "target", interval=[10 * FRAME, 20 * FRAME])
    assert by_frames.data == by_seconds.data
    assert len(by_frames.data["rows"]) == 11
    assert by_frames.data["covers"] == {"seconds": pytest.approx([0.2, 0.4]), "frames": [10.0, 20.0]}


def test_events_can_be_chosen_by_participants_and_kind(app: App, roll: Callable[..., Answer]) -> None:
    rollout = roll().rollout or ""
    events = readings.read_events(app, rollout, ["striker", "target"], together=True, kinds=["contact_begin"]).data
    assert events["of"] == 1
    assert events["events"][0]["approach_speed"] == pytest.approx(SPEED, rel=0.01)
    page = readings.read_events(app, rollout, limit=1).data
    assert page["next_cursor"] == 1
    assert page["of"] > 1


def test_bound_name_stands_for_its_object(app: App, roll: Callable[..., Answer]) -> None:
    app.store.cases.bind("discs", Binding("the left puck", None, "striker", "it is on the left"))
    rollout = roll().rollout or ""
    assert readings.read_trajectory(app, rollout, "the left puck").objects == ("striker",)
    assert ask(app, rollout, {"predicate": "collides", "a": "the left puck", "b": "Target"})["verdict"] == "true"
    assert roll([{"action": "remove", "object": "the left puck"}]).objects == ("target",)


def test_nothing_is_known_after_a_divergence(app: App) -> None:
    world = two_discs()
    whole = rollout(world, END)
    cut = {name: getattr(whole.trajectory, name)[:11] for name in SERIES}
    document = {
        "world": world.id,
        "horizon": END,
        "names": ["striker", "target"],
        "events": [],
        "status": "diverged",
        "diverged_time": 10.5 * FRAME,
        "diverged_object": "target",
    }
    identifier = app.store.rollouts.put(KIND, {"world": world.id, "horizon": END, "engine": "test"}, document, cut).id
    collides = {"predicate": "collides", "a": "striker", "b": "target"}
    assert ask(app, identifier, collides)["verdict"] == "unknown"
    assert ask(app, identifier, collides, interval=[0.0, 0.1])["verdict"] == "false"
    timeline = readings.read_timeline(app, identifier)
    assert timeline.status == "diverged"
    assert "nothing after that is known" in timeline.summary
    assert timeline.interval == pytest.approx((0.0, 10 * FRAME))
    with pytest.raises(ToolError, match="reaches outside"):
        readings.read_trajectory(app, identifier, "striker", interval=[0.0, 1.0])


def test_objects_moved_into_each_other_are_warned_of(roll: Callable[..., Answer]) -> None:
    """The discs' centres are set one radius apart."""
    place = [*two_discs().object("striker").position]
    moved = roll([{"action": "move", "object": "target", "position": [place[0] + RADIUS, *place[1:]]}])
    assert f"'striker' and 'target' overlap by {RADIUS:.3g} m at 0 s" in moved.summary
    assert "Warning" not in roll().summary


def test_a_truncated_rollout_says_why_and_nothing_is_known_after_it(app: App) -> None:
    world = two_discs()
    whole = rollout(world, END)
    kept = {name: getattr(whole.trajectory, name)[:31] for name in SERIES}
    ended = replace(
        whole,
        trajectory=replace(whole.trajectory, **kept),
        status="truncated",
        truncated=Truncation(30.5 * FRAME, "no room"),
        contacts_until=10.5 * FRAME,
    )
    identifier = app.store.rollouts.put(KIND, {"world": world.id, "horizon": END, "engine": "t"}, *content_of(ended)).id
    assert stored_rollout(app, identifier)[2].truncated == ended.truncated
    timeline = readings.read_timeline(app, identifier)
    assert timeline.status == "diverged"  # of evidence: what it shows ends before its horizon
    assert "truncated at 0.61 s: no room: nothing after that is known" in timeline.summary
    assert "recorded up to 0.21 s only" in timeline.summary
    collides = {"predicate": "collides", "a": "striker", "b": "target"}
    assert ask(app, identifier, collides, interval=[0.0, 0.1])["verdict"] == "false"
    assert ask(app, identifier, collides, interval=[0.0, 0.5])["verdict"] == "unknown"


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda app, r: readings.read_events(app, r, ["strker"]), "did you mean 'striker'"),
        (lambda app, r: readings.read_events(app, r, []), "objects is empty"),
        (
            lambda app, r: readings.read_timeline(app, r, interval=[0.5, 9.0]),
            r"0 to 1.2 s \(frames 0 to 60\).*Next: Rollout",
        ),
        (lambda app, r: readings.read_timeline(app, r, interval=[0.5, 0.1]), "start <= end"),
        (lambda app, r: readings.read_timeline(app, r, interval=[0, 1], frames=[0, 1]), "not both"),
        (lambda app, _: readings.read_trajectory(app, "rollout-0000", "striker"), "Next: Rollout"),
        (lambda app, _: tools.roll_out(app, "discs", horizon_seconds=1e9), "at most 400 s"),
        (lambda app, _: tools.roll_out(app, "discs", horizon_seconds=1.0, horizon_frames=5), "not both"),
        (lambda app, _: tools.roll_out(app, "discs", world="world-0"), "its worlds"),
        (lambda app, _: tools.roll_out(app, "disks"), "no case 'disks'"),
        (
            lambda app, _: tools.roll_out(app, "discs", edits=[{"action": "remove", "object": "x"}]),
            r"objects: \['striker', 'target'\]",
        ),
        (
            lambda app, _: tools.roll_out(
                app, "discs", edits=[ALONE, {"action": "set_parameter", "path": "objects.striker.fricton", "value": 0}]
            ),
            r"edit 2 \(set_parameter\): .*did you mean 'objects.striker.friction'.*InspectWorld\(case='discs'",
        ),
        (
            lambda app, _: tools.roll_out(
                app, "discs", edits=[{"action": "move", "object": "strikr", "position": [0, 0, 0]}]
            ),
            "did you mean 'striker'",
        ),
        (lambda app, r: querying.compare_worlds(app, r, r, ["ghost"]), "no object 'ghost'"),
        (
            lambda app, r: querying.query_world(app, r, {"predicate": "collide", "a": "target"}),
            r"no predicate 'collide' \(did you mean 'collides'\?\); there are .*nearer_than",
        ),
        (
            lambda app, r: querying.query_world(app, r, {"predicate": "collides", "object": "target"}),
            r"collides takes a, \[b\]; not object",
        ),
        (lambda app, r: querying.query_world(app, r, "collides"), r'for example \{"predicate": "collides", "a"'),
        (lambda app, r: querying.query_world(app, r, {"a": "target"}), "needs 'predicate', one of in_contact"),
        (
            lambda app, r: querying.query_world(app, r, {"predicate": "moving", "object": "targte"}),
            "did you mean 'target'",
        ),
        (
            lambda app, r: querying.query_world(app, r, {"predicate": "moving", "object": "target", "speed": "fast"}),
            "predicate: moving: speed: .*got 'fast'",
        ),
        (
            lambda app, r: querying.query_world(app, r, {"predicate": "moving", "object": "big disc"}),
            "no object 'big disc'",
        ),
        (
            lambda app, _: tools.roll_out(app, "discs", edits=[{"action": "remove"}]),
            r"edit 1: remove takes object, \[part\]; object is missing",
        ),
    ],
)
def test_refusals_name_the_valid_choices(
    app: App, roll: Callable[..., Answer], call: Callable[[App, str], Any], complaint: str
) -> None:
    with pytest.raises(ToolError, match=complaint):
        call(app, roll().rollout or "")


def test_probing_is_refused_before_commit(tmp_path: Path) -> None:
    app = App(tmp_path / "draft.db")
    case_with(app, two_discs(), committed=False)
    with pytest.raises(ToolError, match="Next: CommitWorld"):
        tools.roll_out(app, "discs")
    first = two_discs()
    later = branch(first, [SetVelocity(object="striker", velocity=(2.0, 0.0, 0.0))])
    app.keep_world(app.case("discs"), later, how="built")
    with pytest.raises(ToolError, match=f"Next: CommitWorld.*world='{first.id}'"):
        tools.roll_out(app, "discs", world=first.id)


def test_finer_samples_make_another_rollout_that_judges_thresholds_finer(app: App, roll: Callable[..., Answer]) -> None:
    coarse, fine = roll(), roll(sample_seconds=FRAME / 10)
    assert coarse.rollout != fine.rollout
    assert coarse.rollout == roll(sample_seconds=FRAME).rollout
    moves = {"predicate": "moving", "object": "target", "speed": 0.9 * SPEED}
    rough, sharp = (ask(app, str(r.rollout), moves, aggregation="first") for r in (coarse, fine))
    assert rough["sampled_every_s"] == pytest.approx(FRAME)
    assert sharp["sampled_every_s"] == pytest.approx(FRAME / 10)
    assert sharp["verdict"] == pytest.approx(MEETING, abs=FRAME / 10 + 0.004)
    assert "sampled_every_s" not in ask(
        app, str(fine.rollout), {"predicate": "collides", "a": "striker", "b": "target"}
    )
    assert roll(sample_seconds=FRAME * (1.0 + 4e-7)).rollout  # a frame, written with six digits
    with pytest.raises(ToolError, match="sample_seconds must be above 0 and at most a frame"):
        roll(sample_seconds=2 * FRAME)


def test_landing_is_new_where_the_base_stands(tmp_path: Path) -> None:
    """A ball that stands on the floor, against one dropped from 0.2 m: it lands at sqrt(2 h / g) with sqrt(2 g h)."""
    app = App(tmp_path / "atw.db")
    ball = RigidObject(name="ball", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.1), restitution=0.0)
    case_with(app, World(objects=(ball,), statics=(StaticObject(name="floor", shape=Plane()),)), committed=True)
    dropped = {"action": "move", "object": "ball", "position": [0.0, 0.0, 0.3]}
    stands, lands = (
        done(app, "Rollout", tools.roll_out(app, "discs", edits=edits, horizon_seconds=0.5))
        for edits in ([], [dropped])
    )
    assert stands.data["timeline"] == []
    assert not stands.data["floor_contacts_included"]
    at_rest, landed = (readings.read_events(app, str(made.rollout)) for made in (stands, lands))
    assert at_rest.data["events"] == []
    assert "0 events" in at_rest.summary
    assert "without slow touches of the floor (floor=true)" in at_rest.summary
    assert landed.data["events"][0]["objects"] == ["ball", "floor"]
    (landing,) = (row for row in lands.data["timeline"] if row["what"] == "collision")
    assert landing["time"] == pytest.approx((2 * 0.2 / 9.81) ** 0.5, abs=0.01)
    assert landing["approach_speed"] == pytest.approx((2 * 0.2 * 9.81) ** 0.5, rel=0.02)
    compared = querying.compare_worlds(app, str(stands.rollout), str(lands.rollout))
    assert ["ball", "floor"] in [row["objects"] for row in compared.data["events"]["new"]]
    assert "ball and floor collide" in compared.summary
