"""World inspection by eye: frames with what was observed, and how an object moved by what was observed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.intervals import FrameRange, Seconds, chosen_span
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.names import chosen_names, object_name
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.looking.overlay import Canvas, Crop, encoded
from atw_mcp.looking.picture_rows import EVERY_FRAME, observed_rows
from atw_mcp.looking.residual_view import ResidualView
from atw_mcp.observation.observed_quantities import Quantity, observed_quantities
from atw_mcp.observation.observing import (
    chosen_image_observation,
    latest_image_observation,
    moment_of,
    tracks_of_observation,
    video_file,
)
from atw_mcp.observation.periods import period_in_words
from atw_mcp.observation.track_records import at_rate
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import PerceptionCancelled, read_frames
from atw_mcp.probing import readouts
from atw_mcp.probing.rollout_view import case_tracks, draw_observed
from atw_mcp.results.looking import ObservedMotion, OutlinedFrames, PlainFrames
from evidence_store import Case
from polyworld.data.tracks import ObservedTracks

GROUP = ToolGroup("world inspection")

CaseId = Annotated[str, Field(description="case id")]
Objects = Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)]
Frames = Annotated[
    list[Annotated[int, Field(ge=0)]] | None,
    Field(description="frame numbers, from 0; default: spread over the video", min_length=1, max_length=12),
]
ObservationId = Annotated[str | None, Field(description="observation id, as OpenCase lists them; default: the latest")]
Pictures = Annotated[int, Field(ge=1, le=12, description="how many, when frames are not given")]
FILE_TIME = "times are the file's: BuildWorld(seconds_per_frame=...) or FitWorld gives physical ones"
PATIENCE = 40.0  # [s]
BORDER = 2  # [px] a mask this near to the image's edge touches it


@GROUP.tool("InspectFrames", title="Look at frames", pictures=True, returns=PlainFrames | OutlinedFrames)
def inspect_frames(
    app: App,
    case: CaseId,
    frames: Frames = None,
    objects: Objects = None,
    pictures: Pictures = 6,
    plain: Annotated[bool, Field(description="without outlines and names")] = False,
    observation: ObservationId = None,
    crop: Annotated[
        list[Annotated[int, Field(ge=0, le=16384)]] | None,
        Field(min_length=4, max_length=4, description="left, top, width, height [px]"),
    ] = None,
    zoom: Annotated[float | None, Field(gt=0, le=32, description="how many times as large; default: legible")] = None,
    residual: Annotated[
        bool,
        Field(
            description="beside each frame, what no object explains. It shows in yellow what is neither background, "
            "shadow nor an object; silhouettes filled; each object's confidence over time (white: frames in which it "
            "was outlined)"
        ),
    ] = False,
) -> Answer | LongWork:
    """Pictures of video frames with the observed objects outlined and named. Before ObserveObjects, or with plain=true,
    the frames as they are. Pictures of large videos are reduced; pixel numbers in the text are those of the video."""
    found = app.case(case)
    seen: tuple[str, ImageObservation | None]
    with explained():
        path = video_file(app, found)
        if plain and (residual or observation is not None):
            raise ValueError("plain=true shows no observation: leave it out, or observation and residual")
        if observation is not None or residual:
            seen = chosen_image_observation(app, found, observation)
        else:
            latest = None if plain else latest_image_observation(app, found)
            seen = ("", None) if latest is None else latest
    count = int(found.facts["frame_count"])
    chosen = chosen_frames(frames, pictures, 0, count - 1, "the video")
    if seen[1] is not None and (frames is None or residual):
        # an observation may have looked at every n-th frame only
        observed = seen[1].frames
        chosen = sorted({min(observed, key=lambda f: abs(f - wanted)) for wanted in chosen})
    names = [] if seen[1] is None else chosen_names(app, found, objects, list(seen[1].names))
    part = None if crop is None else (crop[0], crop[1], crop[2], crop[3])
    request = _FrameRequest(tuple(chosen), tuple(names), part, zoom)
    with explained():
        images = read_frames(path, chosen)
        Canvas.of(images[0], part, zoom)
    if not residual or seen[1] is None:
        return _frames_answer(app, found, request, images, seen, None)
    drawn_of = seen[1]

    def work(progress: Progress) -> Answer:
        def stop() -> None:
            if progress.cancelled():
                raise PerceptionCancelled("cancelled")

        progress.report(0.0, 1.0, "modelling the background")
        view = ResidualView(path, drawn_of, stop)
        return _frames_answer(app, found, request, images, seen, view)

    draft = Answer(summary="looking for what no object explains", data={}, case=found.id, observation=seen[0])
    return LongWork(f"residual of {seen[0]} {request!r}", work, draft, PATIENCE)


@dataclass(frozen=True)
class _FrameRequest:
    """Which frames are shown, of which objects, and which part of them how large."""

    frames: tuple[int, ...]
    names: tuple[str, ...]
    crop: Crop | None
    zoom: float | None


def _frames_answer(
    app: App,
    case: Case,
    request: _FrameRequest,
    images: NDArray[np.uint8],
    seen: tuple[str, ImageObservation | None],
    view: ResidualView | None,
) -> Answer:
    identifier, observation = seen
    names, count = list(request.names), int(case.facts["frame_count"])
    frame_time = _seconds_per_frame(app, case)
    # Before a world says otherwise, the time is what the file states, which need not be physical time.
    clock = "" if app.store.cases.worlds(case.id) else " (file time)"
    drawn, rows = {}, []
    for frame, image in zip(request.frames, images, strict=True):
        canvas = Canvas.of(image, request.crop, request.zoom)
        time = moment_of(case, frame) * frame_time
        row: dict[str, Any] = {"frame": frame, "time": time}
        if observation is not None and frame in observation.frames:
            row["objects"] = draw_observed(canvas, observation, names, frame, label=True)
        elif observation is not None:
            row["objects"] = None
        canvas.write(f"frame {frame}   {time:.3f} s{clock}", (8, 16))
        picture = canvas.image
        if view is not None:
            row["unexplained_px"] = int(view.unexplained(frame).sum())
            picture = np.hstack([picture, view.beside(image, frame, names, request.crop, request.zoom)])
            picture = np.vstack([picture, view.strips(names, frame, picture.shape[1])])
        drawn[f"frame {frame:06d}"] = picture
        rows.append(row)
    what = "as they are" if observation is None else f"with {len(names)} objects outlined"
    facts: dict[str, Any] = {
        "video": {"width": int(images.shape[2]), "height": int(images.shape[1]), "frames": count},
        "seconds_per_frame": frame_time,
        "time_is": "file time" if clock else "physical time",
    }
    if view is not None:
        facts["unexplained_px"] = [row["unexplained_px"] for row in rows]
    shown_frames = ", ".join(map(str, request.frames))
    files, scale = encoded(drawn)
    scale *= canvas.scale
    sized = "" if scale == 1.0 else f", pictures {scale:.3g} times the video's size"
    return Answer(
        summary=f"frames {shown_frames} of {count} {what}{sized}{'; ' * bool(clock)}{FILE_TIME * bool(clock)}",
        data={"frames": rows, **facts},
        shown=None if observation is None else {**observed_rows(rows), **facts, "every_frame": EVERY_FRAME},
        case=case.id,
        observation=identifier or None,
        objects=tuple(names),
        interval=(rows[0]["time"], rows[-1]["time"]),
        pictures=files,
    )


@GROUP.tool("InspectObservedMotion", title="Read an object's observed motion", returns=ObservedMotion)
def inspect_observed_motion(
    app: App,
    case: CaseId,
    object: Annotated[str, Field(description="name of an observed object")],
    interval: Seconds = None,
    frames: FrameRange = None,
    limit: Annotated[int, Field(ge=2, le=500, description="rows shown, evenly spaced over the interval")] = 24,
    quantities: Annotated[
        list[Quantity] | None,
        Field(
            description="what to derive from the positions, with 90% intervals; momentum and "
            "energies take the mass from the case's world. Default: none",
            min_length=1,
            max_length=8,
        ),
    ] = None,
    observation: ObservationId = None,
) -> Answer:
    """Return measurements of one object in the video, frame by frame: centroid and visible area of its mask in pixels,
    whether it touches the image border, its status and confidence, and its position in the world where the camera is
    calibrated. With quantities also velocity, acceleration, momentum, energy and the period of a motion to and fro,
    with 90% intervals. A measurement, not a simulation."""
    found = app.case(case)
    if observation is None:
        seen, record = latest_image_observation(app, found), case_tracks(app, found, None)
    else:
        with explained():
            seen = chosen_image_observation(app, found, observation)
        record = tracks_of_observation(app, found, seen[0])
    outdated = seen is not None and record is not None and record.source.get("objects", seen[0]) != seen[0]
    record = None if outdated else record  # places of what was seen before are not those of these pixels
    known = list(dict.fromkeys([*(seen[1].names if seen else ()), *(record.tracks.names if record else ())]))
    if not known:
        raise ToolError(f"nothing was observed in case {found.id!r} yet. Next: ObserveObjects or ImportObservation")
    name = object_name(app, found, object, known)
    frame_time = _seconds_per_frame(app, found)
    image = seen[1] if seen is not None and name in seen[1].names else None
    tracks = record.tracks if record is not None and name in record.tracks.names else None
    covered = sorted({*(image.frames if image else ()), *(tracks.frames.tolist() if tracks else ())})
    clocked = None if tracks is None else at_rate(tracks, frame_time)

    def time_of(frame: int) -> float:
        return moment_of(found, frame) * frame_time if clocked is None else clocked.time_of(frame)

    times = [time_of(frame) for frame in covered]
    if interval is None and frames is not None and frames[0] <= frames[1]:
        interval, frames = [time_of(frames[0]), time_of(frames[1])], None
    span = chosen_span(
        interval,
        frames,
        covered=(times[0], times[-1]),
        seconds_per_frame=frame_time,
        further="Nothing was observed beyond it",
    )
    columns = ["frame", "time"]
    columns += ["u", "v", "area", "touches_border", "status", "confidence"] if image else []
    columns += ["x", "y", "z", "position_sigma", "position_confidence"] if tracks else []
    missing = {} if record is None else record.source.get("unplaced", {}).get(name, [])
    rows = [
        [frame, time, *_measured(image, name, frame), *_placed(tracks, name, frame)]
        for frame, time in zip(covered, times, strict=True)
        if span.holds(time)
    ]
    data: dict[str, Any] = {"object": name, "columns": columns, "rows": rows, "covers": span.shown(), "of": len(rows)}
    if missing:
        data["no_position"] = missing
    summary = f"{name}: {len(rows)} frames"
    shown = {**data, "rows": readouts.thinned(rows, limit)} if len(rows) > limit else None
    if quantities is not None:
        if tracks is None:
            raise ToolError(f"quantities need world positions of {name!r}: CalibrateCamera and BuildWorld give them")
        world = app.world(found) if app.store.cases.worlds(found.id) else None
        derived = observed_quantities(tracks, world, name, quantities, *span.seconds)
        data["derived"] = derived
        shown = {
            **(shown or data),
            "derived": {**derived, "rows": readouts.thinned(derived["rows"], limit)},
        }
        summary += f"; derived {', '.join(quantities)}{period_in_words(derived)}"
    if image is not None:
        area = [row[columns.index("area")] for row in rows]
        at_border = sum(bool(row[5]) for row in rows)
        summary += f", visible in {sum(a > 0 for a in area)}, touches the border in {at_border}"
    if tracks is None:
        before = "; those known are of an earlier observation" if outdated else ""
        summary += f"; no world positions (CalibrateCamera and BuildWorld give them{before})"
    return Answer(
        summary=summary,
        data=data,
        shown=shown,
        case=found.id,
        observation=record.id if record is not None and tracks is not None else seen[0] if seen else None,
        objects=(name,),
        interval=span.seconds,
    )


def _measured(image: ImageObservation | None, name: str, frame: int) -> list[Any]:
    if image is None:
        return []
    if frame not in image.frames:
        return [None] * 6
    seen, row = image.object(name), image.row(frame)
    u, v = seen.centroid[row]
    left, top, width, height = seen.box[row]
    touches = bool(
        left < BORDER
        or top < BORDER
        or left + width > image.video.width - BORDER
        or top + height > image.video.height - BORDER
    )
    return [float(u), float(v), int(seen.area[row]), touches, seen.status[row], float(seen.confidence[row])]


def _placed(tracks: ObservedTracks | None, name: str, frame: int) -> list[Any]:
    if tracks is None:
        return []
    row, column = np.flatnonzero(tracks.frames == frame), tracks.index(name)
    if not len(row):
        return [None] * 5
    sigma, confidence = tracks.coordinate_sigma[row[0], column], tracks.confidence[row[0], column]
    return [*tracks.positions[row[0], column].tolist(), float(sigma), float(confidence)]


def chosen_frames(
    frames: list[int] | None, pictures: int, first: int, last: int, what: str, further: str = ""
) -> list[int]:
    if frames is None:
        return sorted({round(f) for f in np.linspace(first, last, pictures)})
    outside = [frame for frame in frames if not first <= frame <= last]
    if outside:
        raise ToolError(
            f"frames {outside} are outside {what}: choose among {first}..{last}" + (f". {further}" if further else "")
        )
    return list(dict.fromkeys(frames))


def _seconds_per_frame(app: App, case: Case) -> float:
    """Physical time between frames as the case's world has it, else as the file states it."""
    if app.store.cases.worlds(case.id):
        return app.world(case).time.seconds_per_frame
    rate = float(case.facts.get("frames_per_second") or 0.0)
    if rate > 0:
        return 1.0 / rate
    record = case_tracks(app, case, None)
    return record.tracks.seconds_per_frame if record is not None else 1.0
