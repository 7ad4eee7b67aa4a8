"""World construction, first step: a case is opened. Needs neither the engine nor, to list or continue cases, OpenCV."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.results import Answer, damage_note, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.cases import cases
from atw_mcp.results.observation import CaseList, OpenedCase
from evidence_store import Case, StoreError

GROUP = ToolGroup("world construction")
DESCRIBED = "described"  # content of cases without a file


@GROUP.tool("OpenCase", title="Open a case", read_only=False, files=True, returns=OpenedCase | CaseList)
def open_case(
    app: App,
    video: Annotated[str | None, Field(description="path on the server's machine")] = None,
    data: Annotated[str | None, Field(description="path of measured data (CSV, JSON, npz), instead of a video")] = None,
    case: Annotated[str | None, Field(description="case id, to continue it")] = None,
    name: Annotated[
        str | None,
        Field(
            description="id for the case; a new one opens the file again; alone, a case of a described world",
            pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$",
        ),
    ] = None,
    questions: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=4000)]] | None,
        Field(description="questions about the case, kept with it", max_length=50),
    ] = None,
) -> Answer:
    """Start here. Open a video (or a measured data file) as a case and learn its facts; without arguments, list all
    cases. Opening the same file again continues its case as it was left."""
    given = [key for key, value in (("video", video), ("data", data), ("case", case)) if value is not None]
    if len(given) > 1:
        raise ToolError(f"OpenCase takes one of video, data or case, got {' and '.join(given)}")
    if not given:
        if name is not None:
            return _case_answer(app, _described_case(app, name, questions or []))
        if questions:
            raise ToolError("OpenCase needs a case to keep questions with: video=PATH, data=PATH, case=ID or name=NEW")
        listed = [
            {"case": c.id, "path": app.files.shown(c.path), "committed_world": c.committed_world}
            for c in app.store.cases.all()
        ]
        damaged = damage_note(app.store.cases.damaged())
        return Answer(summary=f"{len(listed)} cases{damaged}", data={"cases": listed})
    if case is not None:
        if name is not None:
            raise ToolError("name is given to a file that is opened: OpenCase(video=PATH, name=...)")
        found = app.case(case)
        with app.store.transaction():
            for question in questions or []:
                app.store.cases.add_question(found.id, question)
        return _case_answer(app, found)
    with explained("OpenCase(video=PATH) with the path of a readable video, or data=PATH"):
        path = app.files.file(data or "") if video is None else app.files.film(video)
        facts = _video_facts(path) if video is not None else {"bytes": path.stat().st_size}
        found = cases.open_case(
            app.store,
            path,
            kind="data" if video is None else "video",
            facts=facts,
            name=name,
            questions=questions or [],
        )
    return _case_answer(app, found)


def _described_case(app: App, name: str, questions: list[str]) -> Case:
    """Open a case without a file; raises ToolError where the name is that of another."""
    try:
        with app.store.transaction():
            found = app.store.cases.add(name, content=DESCRIBED, kind="data", path="", facts={"bytes": 0})
            for question in questions:
                app.store.cases.add_question(found.id, question)
    except StoreError as error:
        raise ToolError(f"{error}. Next: OpenCase(case={name!r}) continues it") from error
    return found


def _video_facts(path: Path) -> dict[str, Any]:
    from atw_mcp.perception.video import probe  # OpenCV: opening a video is all that needs it

    return cases.video_facts(probe(path))


def _case_answer(app: App, case: Case) -> Answer:
    observations: list[dict[str, Any]] = [
        {"kind": kind, "observation": identifier} for kind, identifier in app.store.cases.observations(case.id)
    ]
    bindings = app.store.cases.bindings(case.id)
    shown = app.files.shown(case.path)
    if case.committed_world is not None:
        step = f"Ask(case={case.id!r})"
    elif app.store.cases.worlds(case.id):
        step = f"FitWorld(case={case.id!r}) or CommitWorld"
    elif observations:
        step = f"BuildWorld(case={case.id!r})"
    elif case.content == DESCRIBED:
        step = f"BuildWorld(case={case.id!r}, objects=[...] with name, shape and position)"
    elif case.kind == "video":
        step = f"ObserveObjects(case={case.id!r}), or ModelVideo(case={case.id!r}, ...) to model it in one call"
    else:
        step = f"ImportObservation(case={case.id!r}, kind='tracks' (or 'recording': several runs), path={shown!r})"
    stage = "World Modeling" if case.committed_world is None else "World Probing"
    return Answer(
        summary=f"case {case.id} ({stage}): {f'{case.kind} {shown}' if shown else 'no file'}",
        data={
            "case": case.id,
            "stage": stage,
            "kind": case.kind,
            "path": shown,
            "facts": {k: v for k, v in case.facts.items() if k not in ("clock", "shown_times")},
            "questions": app.store.cases.questions(case.id),
            "observations": observations,
            "worlds": [{"world": w, "origin": o} for w, o in app.store.cases.worlds(case.id)],
            "committed_world": case.committed_world,
            "bindings": [vars(binding) for binding in bindings.values()],
            "answers": [vars(answer) for answer in app.store.cases.answers(case.id)],
            "next": step,
        },
        case=case.id,
        world=case.committed_world,
    )
