"""Execution control: tools about tools, evidence, names, and the end of a question."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import CallToolResult
from pydantic import BaseModel, ConfigDict, Field

from atw_mcp.calls.app import App
from atw_mcp.calls.names import case_hint
from atw_mcp.calls.paging import MOST_ITEMS, PLACE, fitting, part_of
from atw_mcp.calls.result_schemas import Unfinished
from atw_mcp.calls.results import ROOM, Answer, damage_note, explained, to_result
from atw_mcp.calls.schemas import argument_lines, inlined
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.calls.waiting import Forwarded, Waiting
from atw_mcp.results.control import (
    Bindings,
    DescribedFields,
    DescribedSchema,
    DescribedTool,
    EvidencePart,
    Finished,
    Records,
    Tools,
)
from atw_mcp.results.values import Json
from evidence_store import Answer as RecordedAnswer
from evidence_store import Binding, Evidence, UnknownRecord

GROUP = ToolGroup("execution control")

CaseId = Annotated[str, Field(description="case id")]
CORRECTIONS_EXAMPLE = [{"name": "the red thing", "track": "object_1", "object": "red_ball"}]
RESULT = "result"  # instead of an argument of DescribeTool
MOST_FOUND = 50  # records looked for where no limit is given; those that fit are shown
EVIDENCE_PATTERN = r"^ev-\d{1,15}$"
CANCEL_SECONDS = 5.0  # [s] to wait for cancelled work to stop; it looks once a chunk, within about a second


@GROUP.tool(
    "DescribeTool",
    title="Describe a tool",
    returns=Tools | DescribedTool | DescribedFields | DescribedSchema,
)
def describe_tool(
    app: App,
    tool: Annotated[str | None, Field(description="without it, every tool in one line")] = None,
    argument: Annotated[
        str | None,
        Field(
            description="one argument, or 'result', for its full JSON schema. 'parts.rope' is a part of BuildWorld, "
            "'parts.hinge.motor' a field of a part, 'world' a whole world"
        ),
    ] = None,
) -> Answer:
    """Describe a tool: purpose, arguments with types, bounds and defaults, and the stage that allows it."""
    if tool is None:
        tools = [{"tool": t.name, "role": t.role, "does": t.description.split(". ")[0]} for t in app.served]
        return Answer(summary=f"{len(tools)} tools", data={"tools": tools}, whole=True)
    found = app.tool(tool)
    properties: dict[str, Any] = found.parameters.get("properties", {})
    if argument is not None and found.name == "BuildWorld" and argument.startswith("parts."):
        from atw_mcp.worlds.parts import part_field_schema, part_schema  # the engine, whose descriptions these are

        kind, _, field = argument.removeprefix("parts.").partition(".")
        if field:
            inner = part_field_schema(kind, field)
            about = inner.get("description", "")
            lines = argument_lines(inner) if "properties" in inner else []
            return Answer(
                summary=f"{field} of part {kind}: {about.split('. ')[0]}",
                data={"fields": lines, "about": about} if lines else {"schema": inner},
                whole=True,
            )
        described = part_schema(kind)
        lines = argument_lines(described)[1:]
        return Answer(
            summary=f"part {kind}: {described['description'].split('. ')[0]}",
            data={"fields": lines, "about": described["description"]},
            whole=True,
        )
    if argument == RESULT:
        return Answer(summary=f"result of {found.name}", data={"schema": found.full_output}, whole=True)
    if argument is not None:
        if argument not in properties:
            raise ToolError(f"{found.name} has no argument {argument!r}; arguments: {', '.join([*properties, RESULT])}")
        schema = properties[argument]
        if (found.name, argument) == ("BuildWorld", "world"):
            from polyworld.world import World

            schema = inlined(World.model_json_schema())
        return Answer(summary=f"{found.name}.{argument}", data={"schema": schema}, whole=True)
    return Answer(
        summary=f"{found.name} ({found.role})",
        data={
            "tool": found.name,
            "role": found.role,
            "stage": STAGES[found.role],
            "description": found.description,
            "arguments": argument_lines(found.parameters),
            "result": ("pictures, with their data as JSON text" if found.pictures else "JSON, also structured content")
            + f"; DescribeTool(tool={found.name!r}, argument={RESULT!r}) gives its schema",
        },
        whole=True,
    )


STAGES = {
    "world construction": "World Modeling: at any time; what is made after a commit counts once it is committed",
    "gap": "at any time",
    "world inspection": "at any time",
    "world experimentation": "World Probing: refused until CommitWorld, but for Ask of named worlds",
    "execution control": "at any time",
}


@GROUP.tool(
    "CallTool", title="Call a tool that is not listed", read_only=False, idempotent=False, pictures=True, returns=Json
)
def call_tool(
    app: App,
    tool: Annotated[str, Field(max_length=64, description="its name")],
    arguments: Annotated[dict[str, Any], Field(description="its arguments, as DescribeTool(tool) lists them")],
) -> Forwarded:
    """Call a tool that the list lacks, such as one that a result names as the next step."""
    return Forwarded(app.tool(tool).name, arguments)


@GROUP.tool(
    "ReadEvidence", title="Read evidence again", pictures=True, returns=Records | EvidencePart | Unfinished | Json
)
def read_evidence(
    app: App,
    evidence: Annotated[str | None, Field(description="evidence id, e.g. ev-12; without it, case is searched")] = None,
    case: Annotated[str | None, Field(description="case id, whose evidence is listed, latest first")] = None,
    tool: Annotated[str | None, Field(max_length=64, description="search: results of this tool")] = None,
    object: Annotated[str | None, Field(max_length=64, description="search: results about this object")] = None,
    interval: Annotated[
        list[float] | None, Field(min_length=2, max_length=2, description="search: overlapping [start, end] in seconds")
    ] = None,
    text: Annotated[
        str | None,
        Field(min_length=1, max_length=200, description="search: these words in summary, arguments or data"),
    ] = None,
    path: Annotated[
        str | None,
        Field(description="part of the result, e.g. 'events' or 'objects.0.positions'", max_length=200),
    ] = None,
    fields: Annotated[
        list[Annotated[str, Field(max_length=64)]] | None,
        Field(min_length=1, max_length=64, description="only these fields or columns of that part"),
    ] = None,
    cursor: Annotated[int, Field(ge=0, description="next_cursor of the page before")] = 0,
    limit: Annotated[
        int | None, Field(ge=1, le=MOST_ITEMS, description="items of a list; default: as fit in 1,500 tokens")
    ] = None,
    detail: Annotated[
        Literal["summary", "full"], Field(description="full: all the data, up to 13,000 tokens")
    ] = "summary",
    wait_seconds: Annotated[float, Field(ge=0, le=600, description="longest wait for running work [s]")] = 0.0,
) -> CallToolResult | Waiting:
    """Return an earlier result without running anything again, or search the evidence of a case. Of running work it
    gives the progress; of a long result the part at `path`, list items from `cursor` on."""
    searched = {"tool": tool, "object": object, "interval": interval, "text": text}
    if evidence is None:
        if case is None:
            raise ToolError("ReadEvidence takes either evidence (an id such as ev-12) or case (to list its evidence)")
        return to_result(_found(app, app.case(case).id, searched, cursor, limit))
    unused = [name for name, value in searched.items() if value is not None]
    if unused:
        raise ToolError(f"{', '.join(unused)} search the evidence of a case: leave evidence out, or them")
    record = _record(app, evidence)
    if case is not None and record.case != app.case(case).id:
        raise ToolError(f"{evidence} belongs to case {record.case!r}, not to {case!r}")

    def result() -> CallToolResult:
        if path is not None or fields is not None:
            read = part_of(app.store.read_evidence(evidence), path, fields, cursor, limit)
            return to_result(read, whole=detail == "full")
        return app.evidence_result(evidence, whole=detail == "full")

    if record.status == "running" and wait_seconds > 0:
        return Waiting(evidence, wait_seconds, result)
    return result()


@GROUP.tool("CancelWork", title="Cancel running work", read_only=False, pictures=True, returns=Unfinished | Json)
def cancel_work(
    app: App, evidence: Annotated[str, Field(pattern=EVIDENCE_PATTERN, description="id of the work, e.g. ev-12")]
) -> Waiting:
    """Stop work that is still running. What it has found so far is kept where the tool keeps it."""
    record = _record(app, evidence)
    if record.status != "running":
        raise ToolError(f"{evidence} is {record.status} already: there is nothing to cancel")
    app.jobs.cancel(evidence)
    return Waiting(evidence, CANCEL_SECONDS, lambda: app.evidence_result(evidence))


def _record(app: App, evidence: str) -> Evidence:
    try:
        return app.store.read_evidence(evidence)
    except UnknownRecord as error:
        raise ToolError(f"{error}. Next: ReadEvidence(case={case_hint(app)}) lists the evidence of a case") from error


def _found(app: App, case: str, searched: dict[str, Any], cursor: int, limit: int | None) -> Evidence:
    """The records of a case that a search finds, a line each."""
    interval = searched["interval"]
    with explained():
        page = app.store.evidence.search(
            case,
            tool=searched["tool"],
            object=searched["object"],
            interval=None if interval is None else (interval[0], interval[1]),
            text=searched["text"],
            cursor=f"ev-{cursor}" if cursor else None,
            limit=MOST_FOUND if limit is None else limit,
        )
    rows = [{"evidence": r.id, "tool": r.tool, "status": r.status, "summary": r.summary} for r in page.records]
    note = damage_note(list(page.damaged))
    shown = rows if limit is not None else fitting(rows, ROOM - 2 * PLACE - len(note))  # the summary takes one
    more = len(shown) < len(rows) or page.cursor is not None
    return Evidence(
        tool="ReadEvidence",
        arguments={} if limit is None else {"limit": limit},
        case=case,
        summary=f"{len(shown)} records, latest first{'; more from next_cursor on' if more else ''}{note}",
        payload={"data": {"records": shown, "next_cursor": int(shown[-1]["evidence"][3:]) if more else None}},
    )


class Correction(BaseModel):
    """One name and what it stands for."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(min_length=1, max_length=200, description="the name as the question says it")
    track: str | None = Field(default=None, max_length=64, description="observed track it stands for; null for none")
    object: str | None = Field(default=None, max_length=64, description="object of the world it stands for")


@GROUP.tool("UpdateBindings", title="Correct what names stand for", read_only=False, returns=Bindings)
def update_bindings(
    app: App,
    case: CaseId,
    corrections: Annotated[
        list[Correction],
        Field(min_length=1, max_length=100, description="what to change", examples=[CORRECTIONS_EXAMPLE]),
    ],
    reason: Annotated[str, Field(min_length=1, max_length=2000, description="what was seen that shows the change")],
) -> Answer:
    """Say which observed track and which object of the world a name in a question stands for, or correct it.

    A binding replaces the earlier one of the same name; both stay in the evidence. Returns every binding in force.
    """
    found = app.case(case)
    tracks = app.track_names(found)
    worlds = [app.world(found, world) for world, _ in app.store.cases.worlds(found.id)]
    objects = sorted({name for w in worlds for name in (*w.moving_names, *(s.name for s in w.statics))})
    for correction in corrections:
        if correction.track is not None and correction.track not in tracks:
            raise ToolError(
                f"no track {correction.track!r} in case {found.id!r}; tracks: {tracks}. Nothing was changed"
            )
        if correction.object is not None and correction.object not in objects:
            raise ToolError(f"no object {correction.object!r} in its worlds; objects: {objects}. Nothing was changed")
    with app.store.transaction():
        for correction in corrections:
            app.store.cases.bind(found.id, Binding(correction.name, correction.track, correction.object, reason))
    bindings = app.store.cases.bindings(found.id)
    return Answer(
        summary=f"{len(corrections)} bindings changed, {len(bindings)} in force",
        data={"bindings": [vars(binding) for binding in bindings.values()]},
        case=found.id,
        objects=tuple(sorted({b.object for b in bindings.values() if b.object is not None})),
    )


@GROUP.tool("Finish", title="Answer a question", read_only=False, idempotent=False, viewer=True, returns=Finished)
def finish(
    app: App,
    case: CaseId,
    question: Annotated[str, Field(min_length=1, max_length=4000, description="the question, as it was asked")],
    evidence: Annotated[
        list[Annotated[str, Field(pattern=EVIDENCE_PATTERN)]],
        Field(max_length=100, description="ids of the results that decide the question"),
    ],
    answer: Annotated[
        str | None, Field(max_length=4000, description="null where the evidence does not decide it")
    ] = None,
    confidence: Annotated[float | None, Field(ge=0, le=1, description="how sure, 0 to 1")] = None,
    missing: Annotated[
        str | None, Field(max_length=4000, description="of an unresolved question: what evidence is missing")
    ] = None,
) -> Answer:
    """Record the answer to a question with the evidence it rests on. Every id must be a finished result of this
    case. A question the evidence does not decide is finished with answer=null and what is missing."""
    found = app.case(case)
    records = []
    for identifier in dict.fromkeys(evidence):
        try:
            record = app.store.read_evidence(identifier)
        except UnknownRecord as error:
            raise ToolError(f"{error}. Next: ReadEvidence(case={found.id!r}) lists what there is") from error
        if record.case != found.id:
            raise ToolError(f"{identifier} belongs to case {record.case!r}, not to {found.id!r}. Nothing was recorded")
        if record.status not in ("completed", "diverged"):
            raise ToolError(f"{identifier} is {record.status}: it proves nothing yet. Nothing was recorded")
        records.append(record)
    if answer is not None and not records:
        raise ToolError("an answer needs at least one evidence id; without evidence give answer=null and missing=...")
    if answer is None and not missing:
        raise ToolError("an unresolved question (answer=null) needs missing=...: what evidence would decide it")
    recorded = RecordedAnswer(question, answer, confidence, tuple(r.id for r in records), missing or "")
    with app.store.transaction():
        app.store.cases.add_question(found.id, question)
        app.store.cases.add_answer(found.id, recorded)
    worlds = [r.world for r in records if r.world is not None]
    return Answer(
        summary=f"unresolved: {missing}" if answer is None else f"answered: {answer}",
        data={
            "question": question,
            "answer": answer,
            "resolved": answer is not None,
            "confidence": confidence,
            "missing": missing,
            "committed_world": found.committed_world,
            "evidence": [
                {
                    "evidence": r.id,
                    "tool": r.tool,
                    "status": r.status,
                    "summary": r.summary,
                    "world": r.world,
                    "rollout": r.rollout,
                    "observation": r.observation,
                }
                for r in records
            ],
        },
        case=found.id,
        world=found.committed_world or (worlds[-1] if worlds else None),
        objects=tuple(sorted({name for r in records for name in r.objects})),
    )
