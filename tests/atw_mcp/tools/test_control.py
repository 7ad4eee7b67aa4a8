"""Tools about tools, evidence and names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import anyio
import pytest
from jsonschema import Draft202012Validator
from mcp import Client

from atw_mcp.calls.results import ROOM
from tests.atw_mcp.clips import write_clip, write_tracks
from tests.atw_mcp.session import Session


@pytest.fixture
def case(session: Session, tmp_path: Path) -> str:
    path = write_tracks(tmp_path / "slide.csv")
    name: str = session("OpenCase", data=str(path), name="slide", questions=["does it stop?"])["case"]
    session("ImportObservation", case=name, kind="tracks", path=str(path))
    session("BuildWorld", case=name, default_shape={"kind": "sphere", "radius": 0.05})
    return name


def test_describe_tool_covers_every_tool_and_argument(session: Session) -> None:
    names = [row["tool"] for row in session("DescribeTool")["data"]["tools"]]
    assert {"OpenCase", "BuildWorld", "Rollout", "Finish"} <= set(names)
    for name in names:
        described = session("DescribeTool", tool=name)["data"]
        assert described["description"]
        assert described["stage"]
        assert all(line["type"] and line["description"] for line in described["arguments"])
    required = {
        line["argument"] for line in session("DescribeTool", tool="FitWorld")["data"]["arguments"] if line["required"]
    }
    assert required == {"case"}
    schema = session("DescribeTool", tool="BuildWorld", argument="world")["data"]["schema"]
    motor = session("DescribeTool", tool="BuildWorld", argument="parts.hinge.motor")["data"]
    assert "right-hand rule" in motor["about"]
    assert [line["argument"] for line in motor["fields"]][:2] == ["target_speed", "limit"]
    assert "objects" in schema["properties"]
    assert "$ref" not in json.dumps(schema)


def test_evidence_reads_again_exactly_and_in_parts(session: Session, case: str) -> None:
    built = session("ReadEvidence", case=case)["data"]["records"]
    assert [row["tool"] for row in built] == ["BuildWorld", "ImportObservation", "OpenCase"]
    first = session("OpenCase", case=case)
    assert session("ReadEvidence", evidence=first["evidence"]) == first
    page = session("ReadEvidence", evidence=built[0]["evidence"], path="objects", limit=1)
    assert (len(page["data"]["value"]), page["data"]["next_cursor"], page["data"]["of"]) == (1, 1, 2)
    rest = session("ReadEvidence", evidence=built[0]["evidence"], path="objects", cursor=1)
    assert rest["data"]["next_cursor"] is None
    assert {page["data"]["value"][0]["name"], rest["data"]["value"][0]["name"]} == {"puck", "ball"}


def test_a_long_result_is_cut_and_its_whole_is_linked(session: Session, tmp_path: Path) -> None:
    path = tmp_path / "crowd.csv"
    rows = [f"{frame},{frame * 0.04},ball_{n:03d},{n},0,0.1" for n in range(400) for frame in (0, 1)]
    path.write_text("frame,t,object,x,y,z\n" + "\n".join(rows) + "\n")
    case = session("OpenCase", data=str(path))["case"]
    result = session.shown("ImportObservation", case=case, kind="tracks", path=str(path))
    assert len(json.dumps(result, separators=(",", ":"))) <= 1.2 * ROOM
    cut = next(entry for entry in result["shortened"] if entry["path"] == "objects")
    assert cut["shown"] < cut["of"] == 400
    full = session("ReadEvidence", evidence=result["evidence"], detail="full")
    assert len(full["data"]["objects"]) > 3 * cut["shown"]
    rest = session("ReadEvidence", evidence=result["evidence"], path="objects", fields=["name"], cursor=cut["shown"])
    assert rest["data"]["value"][0] == {"name": f"ball_{cut['shown']:03d}"}
    assert rest["data"]["next_cursor"] == cut["shown"] + len(rest["data"]["value"]) < 400
    assert "fields: name" in session.refused(
        "ReadEvidence", evidence=result["evidence"], path="objects", fields=["colour"]
    )

    async def whole() -> str:
        async with Client(session.server) as client:
            return str((await client.read_resource(result["resource"])).contents[0].text)

    assert len(json.loads(anyio.run(whole))["data"]["objects"]) == 400


def test_the_evidence_of_a_case_is_searched(session: Session, case: str) -> None:
    def found(**asked: Any) -> list[str]:
        return [row["tool"] for row in session("ReadEvidence", case=case, **asked)["data"]["records"]]

    assert found(tool="BuildWorld") == ["BuildWorld"]
    assert found(object="puck") == ["BuildWorld", "ImportObservation"]
    assert found(object="nothing") == []
    assert found(text="does it stop") == ["OpenCase"]
    assert found(interval=[1e6, 2e6]) == []
    first = session("ReadEvidence", case=case, limit=2)["data"]
    rest = session("ReadEvidence", case=case, limit=2, cursor=first["next_cursor"])["data"]
    assert [row["tool"] for row in rest["records"]] == ["OpenCase"]
    assert rest["next_cursor"] is None
    assert "leave evidence out" in session.refused("ReadEvidence", evidence="ev-1", text="stop")
    assert "start <= end" in session.refused("ReadEvidence", case=case, interval=[2, 1])


def test_bindings_are_corrected_and_kept(session: Session, case: str) -> None:
    first = [{"name": "the grey thing", "track": "ball", "object": "ball"}]
    session("UpdateBindings", case=case, corrections=first, reason="the only one at rest")
    second = [{"name": "the grey thing", "track": "puck", "object": "puck"}]
    result = session("UpdateBindings", case=case, corrections=second, reason="it moves after all")
    assert [(b["name"], b["track"], b["reason"]) for b in result["data"]["bindings"]] == [
        ("the grey thing", "puck", "it moves after all")
    ]
    assert session("OpenCase", case=case)["data"]["bindings"][0]["object"] == "puck"


def test_evidence_may_be_asked_for_with_its_own_case_only(session: Session, case: str) -> None:
    evidence = session("ReadEvidence", case=case)["data"]["records"][0]["evidence"]
    assert session("ReadEvidence", case=case, evidence=evidence) == session("ReadEvidence", evidence=evidence)
    foreign = session("OpenCase", data=session("OpenCase", case=case)["data"]["path"], name="other")["case"]
    assert "belongs to case 'slide', not to 'other'" in session.refused("ReadEvidence", case=foreign, evidence=evidence)


def test_an_argument_in_the_wrong_number_is_named_rightly(session: Session, case: str) -> None:
    assert "did you mean 'objects'" in session.refused("ReadProperty", case=case, property="mass", object="ball")
    assert "did you mean 'object'" in session.refused("ReadTrajectory", rollout="rollout-0", objects=["ball"])


def test_an_answer_is_kept_with_the_evidence_it_rests_on(session: Session, case: str) -> None:
    opened = session("OpenCase", case=case)
    done = session("Finish", case=case, question="does it stop?", answer="yes", evidence=[opened["evidence"]],
                   confidence=0.75)  # fmt: skip
    assert done["data"]["evidence"][0]["tool"] == "OpenCase"
    kept = session("OpenCase", case=case)["data"]["answers"]
    assert kept == [
        {
            "question": "does it stop?",
            "answer": "yes",
            "confidence": 0.75,
            "evidence": [opened["evidence"]],
            "missing": "",
        }
    ]


def test_an_answer_may_be_json(session: Session, case: str) -> None:
    """The text of an object stays text."""
    evidence = session("OpenCase", case=case)["evidence"]
    text = '{"p1": "no", "n1": [-2.43, -0.55]}'
    done = session("Finish", case=case, question="both", evidence=[evidence], answer=text)
    assert done["data"]["answer"] == text


def test_a_committed_file_can_be_opened_afresh_under_another_name(session: Session, tmp_path: Path) -> None:
    clip = str(write_clip(tmp_path / "discs.mp4"))
    first = session("OpenCase", video=clip)["case"]
    assert session("OpenCase", video=clip)["case"] == first
    second = session("OpenCase", video=clip, name="again")["case"]
    assert second == "again" != first
    listed = [row["case"] for row in session("OpenCase")["data"]["cases"]]
    assert listed == [first, "again"]


def test_the_schema_of_a_tools_results_is_shown_in_full(session: Session, case: str) -> None:
    shown = session("DescribeTool", tool="InspectWorld", argument="result")
    assert "shortened" not in shown
    schema = shown["data"]["schema"]
    joint = schema["properties"]["data"]["properties"]["joints"]["items"]
    assert joint["required"] == ["name", "object", "anchor", "kind"]
    Draft202012Validator(schema).validate(session("InspectWorld", case=case))
    with_pictures = session("DescribeTool", tool="InspectFrames", argument="result")["data"]["schema"]
    assert {"PlainFrames", "OutlinedFrames", "Unfinished"} <= set(with_pictures["$defs"])
