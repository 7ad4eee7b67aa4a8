"""ModelVideo: one call from a video and what is known to a fitted world, each step addressable and correctable."""

from __future__ import annotations

import json
from typing import Any

import anyio
import pytest
from mcp import Client

from tests.atw_mcp.clips import FRAMES, write_clip
from tests.atw_mcp.session import Session
from tests.real_data import FOLDER, needs

BALL = {"kind": "sphere", "radius": 0.09}  # 9 px at 100 px a metre
LENGTH = {"first_pixel": [20, 60], "second_pixel": [120, 60], "length": 1.0, "view": "top"}
QUICK = {"method": "least_squares"}
PLANAR = {"representation": "planar"}  # else a spatial world is fitted beside it
PAIR = [{"name": "left", "color": "red", "shape": BALL, "mass": 1.0}, {"name": "right", "color": "blue", "shape": BALL}]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_clip(tmp_path_factory.mktemp("clip") / "discs.mp4"))


def modelled(session: Session, **arguments: Any) -> dict[str, Any]:
    return session("ModelVideo", **{"known_length": LENGTH, "fit": QUICK, "patience_seconds": 300, **arguments})


@pytest.fixture(scope="module")
def discs(clip: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, dict[str, Any]]:
    """A session in which two discs that collide were modelled, and the result."""
    session = Session(tmp_path_factory.mktemp("discs") / "atw.db")
    return session, modelled(session, video=clip, objects=PAIR, seconds_per_frame=0.05)


def test_a_video_becomes_a_committed_world_and_an_answer_in_four_calls(discs: tuple[Session, dict[str, Any]]) -> None:
    session, made = discs
    case, data = made["case"], made["data"]
    assert data["found_by_colour_and_size"] == ["left", "right"]
    assert data["verdict"] in ("good", "doubtful")
    assert {row["object"] for row in data["errors"]} == {"left", "right"}
    assert all(row["error_px"] < 1.5 and row["error_over_radius"] < 0.2 for row in data["errors"])
    friction = next(row for row in data["values"] if row["name"].startswith("friction"))
    assert friction["interval80"][0] <= friction["value"] <= friction["interval80"][1]
    assert friction["prior80"][0] < friction["prior80"][1]
    assert "product" in data["contacts"]
    assert not any(
        doubt.startswith("draft ") for doubt in data["doubts"]
    )  # its own other world was passed over on purpose
    assert {body["object"] for body in data["prediction"]["bodies"]} == {"left", "right"}
    assert f"CommitWorld(case={case!r}, world={data['world']!r})" in data["next"]
    spins = session("ReadProperty", case=case, world=data["world"], property="angular_velocity")["data"]["values"]
    assert [row["known"] for row in spins] == ["assumed", "assumed"]  # plain discs show no turning
    session("CommitWorld", case=case, world=data["world"])
    rolled = session("Rollout", case=case, horizon_frames=FRAMES + 10)
    asked = {"predicate": "collides", "a": "left", "b": "right"}
    assert session("QueryWorld", rollout=rolled["data"]["rollout"], predicate=asked)["data"]["verdict"] == "true"


def test_each_step_is_evidence_of_its_own_tool_and_known_values_are_not_fitted(
    discs: tuple[Session, dict[str, Any]],
) -> None:
    session, made = discs
    tools = []
    for step in made["data"]["steps"]:
        record = session("ReadEvidence", evidence=step["evidence"])
        assert (record["tool"], record["status"]) == (step["tool"], "completed")
        tools.append(step["tool"])
    assert tools == ["CalibrateCamera", "ObserveObjects", "BuildWorld", "FitWorld", "BuildWorld", "FitWorld"]
    steps = made["data"]["steps"]  # balls may roll: a spatial world and a planar one are fitted, and one of them kept
    kept = next(i for i in (3, 5) if session("ReadEvidence", evidence=steps[i]["evidence"])["source"]["world"]
                == made["data"]["world"])  # fmt: skip
    built, fitted = steps[kept - 1], steps[kept]
    assert built["arguments"]["seconds_per_frame"] == 0.05
    assert {"paths": ["objects.left.mass"], "fixed": True} in fitted["arguments"]["parameters"]
    # The same call by hand gives the same world: there is no second path.
    again = session("BuildWorld", case=made["case"], **built["arguments"])
    assert again["source"]["world"] == fitted["arguments"]["world"]
    refit = session("FitWorld", case=made["case"], **fitted["arguments"])
    assert (refit["data"]["world"], refit["data"]["computed_now"]) == (made["data"]["world"], False)


def test_a_video_of_which_no_object_is_known_is_modelled_as_observed(session: Session, clip: str) -> None:
    made = modelled(session, video=clip, build=PLANAR)
    assert set(made["objects"]) == {"red_sphere", "blue_sphere"}
    assert not any("could not be looked for" in doubt for doubt in made["data"]["doubts"])


def test_what_is_not_listed_is_left_out_or_modelled_and_said(session: Session, clip: str) -> None:
    made = modelled(session, video=clip, build=PLANAR,
                    objects=[PAIR[0], {"name": "ghost", "color": "green", "shape": BALL}])  # fmt: skip
    assert made["data"]["unseen_objects"] == ["ghost"]
    (row,) = made["data"]["unlisted_tracks"]
    assert (row["track"], row["moves"]) == ("blue_sphere", True)
    assert made["objects"] == ["left"]
    both = modelled(session, case=made["case"], objects=[PAIR[0]], unlisted="model", build=PLANAR)
    assert set(both["objects"]) == {"left", "blue_sphere"}


def test_a_failed_step_is_named_with_its_cure_and_the_next_call_goes_on(session: Session, clip: str) -> None:
    asked = {"video": clip, "objects": PAIR, "known_length": LENGTH, "build": PLANAR, "patience_seconds": 300}
    wrong = {**QUICK, "parameters": [{"paths": ["objects.nobody.mass"], "lower": 1, "upper": 2}]}
    failed = session._call("ModelVideo", {**asked, "fit": wrong})
    text = failed.content[0].text
    assert failed.is_error
    for part in ("stopped at FitWorld", "nobody", "Done and kept: ", "ObserveObjects ev-", "BuildWorld ev-"):
        assert part in text
    (case,) = (row[0] for row in session.store_rows("SELECT id FROM cases"))
    record = session("ReadEvidence", evidence=text.rsplit("(evidence ", 1)[1].rstrip(")"))
    assert (record["status"], record["data"]["failed_step"]) == ("failed", "FitWorld")
    made = session("ModelVideo", case=case, objects=PAIR, build=PLANAR, fit=QUICK, patience_seconds=300)
    assert [step["tool"] for step in made["data"]["steps"]][:2] == ["BuildWorld", "FitWorld"]


def test_a_next_call_keeps_what_was_known(discs: tuple[Session, dict[str, Any]]) -> None:
    session, first = discs
    case = first["case"]
    assert "kept" not in first["data"] or first["data"]["kept"] is None
    again = session("ModelVideo", case=case, build=PLANAR, fit=QUICK, patience_seconds=300)
    same = session("ModelVideo", case=case, fit=QUICK, patience_seconds=300)  # also over a call that kept them itself
    for made in (again, same):
        assert "objects as in ev-" in made["data"]["kept"]
        assert "seconds_per_frame as in ev-" in made["data"]["kept"]
        mass = session("ReadProperty", case=case, world=made["data"]["world"], property="mass", objects=["left"])
        assert "left 1 kg" in mass["summary"]  # not that of its size and an assumed density
        assert made["interval"][1] == pytest.approx(0.05 * (FRAMES - 1))
    assert "build as in" in same["data"]["kept"]
    assert same["data"]["world"] == again["data"]["world"]


def test_what_can_be_refused_is_refused_before_anything_is_observed(session: Session, clip: str) -> None:
    assert "one of video=PATH and case=ID" in session.refused("ModelVideo", objects=PAIR)
    case = session("OpenCase", video=clip)["case"]
    assert "points, known_length or calibrate" in session.refused("ModelVideo", case=case, objects=PAIR)
    camera = {"case": case, "known_length": LENGTH}
    text = session.refused("ModelVideo", **camera, build={"wals": []})
    assert "BuildWorld has no argument 'wals' (did you mean 'walls'?)" in text
    text = session.refused("ModelVideo", **camera, floor=0.1, build={"floor": 0.2})
    assert "floor of build is an argument of ModelVideo itself" in text
    assert "same name" in session.refused("ModelVideo", **camera, objects=[PAIR[0], PAIR[0]])


def test_cancelling_it_cancels_the_step_that_runs_and_keeps_those_before(session: Session, clip: str) -> None:
    endless = {"method": "cem", "generations": 2000, "population": 512}
    asked = {"video": clip, "objects": PAIR, "known_length": LENGTH, "fit": endless, "patience_seconds": 0}

    async def cancel() -> list[dict[str, Any]]:
        async with Client(session.server) as client:  # one connection: a server that loses its client stops its work

            async def call(tool: str, **arguments: Any) -> dict[str, Any]:
                body: dict[str, Any] = json.loads((await client.call_tool(tool, arguments)).content[0].text)
                return body

            running = await call("ModelVideo", **asked)
            assert running["status"] == "running"
            with anyio.fail_after(60):
                tools: set[str] = set()
                while "FitWorld" not in tools:
                    await anyio.sleep(0.1)
                    tools = {
                        row["tool"] for row in (await call("ReadEvidence", case=running["case"]))["data"]["records"]
                    }
                await call("CancelWork", evidence=running["evidence"])
                while (await call("ReadEvidence", evidence=running["evidence"]))["status"] == "running":
                    await anyio.sleep(0.1)
            rows: list[dict[str, Any]] = (await call("ReadEvidence", case=running["case"]))["data"]["records"]
            return rows

    status = {row["tool"]: row["status"] for row in anyio.run(cancel)}
    assert (status["ModelVideo"], status["FitWorld"]) == ("cancelled", "cancelled")
    assert status["BuildWorld"] == status["ObserveObjects"] == "completed"


@pytest.mark.benchmark
@needs("clevrer")
def test_a_clevrer_video_is_modelled_with_its_objects_distinguished(session: Session) -> None:
    folder = FOLDER / "clevrer"
    kinds = {"sphere": {"kind": "sphere", "radius": 0.2}, "cube": {"kind": "box", "half_extents": [0.2, 0.2, 0.2]}}
    kinds["cylinder"] = {"kind": "cylinder", "radius": 0.2, "half_height": 0.2}
    listed = json.loads((folder / "annotation_00000.json").read_text())["object_property"]
    objects = [
        {
            "name": f"thing_{item['object_id']}",
            "shape": kinds[item["shape"]],
            "color": item["color"],
            "material": item["material"],
        }
        for item in listed
    ]
    plane = json.loads((folder / "camera_homography_z0.2.json").read_text())
    made = modelled(
        session,
        video=str(folder / "video_00000.mp4"),
        objects=objects,
        seconds_per_frame=0.028,
        calibrate={"homography": plane["H"], "plane_z": 0.2},
        known_length=None,
        build=PLANAR,  # which object is which is asked here; in space the fit takes minutes
        fit={"last_frame": 50},
    )
    tracks = {match["object"]: match["track"] for match in made["data"]["matches"]}
    assert len(tracks) == len(listed)
    for item in listed:
        track = tracks[f"thing_{item['object_id']}"]
        assert track.startswith(item["color"])
        assert item["color"] != "blue" or item["material"] in track  # two blue balls, one metal, one rubber
    assert made["data"]["verdict"] != "poor"
