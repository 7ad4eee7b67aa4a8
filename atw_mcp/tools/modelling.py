"""World construction in one call: from a video and what is known about it to a fitted world."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork
from atw_mcp.calls.results import Answer, explained, plain
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.fitting.video_model import VideoRequest, model_video
from atw_mcp.observation.matching import Known
from atw_mcp.observation.observing import latest_camera
from atw_mcp.perception.eye.colour_names import colour_word
from atw_mcp.perception.known_scene import Sized
from atw_mcp.results.modelling import ModelledVideo, StoppedModelling
from atw_mcp.tools.known_objects import KnownObject, known_of
from atw_mcp.tools.measurement import LengthArgument, PointArgument
from atw_mcp.tools.opening import open_case
from atw_mcp.tools.world_arguments import Argument, Patience, PlaneArgument, Point
from evidence_store import Case, to_json

GROUP = ToolGroup("world construction")


@GROUP.tool(
    "ModelVideo",
    title="Model a video in one call",
    read_only=False,
    files=True,
    returns=ModelledVideo | StoppedModelling,
)
def model_video_tool(
    app: App,
    video: Annotated[str | None, Field(description="path of a video on the server's machine; or give case")] = None,
    case: Annotated[str | None, Field(description="case id, to go on with it")] = None,
    name: Annotated[
        str | None,
        Field(description="id for the case", pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$"),
    ] = None,
    objects: Annotated[
        list[KnownObject] | None,
        Field(
            min_length=1,
            max_length=64,
            description="all objects of the scene; default: those observed",
            examples=[[{"name": "red_ball", "shape": {"kind": "sphere", "radius": 0.05}}]],
        ),
    ] = None,
    unlisted: Annotated[
        Literal["leave_out", "model"],
        Field(description="tracks that fit no object; the result names them"),
    ] = "leave_out",
    points: Annotated[
        list[PointArgument] | None,
        Field(
            min_length=4,
            max_length=200,
            description="camera: 4 known points in a plane or 6 in space (pixel 0, 0: the first's centre)",
        ),
    ] = None,
    known_length: Annotated[
        LengthArgument | None, Field(description="camera: one known length, for a flat view")
    ] = None,
    seconds_per_frame: Annotated[
        float | None, Field(gt=0, le=1e4, description="physical time between frames [s]; default: the file's")
    ] = None,
    gravity: Annotated[Point | None, Field(description="[m/s^2]; default 0, 0, -9.81")] = None,
    motion_plane: Annotated[
        PlaneArgument | Literal["none"] | None,
        Field(
            description="plane of motion, where not the floor or a side view's; 'none' drops an earlier one. Objects "
            "of given size that fly, bounce or move on obstacles need none"
        ),
    ] = None,
    floor: Annotated[
        float | Literal["none"] | None, Field(description="z of the floor [m], or 'none'; default 0, a side view none")
    ] = None,
    first_frame: Annotated[int | None, Field(ge=0, description="first frame modelled")] = None,
    last_frame: Annotated[int | None, Field(ge=0, description="last frame fitted")] = None,
    observe: Annotated[
        dict[str, Any] | None,
        Field(description="further arguments of ObserveObjects, e.g. {'min_area': 50}; {} observes a case again"),
    ] = None,
    calibrate: Annotated[
        dict[str, Any] | None,
        Field(description="further arguments of CalibrateCamera, e.g. {'plane_z': 0.2}"),
    ] = None,
    build: Annotated[
        dict[str, Any] | None,
        Field(description="further arguments of BuildWorld, e.g. {'walls': [..], 'parts': [..]}"),
    ] = None,
    fit: Annotated[
        dict[str, Any] | None,
        Field(description="further arguments of FitWorld, e.g. {'fit_seconds_per_frame': true}"),
    ] = None,
    patience_seconds: Patience = 50.0,
) -> Answer | LongWork:
    """From a video and what is known about it to a fitted world in one call: OpenCase, ObserveObjects, CalibrateCamera,
    known objects matched to tracks, BuildWorld, FitWorld. Every step has evidence of its own, listed with its doubts
    and how to correct it; corrected steps are not repeated by a next call. Returns errors in pixels and metres beside
    body size and noise, matches, friction, restitution and dampings with intervals and priors, how frames left out are
    predicted, and the next call that helps most."""
    if (video is None) == (case is None):
        raise ToolError("ModelVideo takes one of video=PATH and case=ID")
    if video is None and name is not None:
        raise ToolError("name is given to a video that is opened: ModelVideo(video=PATH, name=...)")
    found = _opened(app, video, name) if case is None else app.case(case)
    if found.kind != "video":
        raise ToolError(f"case {found.id!r} is measured data: ImportObservation, BuildWorld and FitWorld model it")
    own_facts = {"objects": objects, "seconds_per_frame": seconds_per_frame, "gravity": gravity,
                 "motion_plane": motion_plane, "floor": floor, "build": build}  # fmt: skip
    facts, kept = _kept(app, found, [name for name, value in own_facts.items() if value is None])
    objects, seconds_per_frame = objects or facts.objects, seconds_per_frame or facts.seconds_per_frame
    gravity, stated = gravity or facts.gravity, motion_plane or facts.motion_plane
    plane = None if stated == "none" else stated
    floor = facts.floor if floor is None else floor
    build = facts.build if build is None else build
    known_points = None if points is None else [item.model_dump() for item in points]
    given = _given({"points": known_points, "known_length": _dumped(known_length)})
    calibration = _merged(given, calibrate, "calibrate")
    if not calibration and latest_camera(app, found) is None:
        raise ToolError(
            f"nothing says how the image of case {found.id!r} maps to the world. Next: ModelVideo(case={found.id!r}, "
            "...) with points, known_length or calibrate"
        )
    bodies = {item.name: item for item in objects or []}
    if len(bodies) < len(objects or []):
        raise ToolError("two of objects have the same name: each needs one of its own")
    own = {
        "seconds_per_frame": seconds_per_frame,
        "gravity": gravity,
        "motion_plane": _dumped(plane),
        "floor": floor,
        "first_frame": first_frame,
    }
    listed: dict[str, Any] = {"objects": [], "only": []} if objects else {}
    building = _merged({**_given(own), **listed}, build, "build")
    frames = _given({"first_frame": first_frame, "last_frame": last_frame})
    with explained():
        known = tuple(known_of(app, found, item) for item in bodies.values())
        request = VideoRequest(
            known=known,
            bodies={
                key: item.model_dump(exclude={"name", "pixel", "frame", "across"}, exclude_none=True)
                for key, item in bodies.items()
            },
            unlisted=unlisted,
            looked_for=_looked_for(known, list(bodies.values())) if unlisted == "leave_out" else None,
            observe=observe,
            calibrate=calibration or None,
            build={key: value for key, value in building.items() if key not in listed},
            fit=_merged(frames, fit, "fit"),
            plane=None if plane is None else plane.to_plane(),
            floor=floor if isinstance(floor, float) else None,
            kept=kept,
        )
    _check_steps(app, found, request)
    return LongWork(
        key="ModelVideo" + found.id + to_json(plain({**vars(request), "known": repr(request.known)})),
        work=partial(model_video, app, found, request),
        draft=Answer(summary=f"modelling {app.files.shown(found.path)}", data={}, case=found.id, objects=tuple(bodies)),
        patience=patience_seconds,
    )


class _Facts(Argument):
    """Facts of a film that a next call need not repeat."""

    objects: list[KnownObject] | None = None
    seconds_per_frame: float | None = None
    gravity: Point | None = None
    motion_plane: PlaneArgument | Literal["none"] | None = None
    floor: float | Literal["none"] | None = None
    build: dict[str, Any] | None = None


def _kept(app: App, case: Case, missing: Sequence[str]) -> tuple[_Facts, str]:
    """Return the facts that earlier calls of this tool gave last, of those missing in this one, and where they are."""
    found: dict[str, Any] = {}
    said: list[str] = []
    for head in reversed(app.store.evidence.of_case(case.id, tool="ModelVideo")):
        arguments = app.store.evidence.get(head.id).arguments
        for fact in missing:
            if fact not in found and arguments.get(fact) is not None:
                found[fact] = arguments[fact]
                said.append(f"{fact} as in {head.id}")
    return _Facts.model_validate(found), ", ".join(said)


def _opened(app: App, video: str | None, name: str | None) -> Case:
    answer = open_case(app, video=video, name=name)
    assert isinstance(answer, Answer)
    assert answer.case is not None
    app.store.evidence.add(answer.to_evidence("OpenCase", _given({"video": video, "name": name})))
    return app.case(answer.case)


def _looked_for(known: Sequence[Known], items: Sequence[KnownObject]) -> list[dict[str, Any]] | None:
    """Return what ObserveObjects can look for; None where that is nothing, or a colour or a size is not given."""
    shown = [k.pixel is not None or colour_word(k.color or k.name) is not None for k in known]
    if not items or not all(shown) or not all(isinstance(k.shape, Sized) for k in known):
        return None
    return [
        item.model_dump(include={"name", "shape", "across", "color", "pixel", "frame"}, exclude_none=True)
        for item in items
    ]


def _check_steps(app: App, case: Case, request: VideoRequest) -> None:
    """Raise ToolError for arguments that a later step would refuse, before the first takes its time."""
    steps = {
        "ObserveObjects": request.observe,
        "CalibrateCamera": request.calibrate,
        "BuildWorld": request.build,
        "FitWorld": request.fit,
    }
    for tool in app.tools:
        arguments = steps.get(tool.name)
        if arguments:
            tool.checked({"case": case.id, **arguments})


def _merged(own: dict[str, Any], further: dict[str, Any] | None, name: str) -> dict[str, Any]:
    """Join a step's arguments; raises ToolError for one that is given in both places."""
    twice = sorted(set(own) & set(further or {}))
    if twice:
        raise ToolError(f"{', '.join(twice)} of {name} is an argument of ModelVideo itself: give it once, there")
    return {**own, **(further or {})}


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _dumped(argument: Argument | None) -> dict[str, Any] | None:
    return None if argument is None else argument.model_dump(exclude_none=True)
