"""Output schemas of tools: the envelope that all results share, with the data of the one tool inside.

What a tool returns is declared as pydantic models in `atw_mcp/results` (`ToolGroup.tool(..., returns=...)`); the
schema is theirs, and each result is compared with it before it is sent.
"""

from __future__ import annotations

import logging
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema

from atw_mcp.calls.results import Answer, plain, validation_text
from atw_mcp.calls.schemas import inlined

logger = logging.getLogger(__name__)
_FOR_WRITERS = {
    "pattern",
    "minLength",
    "maxLength",
    "minimum",
    "exclusiveMinimum",
    "maximum",
    "exclusiveMaximum",
}
_TEXT_OR_NULL = {"anyOf": [{"type": "string"}, {"type": "null"}]}  # some clients refuse a list of types


class Progress(BaseModel):
    """How far work is that goes on."""

    model_config = ConfigDict(extra="forbid")

    done: float = Field(description="amount done so far")
    total: float | None = Field(description="amount in all, null where it is not known")
    message: str = Field(description="what is being done now")


class Unfinished(BaseModel):
    """Data of a result whose status is running (with progress), failed or cancelled (empty)."""

    model_config = ConfigDict(extra="forbid")

    progress: Progress | None = Field(default=None, description="how far the work is, where it goes on")


def result_schema(returns: Any, *, long: bool) -> dict[str, Any]:
    """JSON schema of the results of a tool.

    returns: the model of its data, or a union of models where its arguments decide on the form. long: whether the
    work may go on after the call, so that the data may be how far it is.
    """
    return _enveloped(_to_read(inlined(_data(returns, long).json_schema())))


def referenced_schema(returns: Any, *, long: bool) -> dict[str, Any]:
    """The same schema with each model once, under `$defs`: shorter, for those who follow references."""
    data = _to_read(_data(returns, long).json_schema(schema_generator=_Untitled))
    definitions = data.pop("$defs", {})
    return {**_enveloped(data), "$defs": definitions}


class _Untitled(GenerateJsonSchema):
    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002
        return False


def _data(returns: Any, long: bool) -> TypeAdapter[Any]:
    return TypeAdapter(returns | Unfinished if long else returns)


def _enveloped(data: dict[str, Any]) -> dict[str, Any]:
    return {**_ENVELOPE, "properties": {**_ENVELOPE["properties"], "data": data}}


def _to_read(schema: Any) -> Any:
    """The schema without what concerns writers alone: bounds and patterns.

    Of lists those of fixed length keep it; long results are shown with the others cut.
    """
    if isinstance(schema, list):
        return [_to_read(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    fixed = schema.get("minItems") == schema.get("maxItems")
    left_out = _FOR_WRITERS if fixed else _FOR_WRITERS | {"minItems", "maxItems"}
    return {
        key: {name: _to_read(part) for name, part in item.items()} if key == "properties" else _to_read(item)
        for key, item in schema.items()
        if key not in left_out
    }


def report_mismatch(tool: str, returns: Any, answer: Answer) -> None:
    """Log what in the data that an agent is shown differs from the model declared; the answer goes out all the same.

    The tests take this message for a failure.
    """
    shown = answer.data if answer.shown is None else answer.shown
    try:
        TypeAdapter(returns).validate_python(plain(shown))
    except ValidationError as error:
        logger.error("%s returned data that its schema does not allow: %s", tool, validation_text(error))


# Nested objects do not list which of their fields are required: they are always all there.
_ENVELOPE: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "required": ["evidence", "tool", "status", "summary", "case", "source", "objects", "interval", "data"],
    "properties": {
        "evidence": {**_TEXT_OR_NULL, "description": "its id, for ReadEvidence"},
        "tool": {"type": "string"},
        "status": {"type": "string", "enum": ["running", "completed", "failed", "cancelled", "diverged"]},
        "summary": {"type": "string"},
        "case": _TEXT_OR_NULL,
        "source": {
            "type": "object",
            "additionalProperties": False,
            "properties": {
                "world": _TEXT_OR_NULL,
                "rollout": _TEXT_OR_NULL,
                "observation": _TEXT_OR_NULL,
            },
            "description": "what the result was computed from",
        },
        "objects": {"type": "array", "items": {"type": "string"}},
        "interval": {
            "anyOf": [
                {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
                {"type": "null"},
            ],
            "description": "seconds the result covers: start, end",
        },
        "data": {"type": "object", "description": "the result itself"},
        "shortened": {
            "type": "array",
            "items": {
                "type": "object",
                "additionalProperties": False,
                "properties": {
                    "path": {"type": "string"},
                    "shown": {"type": "integer"},
                    "of": {"type": "integer"},
                },
            },
            "description": "lists cut; ReadEvidence(path=...) pages through them",
        },
        "resource": {"type": "string", "description": "link to the whole result"},
    },
}
