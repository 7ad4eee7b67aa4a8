"""The full declarations of the tools: as agreed, as clients need them, and as an agent can read them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from atw_mcp.worlds.parts import part_kinds, part_schema
from tests.atw_mcp.tools.contract_snapshots import FOLDER, full_contracts

CONTRACTS = full_contracts()
NAMES = {
    "OpenCase", "ObserveObjects", "ImportObservation", "CalibrateCamera", "BuildWorld", "FitWorld", "CommitWorld",
    "ModelVideo", "RunModel",
    "FindDiscrepancy", "ProposeEffects", "AddEffect",
    "InspectWorld", "ReadProperty", "InspectFrames", "InspectObservedMotion", "InspectRollout",
    "Ask", "Rollout", "ReadEvents", "ReadTrajectory", "ReadTimeline", "QueryWorld", "CompareWorlds",
    "DescribeTool", "CallTool", "CancelWork", "ReadEvidence", "UpdateBindings", "Finish",
}  # fmt: skip
PICTURES = {"InspectFrames", "InspectRollout", "CallTool", "CancelWork", "ReadEvidence", "FindDiscrepancy", "AddEffect"}


def parts(schema: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every object inside a schema with its path."""
    if isinstance(schema, dict):
        yield path, schema
        for key, value in schema.items():
            yield from parts(value, f"{path}/{key}")
    elif isinstance(schema, list):
        for index, value in enumerate(schema):
            yield from parts(value, f"{path}/{index}")


def test_the_tools_are_those_of_the_design() -> None:
    assert set(CONTRACTS) == NAMES


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_contract_is_as_agreed(name: str) -> None:
    agreed = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert CONTRACTS[name] == agreed, "changed on purpose? uv run python -m tests.atw_mcp.tools.contract_snapshots"


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_schemas_use_only_what_every_client_understands(name: str) -> None:
    for key in ("inputSchema", "outputSchema"):
        for path, part in parts(CONTRACTS[name].get(key, {})):
            if path.endswith("/properties"):
                continue
            assert not {"$ref", "$defs", "prefixItems"} & set(part), f"{name} {key}{path}"
            if "properties" in part:
                assert part.get("additionalProperties") is False, f"{name} {key}{path}"


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_every_argument_is_typed_bounded_and_described(name: str) -> None:
    contract = CONTRACTS[name]
    assert len(contract["description"]) > 60
    for argument, schema in contract["inputSchema"]["properties"].items():
        assert schema.get("description"), f"{name}.{argument} has no description"
        for path, part in parts(schema):
            kind = part.get("type")
            if path.endswith(("/properties", "/default")):
                continue
            if kind == "array":
                assert "maxItems" in part, f"{name}.{argument}{path}: a list without a bound"
                assert part["items"], f"{name}.{argument}{path}: a list of anything"
            if kind == "integer":
                assert {"minimum", "exclusiveMinimum"} & set(part), (
                    f"{name}.{argument}{path}: an integer without bounds"
                )


def undescribed(schema: Any, path: str) -> Iterator[str]:
    """Fields of a schema, at any depth, that have no description."""
    if isinstance(schema, list):
        for part in schema:
            yield from undescribed(part, path)
    elif isinstance(schema, dict):
        for name, part in schema.get("properties", {}).items():
            if not part.get("description") and "const" not in part:
                yield f"{path}.{name}"
            yield from undescribed(part, f"{path}.{name}")
        for key in ("items", "anyOf", "oneOf"):
            yield from undescribed(schema.get(key), path)


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_every_field_of_the_arguments_is_described(name: str) -> None:
    assert list(undescribed(CONTRACTS[name]["inputSchema"], name)) == []


@pytest.mark.parametrize("kind", sorted(part_kinds()))
def test_every_field_of_a_part_is_described(kind: str) -> None:
    assert list(undescribed(part_schema(kind), kind)) == []


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_names_and_annotations_suit_clients(name: str) -> None:
    contract = CONTRACTS[name]
    assert len(f"mcp__asking-the-world__{name}") <= 60
    assert contract["title"]
    assert contract["annotations"]["destructiveHint"] is False
    assert ("outputSchema" in contract) == (name not in PICTURES)
