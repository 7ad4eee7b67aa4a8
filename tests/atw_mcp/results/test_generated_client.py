"""A client generated from the schemas of all results reads a whole session, each value with its type."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from datamodel_code_generator import DataModelType, InputFileType, generate
from pydantic import BaseModel, ValidationError

from atw_mcp.results.values import DOCUMENT
from tests.atw_mcp.clips import write_tracks
from tests.atw_mcp.session import Session

FREE = {"JsonDocument": {"type": "object", "additionalProperties": True}, "AnyJson": {}}
"""JSON whose form is given elsewhere: all that may be `Any`."""


class Definitions(dict[str, Any]):
    """Parts that the results of several tools share, by name."""

    def add(self, tool: str, schema: dict[str, Any]) -> dict[str, Any]:
        """Return a tool's schema without its own definitions; of two with one name the second gets the tool's too."""
        own = schema.pop("$defs")
        texts = {name: json.dumps(part, sort_keys=True) for name, part in own.items()}
        clash = {name for name in own if name in self and json.dumps(self[name], sort_keys=True) != texts[name]}
        renamed = {name: f"{tool}{name}" if name in clash else name for name in own}
        self.update({renamed[name]: self._linked(part, renamed) for name, part in own.items()})
        linked: dict[str, Any] = self._linked(schema, renamed)
        return linked

    def _linked(self, schema: Any, renamed: dict[str, str]) -> Any:
        if isinstance(schema, list):
            return [self._linked(part, renamed) for part in schema]
        if not isinstance(schema, dict):
            return schema
        found = {key: self._linked(part, renamed) for key, part in schema.items()}
        if "$ref" in found:
            found["$ref"] = "#/$defs/" + renamed[found["$ref"].removeprefix("#/$defs/")]
        documented = isinstance(found.get("description"), str) and DOCUMENT in found["description"]
        if documented and set(found) <= {"type", "description", "default"}:
            return {"$ref": "#/$defs/" + ("JsonDocument" if found.get("type") == "object" else "AnyJson")}
        return found


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return Session(tmp_path_factory.mktemp("client") / "atw.db")


@pytest.fixture(scope="module")
def source(session: Session) -> str:
    """Python source of a client, from what the server says of the results of each of its tools."""
    definitions = Definitions(FREE)
    results = {}
    for row in session("DescribeTool")["data"]["tools"]:
        described = session("DescribeTool", tool=row["tool"], argument="result")
        assert "shortened" not in described
        results[row["tool"].lower()] = definitions.add(row["tool"], described["data"]["schema"])
    code = generate(
        json.dumps({"title": "Results", "type": "object", "properties": results, "$defs": definitions}),
        input_file_type=InputFileType.JsonSchema,
        output_model_type=DataModelType.PydanticV2BaseModel,
        enum_field_as_literal="all",
        formatters=[],
    )
    assert isinstance(code, str)
    return code


@pytest.fixture(scope="module")
def client(source: str) -> Iterator[ModuleType]:
    module = ModuleType("generated_client")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, module.__name__, module)  # where its models look up each other
        exec(compile(source, "generated_client.py", "exec"), vars(module))
        yield module


def test_nothing_is_of_any_type_but_json_whose_form_is_given_elsewhere(source: str) -> None:
    free = [line for line in source.splitlines() if re.search(r"\b(Any|object)\b(?! *:)", line.partition("Field(")[0])]
    assert [line.strip() for line in free if not line.startswith(("from typing", "#"))] == [
        "class AnyJson(RootModel[Any]):",
        "root: Any",
    ]
    open_ = re.findall(r"class (\w+)\(BaseModel\):\n +model_config = ConfigDict\(\n +extra='allow'", source)
    assert open_ == ["JsonDocument"]


def test_it_reads_a_whole_session(session: Session, client: ModuleType, tmp_path: Path) -> None:
    def read(tool: str, /, **arguments: Any) -> Any:
        result = session(tool, **arguments)
        parsed = client.Results.model_validate({tool.lower(): result})
        again: BaseModel = getattr(parsed, tool.lower())
        assert again.model_dump(mode="json", by_alias=True, exclude_unset=True) == result
        return again

    path = write_tracks(tmp_path / "slide.csv")
    case = read("OpenCase", data=str(path), name="slide", questions=["does it stop?"]).case
    read("ImportObservation", case=case, kind="tracks", path=str(path))
    built = read("BuildWorld", case=case, default_shape={"kind": "sphere", "radius": 0.05})
    read("InspectWorld", case=case, fields=["appearance", "shape", "parameters", "initial_state"])
    read("ReadProperty", case=case, property="friction")
    read("InspectObservedMotion", case=case, object="puck", quantities=["speed", "period"])
    committed = read("CommitWorld", case=case, world=built.source.world).data
    assert committed.objects == ["puck", "ball"]
    first = read("Rollout", case=case, horizon_seconds=1.0)
    assert {row.object for row in first.data.objects} == {"ball", "puck"}
    push = {"action": "set_velocity", "object": "ball", "velocity": [0.0, -1.0, 0.0]}
    pushed = read("Rollout", case=case, horizon_seconds=1.0, edits=[push])
    assert pushed.data.edits[0].velocity == [0.0, -1.0, 0.0]
    base, edited = first.source.rollout, pushed.source.rollout
    read("ReadEvents", rollout=base, floor=True)
    read("ReadTimeline", rollout=base)
    motion = read("ReadTrajectory", rollout=base, object="puck", limit=4).data
    assert motion.motion.path_length > 0.1
    moves = {"predicate": "moving", "object": "puck"}
    assert read("QueryWorld", rollout=base, predicate=moves).data.evidence.extremes.quantity == "speed_m_per_s"
    read("QueryWorld", rollout=base, predicates=[moves, {"predicate": "collides", "a": "puck"}])
    compared = read("CompareWorlds", base=base, edited=edited)
    assert next(row for row in compared.data.objects if row.object == "ball").moves_differently
    read("UpdateBindings", case=case, corrections=[{"name": "it", "track": "puck", "object": "puck"}], reason="seen")
    read("DescribeTool", tool="Rollout")
    read("ReadEvidence", case=case)
    read("ReadEvidence", evidence=compared.evidence, path="objects")
    done = read("Finish", case=case, question="does it stop?", evidence=[compared.evidence], answer="yes").data
    assert done.evidence[0].tool == "CompareWorlds"


def test_it_refuses_what_no_tool_returns(session: Session, client: ModuleType) -> None:
    result = session("DescribeTool")
    result["data"]["tools"][0]["does"] = 3
    with pytest.raises(ValidationError, match="does"):
        client.Results.model_validate({"describetool": result})
