"""World construction: from a file to a committed world."""

from __future__ import annotations

from typing import Annotated, Any

import cv2
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp import cases
from atw_mcp.app import App
from atw_mcp.results import Answer, explained
from atw_mcp.toolbox import ToolGroup

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
        list[str] | None, Field(description="questions about the case, kept with it", max_length=50)
    ] = None,
) -> Answer:
    """Start here. Open a video (or a measured data file) as a case and learn its facts: frames, size, frame rate.

    Opening the same file again continues its case as it was left. Called without arguments it lists every case.
    """
    given = [key for key, value in (("video", video), ("data", data), ("case", case)) if value is not None]
    if len(given) > 1:
        raise ToolError(f"OpenCase takes one of video, data or case, got {given}")
    if not given:
        listed = [{"case": c.id, "path": c.path, "committed_world": c.committed_world} for c in app.store.cases.all()]
        return Answer(summary=f"{len(listed)} cases", data={"cases": listed})
    if case is not None:
        found = app.case(case)
    else:
        with explained("give the path of a video file with video=PATH"):
            path = cases.existing_file(video or data or "")
            facts: dict[str, Any] = _video_facts(str(path)) if video else {}
            found = cases.open_case(
                app.store,
                path,
                kind="video" if video else "data",
                facts=facts,
                name=name,
                questions=questions or [],
            )
    return Answer(
        summary=f"case {found.id}: {found.kind} {found.path}",
        data={
            "case": found.id,
            "kind": found.kind,
            "path": found.path,
            "facts": found.facts,
            "questions": app.store.cases.questions(found.id),
            "worlds": [{"world": w, "origin": o} for w, o in app.store.cases.worlds(found.id)],
            "committed_world": found.committed_world,
        },
        case=found.id,
    )


def _video_facts(path: str) -> dict[str, Any]:
    capture = cv2.VideoCapture(path)
    try:
        if not capture.isOpened():
            raise ValueError(f"{path} is not a video that OpenCV can read")
        return {
            "frames": int(capture.get(cv2.CAP_PROP_FRAME_COUNT)),
            "width": int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            "height": int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
            "frames_per_second": float(capture.get(cv2.CAP_PROP_FPS)),
        }
    finally:
        capture.release()
