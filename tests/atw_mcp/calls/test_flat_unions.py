"""Flat schemas against the exact types they stand for."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pydantic import TypeAdapter

from atw_mcp.calls.flat_unions import flat_schema
from polyworld.edits.interventions import Intervention
from polyworld.probing.predicates import Predicate

UNIONS = [(Intervention, "action"), (Predicate, "predicate")]


@pytest.mark.parametrize(("union", "tag"), UNIONS, ids=["edits", "predicates"])
def test_flat_schema_lists_every_field_of_every_form_and_no_other(union: Any, tag: str) -> None:
    forms = get_args(get_args(union)[0])
    schema = flat_schema(union, tag)
    assert set(schema["properties"]) == {field for form in forms for field in form.model_fields}
    assert set(schema["properties"][tag]["enum"]) == {form.model_fields[tag].default for form in forms}


@pytest.mark.parametrize(("union", "tag"), UNIONS, ids=["edits", "predicates"])
def test_flat_schema_names_the_forms_that_have_a_field(union: Any, tag: str) -> None:
    schema = flat_schema(union, tag)
    for form in get_args(get_args(union)[0]):
        for field in form.model_fields:
            if field != tag:
                assert form.model_fields[tag].default in schema["properties"][field]["description"]


def test_examples_that_follow_the_flat_schema_are_accepted() -> None:
    edits = [
        {"action": "remove", "object": "red"},
        {"action": "move", "object": "red", "position": [0, 1, 2]},
        {"action": "environment", "gravity": [0, 0, -1.6]},
        {"action": "add", "object": {"name": "b", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 0]}},
    ]
    assert [edit.action for edit in TypeAdapter(list[Intervention]).validate_python(edits)] == [
        edit["action"] for edit in edits
    ]
