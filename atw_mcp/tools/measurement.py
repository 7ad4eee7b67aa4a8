"""World construction, second part: observations from elsewhere, and how the image maps to the world."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import BaseModel, Field
from pydantic.json_schema import SkipJsonSchema

from atw_mcp.calls.app import App
from atw_mcp.calls.questions import Question
from atw_mcp.calls.results import Answer, explained, plain
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.observation import importing
from atw_mcp.observation.observing import keep_calibration
from atw_mcp.observation.recording_records import Imported, keep_recording
from atw_mcp.observation.shape_records import series_rows
from atw_mcp.observation.track_records import TrackRecord
from atw_mcp.perception.calibration import (
    Calibration,
    calibrate_from_homography,
    calibrate_from_known_length,
    calibrate_from_points,
    calibrate_given,
)
from atw_mcp.results.measurement import (
    CalibratedCamera,
    ImportedDepth,
    ImportedMesh,
    ImportedRecording,
    ImportedTracks,
)
from atw_mcp.results.observation import ObservedObjects
from atw_mcp.tools.observation import observed_answer
from atw_mcp.tools.world_arguments import Argument, CaseId, Pixel, Point
from evidence_store import Case
from polyworld.data.recording_header import RecordingForm

GROUP = ToolGroup("world construction")
ROUNDED = 1e-4  # [s] by which times in a table differ from those of frames because of their few digits
Matrix = Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=3, max_length=3)]
# A record with the matrix in it: refused with what to take from it; not offered to the agent.
Unread = SkipJsonSchema[dict[str, Any]]


@GROUP.tool(
    "ImportObservation",
    title="Import an observation",
    read_only=False,
    files=True,
    returns=ImportedTracks | ImportedRecording | ObservedObjects | CalibratedCamera | ImportedDepth | ImportedMesh,
)
def import_observation(
    app: App,
    case: CaseId,
    kind: Annotated[
        Literal["tracks", "recording", "points", "series", "masks", "camera", "depth", "mesh"],
        Field(
            description="what it holds. tracks: positions in the world (table with columns t or frame, object, x, y, z "
            "and optionally qw..qz or yaw, confidence, sigma; JSON; CLEVRER annotation). recording: motion in one or "
            "several runs, for the gap tools (the same table with columns run, spins wx..wz, theta of a body on "
            "a hinge). points: of deformable objects (also point). series: numbers over time (t or frame, object, "
            "quantity, value, sigma; quantity: amount with a column container, height, front_x..z, tension). Tables: "
            "CSV, also of Tracker, TrackMate, DeepLabCut, Logger Pro, Capstone; xlsx; cells not measured are empty. "
            "masks: of the video (folder of PNGs, "
            "COCO run-length JSON). camera: JSON. depth: npz or 16-bit PNGs. mesh: OBJ, STL, PLY, GLB"
        ),
    ],
    path: Annotated[str, Field(min_length=1, max_length=4096, description="file or folder on the server's machine")],
    columns: Annotated[
        dict[str, str] | None,
        Field(max_length=100, description="what headers of a table mean, as {'Y': 'z [mm]', 'u': 'x [2e-3 m]'}"),
    ] = None,
    seconds_per_frame: Annotated[float | None, Field(gt=0, le=1e4, description="of files without times [s]")] = None,
    position_sigma: Annotated[
        float | None, Field(gt=0, le=1e3, description="of tracks that state none [m]; default 0.01")
    ] = None,
    metres_per_unit: Annotated[
        float | None, Field(gt=0, le=1e3, description="unit of a depth map [m]; 0.001 for millimetres")
    ] = None,
    scale: Annotated[float, Field(gt=0, le=1e6, description="metres in one unit of a mesh file")] = 1.0,
    points_are: Annotated[
        Literal["markers", "centreline"],
        Field(description="points: marks on the material, or along a rope"),
    ] = "markers",
    value_sigma: Annotated[
        float | None, Field(gt=0, le=1e6, description="of series that state none, in their unit")
    ] = None,
    sealed_runs: Annotated[
        list[Annotated[str, Field(max_length=200)]] | None,
        Field(
            max_length=1000,
            description="runs held out from every fit and search. On them AddEffect shows what an "
            "effect is worth; default: the last quarter of the runs, or of a single run's time; []: none",
        ),
    ] = None,
) -> Answer:
    """Bring in what another program observed, in place of ObserveObjects or CalibrateCamera. Lengths are metres, z is
    up. The latest import counts; points and series join the tracks there are. Next: BuildWorld (after tracks or a
    recording), CalibrateCamera (after masks)."""
    found = app.case(case)
    with explained(), app.files.opened(path, "file_bytes" if kind == "depth" else "text_bytes") as place:
        if sealed_runs is not None and kind != "recording":
            raise ValueError(f"sealed_runs are runs of a recording; kind is {kind!r}")
        if columns and kind not in ("tracks", "recording", "points", "series"):
            raise ValueError(f"columns are of tables; kind is {kind!r}")
        form = RecordingForm(columns=columns or {}, seconds_per_frame=seconds_per_frame)
        if kind == "recording":
            return _recording_answer(found, keep_recording(app, found, place, sealed_runs, form))
        if kind == "tracks":
            record, remarks = importing.keep_tracks(app, found, place, form, position_sigma)
            return _tracks_answer(found, record, remarks)
        if kind == "points":
            record, read = importing.keep_points(app, found, place, points_are, form, position_sigma)
            return _tracks_answer(found, record, read.left_out)
        if kind == "series":
            record, read = importing.keep_series(app, found, place, form, value_sigma)
            return _tracks_answer(found, record, read.left_out)
        if kind == "masks":
            identifier, seen = importing.keep_masks(app, found, place)
            return observed_answer(found, identifier, seen)
        if kind == "camera":
            size = (int(found.facts["width"]), int(found.facts["height"])) if "width" in found.facts else None
            identifier, made = importing.keep_camera(app, found, place, size)
            return _camera_answer(found, identifier, made)
        if kind == "depth":
            content = importing.keep_depth(app, found, place, metres_per_unit, app.files.resolve(path))
        else:
            content = importing.keep_mesh(app, found, place, scale)
    step = f"BuildWorld(case={found.id!r})"
    if kind == "mesh":
        step = f"BuildWorld(case={found.id!r}, objects=[{{name, shape: {{kind: 'mesh', mesh: {content.id!r}}}}}])"
    return Answer(
        summary=f"{kind} {content.id} imported from {place.name}",
        data={
            kind: content.id,
            **content.document,
            "next": step,
        },
        case=found.id,
        observation=content.id,
    )


def _recording_answer(case: Case, imported: Imported) -> Answer:
    recording, sealed = imported.recording, imported.parts.held_out
    names = tuple(dict.fromkeys(name for run in recording.runs for name in run.names))
    rows = [
        {
            "run": run.name,
            "objects": list(run.names),
            "instants": len(run.times),
            "from": run.times[0],
            "to": run.times[-1],
            "orientations": bool(np.isfinite(run.orientations).any()),
            "spins": bool(np.isfinite(run.angular_velocities).any()),
            "sealed": sealed is not None and run.name in {r.name for r in sealed.runs},
        }
        for run in recording.runs
    ]
    objects = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    remarks = "".join(f". {remark}" for remark in imported.remarks)
    return Answer(
        summary=f"recording {imported.id}: {len(rows)} runs of {objects}; {imported.parts.summary}{remarks}",
        data={
            "recording": imported.id,
            "runs": rows,
            "objects": list(names),
            "sealed_data": imported.parts.summary,
            "remarks": list(imported.remarks),
            "next": f"BuildWorld(case={case.id!r}, objects=[{{name, shape, position, mass, ...}}, ...]) or world=JSON, "
            f"with these names of objects; then FindDiscrepancy(case={case.id!r})",
        },
        case=case.id,
        observation=imported.id,
        objects=names,
        interval=(min(float(r.times[0]) for r in recording.runs), max(float(r.times[-1]) for r in recording.runs)),
    )


def _tracks_answer(case: Case, record: TrackRecord, left_out: tuple[str, ...] = ()) -> Answer:
    tracks = record.tracks
    rows = []
    for item in record.objects:
        column = tracks.index(item.name)
        seen = np.flatnonzero(tracks.confidence[:, column] > 0)
        rows.append(
            {
                "name": item.name,
                "shape": item.shape,
                "color": item.color,
                "material": item.material,
                "first_frame": int(tracks.frames[seen[0]]) if len(seen) else None,
                "last_frame": int(tracks.frames[seen[-1]]) if len(seen) else None,
                "observed": len(seen),
            }
        )
    count = len(tracks.frames)
    span = (float(tracks.times[0]), float(tracks.times[-1])) if count else None
    shapes = series_rows(tracks.shapes, tracks.frames)
    more = f", {len(shapes)} shapes of {', '.join(sorted({s['object'] for s in shapes}))}" if shapes else ""
    off = 0.0 if tracks.clock is None else float(np.abs(tracks.clock - tracks.frames).max()) * tracks.seconds_per_frame
    own = f", measured at times of their own up to {off:.2g} s from those, which fits keep" if off > ROUNDED else ""
    return Answer(
        summary=f"tracks {record.id}: {len(rows)} objects{more} over {count} frames of "
        f"{tracks.seconds_per_frame:.6g} s{own}" + (f"; left out: {'; '.join(left_out)}" if left_out else ""),
        data={
            "tracks": record.id,
            "objects": rows,
            **({"shapes": shapes} if shapes else {}),
            **({"left_out": list(left_out)} if left_out else {}),
            "frames": [int(tracks.frames[0]), int(tracks.frames[-1])] if count else [],
            "seconds_per_frame": tracks.seconds_per_frame,
            "next": f"BuildWorld(case={case.id!r})",
        },
        case=case.id,
        observation=record.id,
        objects=tracks.observed_names,
        interval=span,
    )


class PointArgument(Argument):
    """A point whose place in the world and in the image is known."""

    world: Point = Field(description="x, y, z [m]; z is up")
    pixel: Pixel = Field(description="u to the right, v down; 0, 0: centre of the first pixel")


LENGTH_EXAMPLE = {"first_pixel": [40, 200], "second_pixel": [340, 200], "length": 1.5, "view": "side"}


class LengthArgument(Argument):
    """A known length in the plane of motion, seen from the side or from above without perspective."""

    first_pixel: Pixel = Field(description="u, v of one end [px]")
    second_pixel: Pixel = Field(description="u, v of the other end [px]")
    length: float = Field(gt=0, le=1e4, description="[m]")
    view: Literal["side", "top"] = Field(
        default="side", description="side: x right, z up, motion at y = 0; top: x right, y up, motion on the floor"
    )


class CameraArgument(Argument):
    """A camera that is known: pixel ~ K (R X + t), camera z forward, v down."""

    intrinsics: Matrix = Field(description="K, 3 x 3 [px]")
    rotation: Matrix = Field(description="R, 3 x 3, world axes to camera axes")
    translation: Point = Field(description="t, the world's origin in camera axes [m]")


@GROUP.tool("CalibrateCamera", title="Calibrate the camera", read_only=False, returns=CalibratedCamera)
def calibrate_camera(
    app: App,
    case: CaseId,
    points: Annotated[
        list[PointArgument] | None,
        Field(
            min_length=4,
            max_length=200,
            description="4 or more known points in a plane, or 6 in space; no three in a line",
            examples=[[{"world": [0.5, 0.35, 0], "pixel": [391, 97]}]],
        ),
    ] = None,
    homography: Annotated[
        Matrix | Unread | None, Field(description="3 x 3 map of (x, y, 1) at z = plane_z [m] to pixels")
    ] = None,
    plane_z: Annotated[float, Field(ge=-1e4, le=1e4, description="height of the homography's plane [m]")] = 0.0,
    known_length: Annotated[
        LengthArgument | None, Field(description="one known length [m], for a flat view", examples=[LENGTH_EXAMPLE])
    ] = None,
    camera: Annotated[CameraArgument | None, Field(description="the camera, where it is known")] = None,
    intrinsics: Annotated[Matrix | None, Field(description="K, to go with points or a homography")] = None,
    image_size: Annotated[
        list[Annotated[int, Field(gt=0, le=16384)]] | None,
        Field(min_length=2, max_length=2, description="width, height [px]; without a video"),
    ] = None,
) -> Answer:
    """Set how the image maps to the world, by exactly one of points, homography, known_length or camera. Returns the
    camera and its reprojection error. A later calibration replaces this one. Next: BuildWorld."""
    found = app.case(case)
    ways = {"points": points, "homography": homography, "known_length": known_length, "camera": camera}
    given = [name for name, value in ways.items() if value is not None]
    if len(given) != 1:
        refusal = f"CalibrateCamera takes exactly one of {', '.join(ways)}; got {' and '.join(given) or 'none'}"
        if given:
            raise ToolError(refusal)
        raise Question(
            refusal,
            f"What is known of lengths and places in {found.id!r}? Fill in one of both.",
            KnownPlaces,
            _with_places,
        )
    size = _image_size(found, image_size)
    view = None
    with explained():
        if points is not None:
            made = calibrate_from_points([p.world for p in points], [p.pixel for p in points], size, intrinsics)
        elif isinstance(homography, dict):
            raise ToolError(_matrix_within(homography))
        elif homography is not None:
            made = calibrate_from_homography(homography, size, plane_z=plane_z, intrinsics=intrinsics)
        elif known_length is not None:
            first, second = known_length.first_pixel, known_length.second_pixel
            view = known_length.view
            made = calibrate_from_known_length(first, second, known_length.length, size, view=view)
        else:
            assert camera is not None
            made = calibrate_given(camera.intrinsics, camera.rotation, camera.translation, size)
    inputs = plain({**ways, "plane_z": plane_z, "intrinsics": intrinsics, "size": size})
    content = keep_calibration(app, found, made, inputs, side_view=view == "side")
    return _camera_answer(found, content.id, made)


class KnownPlaces(BaseModel):
    """Ask a person for a length or for places where a call says nothing of the scale."""

    length: str = Field(
        default="", description="a known length [m] and the pixels of its ends: 0.30 120 200 400 200", max_length=200
    )
    points: str = Field(
        default="",
        description="4 or more points of the floor [m] with their pixels: 0 0 120 200; 1 0 400 200; ...",
        max_length=4000,
    )


def _with_places(arguments: dict[str, Any], known: KnownPlaces) -> dict[str, Any]:
    """Return the call with what a person has filled in; raises ToolError where that cannot be read."""
    try:
        if known.points.strip():
            rows = [[float(x) for x in row.split()] for row in known.points.replace(",", " ").split(";") if row.strip()]
            points = [{"world": [x, y, 0.0], "pixel": [u, v]} for x, y, u, v in rows]
            return {**arguments, "points": points}
        length, u0, v0, u1, v1 = (float(x) for x in known.length.replace(",", " ").split())
    except ValueError as error:
        raise ToolError(f"the answer could not be read as numbers ({error}); ask again, or give points") from error
    return {**arguments, "known_length": {"first_pixel": [u0, v0], "second_pixel": [u1, v1], "length": length}}


def _matrix_within(record: dict[str, Any]) -> str:
    """Advise what to give instead of a record that holds a homography."""
    held = [
        key
        for key, value in record.items()
        if isinstance(value, list) and [len(row) for row in value if isinstance(row, list)] == [3, 3, 3]
    ]
    where = f", here the value of {held[0]!r}" if held else f"; got an object with {list(record)}"
    rest = {key: value for key, value in record.items() if key not in held}
    others = ", ".join(f"{k}: {v}" for k, v in rest.items())
    advice = f". What else it says ({others}) goes into plane_z" if rest else ""
    return f"homography: give the 3 x 3 list itself{where}{advice}"


def _camera_answer(case: Case, identifier: str, made: Calibration) -> Answer:
    calibration = made.to_dict()
    errors = calibration.pop("errors")
    checked = "" if made.rms is None else f", {made.rms:.3g} px rms, at most {max(errors):.3g} px"
    unchecked = next((f"; {warning}" for warning in made.warnings if "nothing left over" in warning), "")
    return Answer(
        summary=f"camera: {made.method}{checked}{unchecked}",
        data={
            **calibration,
            "largest_error": max(errors, default=None),
            "compared": len(errors),
            "centre": made.camera.centre,
            "next": f"BuildWorld(case={case.id!r})",
        },
        case=case.id,
        observation=identifier,
    )


def _image_size(case: Case, given: list[int] | None) -> tuple[int, int]:
    if "width" in case.facts:
        width, height = int(case.facts["width"]), int(case.facts["height"])
        if given is not None and given != [width, height]:
            raise ToolError(f"image_size {given} is not the video's size [{width}, {height}]: leave it out")
        return width, height
    if given is None:
        raise ToolError(f"case {case.id!r} has no video: give image_size=[width, height]")
    return given[0], given[1]
