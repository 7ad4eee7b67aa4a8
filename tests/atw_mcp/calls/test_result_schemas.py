"""Output schemas: made from models, and right for results that are shown with lists cut."""

from __future__ import annotations

from typing import Annotated

from jsonschema import Draft202012Validator
from pydantic import Field

from atw_mcp.calls.result_schemas import result_schema
from atw_mcp.calls.results import Answer, to_result
from atw_mcp.results.base import Result


class Point(Result):
    place: Annotated[list[float], Field(min_length=3, max_length=3)]
    minimum: float = Field(ge=0.0, description="a field with the name of a keyword")


class Path(Result):
    points: list[Point] = Field(min_length=5000)


def test_a_result_that_is_cut_to_fit_still_has_the_form_declared() -> None:
    point = {"place": [0.1, 0.2, 0.3], "minimum": 1.0}
    answer = Answer("a path", {"points": [point] * 5000})
    shown = to_result(answer.to_evidence("Walk", {})).structured_content
    assert shown is not None
    assert shown["shortened"]
    Draft202012Validator(result_schema(Path, long=False)).validate(shown)


def test_the_schema_keeps_lengths_of_vectors_and_leaves_out_bounds() -> None:
    data = result_schema(Path, long=False)["properties"]["data"]
    point = data["properties"]["points"]["items"]
    assert point["properties"]["place"] == {
        "type": "array",
        "items": {"type": "number"},
        "minItems": 3,
        "maxItems": 3,
    }
    assert point["properties"]["minimum"] == {"type": "number", "description": "a field with the name of a keyword"}
