"""Results of the tools about tools, evidence, names and answers."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import AnyJson, Json

Status = Literal["running", "completed", "failed", "cancelled", "diverged"]


class ToolLine(Result):
    """One tool in one line."""

    tool: str
    role: str
    does: str


class Tools(Result):
    """Data of DescribeTool without a tool."""

    tools: list[ToolLine]


class ArgumentLine(Result):
    """One argument, or one field of a part."""

    argument: str
    type: str = Field(description="in words")
    required: bool
    default: AnyJson = Field(default=None, description="missing: it has none (JSON document)")
    description: str


class DescribedTool(Result):
    """Data of DescribeTool."""

    tool: str
    role: str
    stage: str = Field(description="stage of a case that allows it")
    description: str
    arguments: list[ArgumentLine]
    result: str = Field(description="how results come, and how to get their schema")


class DescribedSchema(Result):
    """Data of DescribeTool for one argument or for the result."""

    json_schema: Json = Field(alias="schema", description="JSON schema (JSON document)")


class DescribedFields(Result):
    """Data of DescribeTool for a part of a world."""

    fields: list[ArgumentLine]
    about: str


class RecordLine(Result):
    """One record of the evidence in one line."""

    evidence: str
    tool: str
    status: Status
    summary: str


class Records(Result):
    """Data of ReadEvidence of a case."""

    records: list[RecordLine] = Field(description="latest first")
    next_cursor: int | None = Field(description="cursor of the next page; null: this is the last")


class EvidencePart(Result):
    """Data of ReadEvidence with a path."""

    path: str
    value: AnyJson = Field(description="what is there in the result (JSON document)")
    next_cursor: int | None = Field(default=None, description="of lists: cursor of the next page; null: the last")
    of: int | None = Field(default=None, description="of lists: number of items in all")


class NamedAs(Result):
    """A name and what it stands for."""

    name: str
    track: str | None = Field(description="observed track; null: none")
    object: str | None = Field(description="object of the world; null: none")
    reason: str


class Bindings(Result):
    """Data of UpdateBindings."""

    bindings: list[NamedAs] = Field(description="all in force")


class Ground(Result):
    """One result that an answer rests on."""

    evidence: str
    tool: str
    status: Literal["completed", "diverged"]
    summary: str
    world: str | None
    rollout: str | None
    observation: str | None


class Finished(Result):
    """Data of Finish."""

    question: str
    answer: str | None = Field(description="null: unresolved")
    resolved: bool
    confidence: float | None = Field(description="0 to 1; null: not given")
    missing: str | None = Field(description="evidence that would decide it; null: not given")
    committed_world: str | None
    evidence: list[Ground]
