"""What a store holds, by address; and completion of ids and names."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.shared.exceptions import MCPError
from mcp_types import ResourceTemplateReference

from atw_mcp.calls.app import App
from atw_mcp.server import build_server
from evidence_store import Evidence
from tests.atw_mcp.clips import write_clip
from tests.atw_mcp.session import Session
from tests.atw_mcp.two_discs import GAP, case_with, two_discs

CASE = "discs"


@pytest.fixture(scope="module")
def probed(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A store with a committed world, a rollout and pictures of it."""
    folder = tmp_path_factory.mktemp("resources")
    session = Session(folder / "atw.db")
    case_with(App(session.store), two_discs(), committed=True, video=write_clip(folder / "discs.mp4"), name=CASE)
    session("Rollout", case=CASE)
    session("InspectRollout", case=CASE, background="rendered", frames=[0, 30])
    return session


def ask(session: Session, question: Callable[[Client], Any]) -> Any:
    async def answered() -> Any:
        async with Client(session.server) as client:
            return await question(client)

    return anyio.run(answered)


def read(session: Session, address: str) -> Any:
    return ask(session, lambda client: client.read_resource(address)).contents[0]


def parsed(session: Session, address: str) -> Any:
    return json.loads(read(session, address).text)


def test_cases_lead_to_their_worlds_and_results(probed: Session) -> None:
    assert [row["case"] for row in parsed(probed, "atw://cases")["cases"]] == [CASE]
    case = parsed(probed, f"atw://cases/{CASE}")
    assert [row["tool"] for row in case["evidence"]] == ["Rollout", "InspectRollout"]
    world = parsed(probed, f"atw://worlds/{case['committed_world']}")
    assert [thing["name"] for thing in world["objects"]] == ["striker", "target"]
    assert parsed(probed, f"atw://evidence/{case['evidence'][0]['evidence']}")["tool"] == "Rollout"


def test_a_rollout_is_read_as_a_table_and_as_events(probed: Session) -> None:
    result = ask(probed, lambda client: client.call_tool("Rollout", {"case": CASE}))
    link = next(block for block in result.content if block.type == "resource_link")
    rollout = result.structured_content["data"]["rollout"]
    assert link.uri == f"atw://rollouts/{rollout}/trajectory.csv"
    rows = list(csv.DictReader(read(probed, link.uri).text.splitlines()))
    about = parsed(probed, f"atw://rollouts/{rollout}")
    assert len(rows) == 2 * about["samples"]
    last = [row for row in rows if row["object"] == "striker"][-1]
    assert float(last["x"]) == pytest.approx(GAP, abs=0.01)  # stopped by the target
    alone = list(csv.DictReader(read(probed, f"atw://rollouts/{rollout}/target.csv").text.splitlines()))
    assert {row["object"] for row in alone} == {"target"}
    kinds = [event["kind"] for event in parsed(probed, f"atw://rollouts/{rollout}/events")["events"]]
    assert "contact_begin" in kinds


def test_pictures_and_frames_have_their_media_type(probed: Session) -> None:
    evidence = parsed(probed, f"atw://cases/{CASE}")["evidence"][1]["evidence"]
    names = parsed(probed, f"atw://evidence/{evidence}")["pictures"]
    assert len(names) == 2
    picture = read(probed, f"atw://evidence/{evidence}/pictures/{names[0].replace(' ', '%20')}")
    assert (picture.mime_type, picture.blob[:4]) == ("image/jpeg", "/9j/")
    frame = read(probed, f"atw://frames/{CASE}/3")
    assert (frame.mime_type, frame.blob[:4]) == ("image/jpeg", "/9j/")


def test_a_tool_is_read_in_full(probed: Session) -> None:
    tool = parsed(probed, "atw://schema/tools/BuildWorld")
    assert "youngs_modulus" in json.dumps(tool["inputSchema"])
    assert "data" in tool["outputSchema"]["properties"]


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("atw://cases/nowhere", "no case 'nowhere'; cases: ['discs']"),
        ("atw://worlds/world-0", "world-0"),
        ("atw://rollouts/rollout-0/events", "no rollout has the id 'rollout-0'"),
        ("atw://evidence/ev-1/pictures/x.png", "ev-1 has no picture 'x.png'"),
        ("atw://frames/discs/100000", "valid frames are 0.."),
        ("atw://schema/tools/Nothing", "no tool 'Nothing'; tools: OpenCase"),
    ],
)
def test_an_address_of_nothing_says_what_there_is(probed: Session, address: str, says: str) -> None:
    async def refusal(client: Client) -> str:
        with pytest.raises(MCPError) as refused:
            await client.read_resource(address)
        return refused.value.message

    assert says in ask(probed, refusal)


@pytest.mark.parametrize(
    ("template", "argument", "given", "expected"),
    [
        ("atw://cases/{case}", {"name": "case", "value": "di"}, {}, ["discs"]),
        ("atw://evidence/{evidence}", {"name": "evidence", "value": "ev-"}, {}, ["ev-2", "ev-1"]),
        ("atw://rollouts/{rollout}/{object}.csv", {"name": "object", "value": "t"}, {}, ["target"]),
        ("atw://schema/tools/{tool}", {"name": "tool", "value": "Quer"}, {}, ["QueryWorld"]),
        (
            "atw://evidence/{evidence}/pictures/{name}",
            {"name": "name", "value": ""},
            {"evidence": "ev-2"},
            ["frame 0.jpg", "frame 30.jpg"],
        ),
        ("atw://frames/{case}/{frame}", {"name": "case", "value": ""}, {"case": "nowhere"}, ["discs"]),
        ("atw://evidence/{evidence}", {"name": "evidence", "value": ""}, {"case": "nowhere"}, []),
    ],
)
def test_ids_and_names_are_completed(
    tmp_path: Path, template: str, argument: dict[str, str], given: dict[str, str], expected: list[str]
) -> None:
    session = Session(tmp_path / "atw.db")
    app = App(session.store)
    case_with(app, two_discs(), committed=True, name=CASE)
    app.store.evidence.add(Evidence(tool="Rollout", arguments={}, case=CASE, objects=("striker", "target")))
    pictures = {"frame 0.jpg": b"", "frame 30.jpg": b""}
    app.store.evidence.add(Evidence(tool="InspectRollout", arguments={}, case=CASE, pictures=pictures))
    reference = ResourceTemplateReference(uri=template)
    found = ask(session, lambda client: client.complete(reference, argument, context_arguments=given))
    assert found.completion.values == expected


def test_templates_are_listed(tmp_path: Path) -> None:
    async def listed() -> list[str]:
        async with Client(build_server(tmp_path / "atw.db")) as client:
            return [t.uri_template for t in (await client.list_resource_templates()).resource_templates]

    assert {"atw://cases/{case}", "atw://rollouts/{rollout}/events", "atw://frames/{case}/{frame}"} <= set(
        anyio.run(listed)
    )
