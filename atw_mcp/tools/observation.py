"""World construction, first part: a case is opened and its video observed."""

from __future__ import annotations

from typing import Annotated, Any

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp import cases
from atw_mcp.app import App
from atw_mcp.jobs import LongWork, Progress
from atw_mcp.observing import image_observation, keep_image_observation, video_file
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.observe import observe
from atw_mcp.perception.video import probe
from atw_mcp.results import Answer, explained
from atw_mcp.toolbox import ToolGroup
from atw_mcp.tools.world_arguments import CaseId, Patience
from evidence_store import Case

GROUP = ToolGroup("world construction")


@GROUP.tool("OpenCase", title="Open a case", read_only=False)
def open_case(
    app: App,
    video: Annotated[str | None, Field(description="path of a video file on the server's machine")] = None,
    data: Annotated[
        str | None, Field(description="path of a measured data file (CSV, JSON, npz), for a case without a video")
    ] = None,
    case: Annotated[str | None, Field(description="id of a case that exists, to continue it")] = None,
    name: Annotated[
        str | None,
        Field(
            description="id to give the case; a new name opens the same file again as an independent case",
            pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$",
        ),
    ] = None,
    questions: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=4000)]] | None,
        Field(description="questions about the case, kept with it", max_length=50),
    ] = None,
) -> Answer:
    """Start here. Open a video (or a measured data file) as a case and learn its facts: frames, size, frame rate.
    Opening the same file again continues its case as it was left. Called without arguments it lists every case."""
    given = [key for key, value in (("video", video), ("data", data), ("case", case)) if value is not None]
    if len(given) > 1:
        raise ToolError(f"OpenCase takes one of video, data or case, got {' and '.join(given)}")
    if not given:
        if name is not None or questions:
            raise ToolError("OpenCase needs a file to open with it: video=PATH, data=PATH or case=ID")
        listed = [{"case": c.id, "path": c.path, "committed_world": c.committed_world} for c in app.store.cases.all()]
        return Answer(summary=f"{len(listed)} cases", data={"cases": listed})
    if case is not None:
        if name is not None:
            raise ToolError("name is given to a file that is opened: OpenCase(video=PATH, name=...)")
        found = app.case(case)
        with app.store.transaction():
            for question in questions or []:
                app.store.cases.add_question(found.id, question)
        return _case_answer(app, found)
    with explained("OpenCase(video=PATH) with the path of a readable video, or data=PATH"):
        path = cases.existing_file(video or data or "")
        facts = cases.video_facts(probe(path)) if video is not None else {"bytes": path.stat().st_size}
        found = cases.open_case(
            app.store,
            path,
            kind="data" if video is None else "video",
            facts=facts,
            name=name,
            questions=questions or [],
        )
    return _case_answer(app, found)


@GROUP.tool("ObserveObjects", title="Find and follow objects", read_only=False)
def observe_objects(
    app: App,
    case: CaseId,
    expected: Annotated[
        list[Annotated[str, Field(min_length=1, max_length=100)]] | None,
        Field(
            max_length=64,
            description="descriptions of objects to look for, e.g. 'blue metal sphere': those that fit get it as name, "
            "those not found are named in the warnings",
        ),
    ] = None,
    max_objects: Annotated[int, Field(ge=1, le=200, description="most objects to follow")] = 20,
    min_area: Annotated[
        int | None, Field(ge=4, le=10_000_000, description="smallest region taken for an object [px]")
    ] = None,
    stride: Annotated[int, Field(ge=1, le=100, description="look at every n-th frame")] = 1,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Find every moving or distinct object in the video and follow it: masks, colour, material and shape, when it is
    visible, hidden, enters or leaves. The camera must not move. Next: InspectFrames to check, then CalibrateCamera."""
    found = app.case_to_model(case, "ObserveObjects")
    with explained(f"OpenCase(video=PATH) or ImportObservation(case={found.id!r})"):
        path = video_file(found)
    inputs = {
        "video": found.content,
        "expected": expected,
        "max_objects": max_objects,
        "min_area": min_area,
        "stride": stride,
    }
    kept = app.store.observations.find("observe", inputs)
    if kept is not None:
        app.store.cases.add_observation(found.id, "objects", kept.id)
        return observed_answer(found, kept.id, image_observation(kept))

    def work(progress: Progress) -> Answer:
        with explained():
            seen = observe(
                path,
                max_objects=max_objects,
                min_area=min_area,
                expected=expected,
                stride=stride,
                progress=lambda share, what: progress.report(share, 1.0, what),
                cancelled=progress.cancelled,
            )
        content = keep_image_observation(app, found, seen, "observe", inputs)
        return observed_answer(found, content.id, seen)

    return LongWork(
        key=app.store.observations.key("observe", inputs) + found.id,
        work=work,
        draft=Answer(summary=f"observing {path.name}", data={}, case=found.id),
        patience=patience_seconds,
    )


def observed_answer(case: Case, identifier: str, seen: ImageObservation) -> Answer:
    """What an agent is told of an observation of the video."""
    overview = seen.summary()
    overview["video"].pop("path")
    warned = f"; {len(seen.warnings)} warnings" if seen.warnings else ""
    return Answer(
        summary=f"{len(seen.objects)} objects in {len(seen.frames)} frames: {', '.join(seen.names)}{warned}",
        data={**overview, "next": f"InspectFrames(case={case.id!r}), then CalibrateCamera(case={case.id!r})"},
        case=case.id,
        observation=identifier,
        objects=seen.names,
    )


def _case_answer(app: App, case: Case) -> Answer:
    observations: list[dict[str, Any]] = [
        {"kind": kind, "observation": identifier} for kind, identifier in app.store.cases.observations(case.id)
    ]
    bindings = app.store.cases.bindings(case.id)
    if case.committed_world is not None:
        step = f"Rollout(case={case.id!r})"
    elif app.store.cases.worlds(case.id):
        step = f"FitWorld(case={case.id!r}) or CommitWorld"
    elif observations:
        step = f"BuildWorld(case={case.id!r})"
    elif case.kind == "video":
        step = f"ObserveObjects(case={case.id!r})"
    else:
        step = f"ImportObservation(case={case.id!r}, kind='tracks', path={case.path!r})"
    stage = "World Modeling" if case.committed_world is None else "World Probing"
    return Answer(
        summary=f"case {case.id} ({stage}): {case.kind} {case.path}",
        data={
            "case": case.id,
            "stage": stage,
            "kind": case.kind,
            "path": case.path,
            "facts": case.facts,
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
