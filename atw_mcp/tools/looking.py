"""World inspection by eye: frames with what was observed, and rollouts over the frames they should follow."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray
from pydantic import Field

from atw_mcp import readouts
from atw_mcp.app import App
from atw_mcp.intervals import FrameRange, Seconds, chosen_span
from atw_mcp.names import chosen_names, object_name
from atw_mcp.observing import latest_image_observation, modelled_tracks, video_file
from atw_mcp.overlay import OBSERVED, SIMULATED, Canvas, Color, encoded
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import read_frames
from atw_mcp.results import Answer, explained
from atw_mcp.rollouts import checked_horizon, compute_rollout, stored_rollout
from atw_mcp.toolbox import ToolGroup
from atw_mcp.track_records import TrackRecord, at_rate
from evidence_store import Case
from polyworld.identification.accuracy import accuracy
from polyworld.render import Picture, default_camera, render
from polyworld.tracks import ObservedTracks
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import World

GROUP = ToolGroup("world inspection")

CaseId = Annotated[str, Field(description="case id, as OpenCase returned it")]
Objects = Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)]
Frames = Annotated[
    list[Annotated[int, Field(ge=0)]] | None,
    Field(description="frame numbers, from 0; default: spread over the whole video", min_length=1, max_length=12),
]
Pictures = Annotated[int, Field(ge=1, le=12, description="how many pictures when frames are not given")]
BORDER = 2  # [px] a mask this near to the image's edge touches it


@GROUP.tool("InspectFrames", title="Look at frames", pictures=True)
def inspect_frames(
    app: App,
    case: CaseId,
    frames: Frames = None,
    objects: Objects = None,
    pictures: Pictures = 6,
    plain: Annotated[bool, Field(description="the frames as they are, without outlines and names")] = False,
) -> Answer:
    """Pictures of video frames with the observed objects outlined and named. Before ObserveObjects, or with plain=true,
    the frames as they are. Pictures of large videos are reduced; pixel numbers in the text are those of the video."""
    found = app.case(case)
    with explained():
        path = video_file(found)
    seen = None if plain else latest_image_observation(app, found)
    count = int(found.facts["frame_count"])
    chosen = _chosen_frames(frames, pictures, 0, count - 1, "the video")
    observation = None if seen is None else seen[1]
    if observation is not None and frames is None:
        # an observation may have looked at every n-th frame only
        chosen = sorted({min(observation.frames, key=lambda f: abs(f - wanted)) for wanted in chosen})
    names = [] if observation is None else chosen_names(app, found, objects, list(observation.names))
    with explained():
        images = read_frames(path, chosen)
    frame_time = _seconds_per_frame(app, found)
    drawn, rows = {}, []
    for frame, image in zip(chosen, images, strict=True):
        canvas = Canvas.of(image)
        row: dict[str, Any] = {"frame": frame, "time": frame * frame_time}
        if observation is not None and frame in observation.frames:
            row["objects"] = _draw_observed(canvas, observation, names, frame, label=True)
        elif observation is not None:
            row["objects"] = None
        canvas.write(f"frame {frame}   {frame * frame_time:.3f} s", (8, 16))
        drawn[f"frame {frame}"] = canvas.image
        rows.append(row)
    what = "as they are" if observation is None else f"with {len(names)} objects outlined"
    return Answer(
        summary=f"frames {', '.join(map(str, chosen))} of {count} {what}",
        data={
            "frames": rows,
            "video": {"width": int(images.shape[2]), "height": int(images.shape[1]), "frames": count},
            "seconds_per_frame": frame_time,
        },
        case=found.id,
        observation=None if seen is None else seen[0],
        objects=tuple(names),
        interval=(chosen[0] * frame_time, chosen[-1] * frame_time),
        pictures=encoded(drawn),
    )


@GROUP.tool("InspectObservedMotion", title="Read an object's observed motion")
def inspect_observed_motion(
    app: App,
    case: CaseId,
    object: Annotated[str, Field(description="name of an observed object")],
    interval: Seconds = None,
    frames: FrameRange = None,
    limit: Annotated[int, Field(ge=2, le=500, description="rows shown, evenly spaced over the interval")] = 24,
) -> Answer:
    """What was measured of one object in the video, frame by frame: centroid and visible area of its mask in pixels,
    whether it touches the image border, its status and confidence, and its position in the world where the camera is
    calibrated. A measurement, not a simulation."""
    found = app.case(case)
    seen, record = latest_image_observation(app, found), _tracks(app, found, None)
    known = list(dict.fromkeys([*(seen[1].names if seen else ()), *(record.tracks.names if record else ())]))
    if not known:
        raise ToolError(f"nothing was observed in case {found.id!r} yet. Next: ObserveObjects or ImportObservation")
    name = object_name(app, found, object, known)
    frame_time = _seconds_per_frame(app, found)
    image = seen[1] if seen is not None and name in seen[1].names else None
    tracks = record.tracks if record is not None and name in record.tracks.names else None
    covered = sorted({*(image.frames if image else ()), *(tracks.frames.tolist() if tracks else ())})
    span = chosen_span(
        interval,
        frames,
        covered=(covered[0] * frame_time, covered[-1] * frame_time),
        seconds_per_frame=frame_time,
        further="Nothing was observed beyond it",
    )
    columns = ["frame", "time"]
    columns += ["u", "v", "area", "touches_border", "status", "confidence"] if image else []
    columns += ["x", "y", "z", "position_sigma", "position_confidence"] if tracks else []
    rows = [
        [frame, frame * frame_time, *_measured(image, name, frame), *_placed(tracks, name, frame)]
        for frame in covered
        if span.holds(frame * frame_time)
    ]
    data = {"object": name, "columns": columns, "rows": rows, "covers": span.shown(), "of": len(rows)}
    told = f"{name}: {len(rows)} frames"
    if image is not None:
        area = [row[columns.index("area")] for row in rows]
        told += f", visible in {sum(a > 0 for a in area)}, touches the border in {sum(bool(row[5]) for row in rows)}"
    if tracks is None:
        told += "; no world positions (CalibrateCamera and BuildWorld give them)"
    return Answer(
        summary=told,
        data=data,
        shown={**data, "rows": readouts.thinned(rows, limit)} if len(rows) > limit else None,
        case=found.id,
        observation=record.id if record is not None and tracks is not None else seen[0] if seen else None,
        objects=(name,),
        interval=span.seconds,
    )


@GROUP.tool("InspectRollout", title="Look at a rollout", pictures=True)
def inspect_rollout(
    app: App,
    case: CaseId,
    rollout: Annotated[str | None, Field(description="rollout id; default: the world below, over the video")] = None,
    world: Annotated[
        str | None, Field(description="world id, to look at before it is committed; default: committed, else latest")
    ] = None,
    frames: Annotated[
        list[Annotated[int, Field(ge=0)]] | None,
        Field(description="frame numbers; default: spread over the interval", min_length=1, max_length=12),
    ] = None,
    interval: Seconds = None,
    objects: Objects = None,
    pictures: Pictures = 6,
    background: Annotated[
        Literal["auto", "video", "rendered"],
        Field(
            description="video: drawn over the real frames; rendered: a picture of the simulated world. auto: video "
            "where the world should follow it, rendered for branches and beyond the video"
        ),
    ] = "auto",
) -> Answer:
    """See whether a world follows the video: the simulated objects outlined in magenta, with names and paths, over the
    real frames, the observed ones dotted in white; with the distance between the two for each object in the text. Works
    on draft worlds (for judging a fit), on the committed world, and on branches."""
    found = app.case(case)
    if rollout is not None and world is not None:
        raise ToolError("give rollout or world, not both: a rollout belongs to its world")
    if rollout is not None:
        of_case, shown_world, result = stored_rollout(app, rollout)
        if of_case.content != found.content:
            raise ToolError(f"{rollout} belongs to case {of_case.id!r}, not to {found.id!r}")
        identifier = rollout
    else:
        shown_world = app.world(found, world)
        with explained():
            identifier, result = compute_rollout(app, shown_world, checked_horizon(shown_world, None))
    view = _View(app, found, shown_world, result, background)
    span = chosen_span(
        interval,
        None,
        covered=(0.0, view.last_frame * view.frame_time),
        seconds_per_frame=view.frame_time,
        further="Next: Rollout with a longer horizon_seconds covers more",
    )
    names = chosen_names(app, found, objects, list(result.trajectory.names))
    first = int(np.ceil(span.start / view.frame_time - 1e-6))
    last = int(np.floor(span.end / view.frame_time + 1e-6))
    chosen = _chosen_frames(frames, pictures, first, last, "the rollout")
    drawn, rows = view.draw(chosen, names)
    fit = view.accuracy()
    return Answer(
        summary=_told_rollout(identifier, view, rows, fit),
        data={
            "rollout": identifier,
            "world": shown_world.id,
            "branch": not view.follows,
            "frames": rows,
            "error": None if fit is None else fit,
            "legend": "magenta: simulated outline and path; white dotted: observed outline",
            "camera": "the calibrated one" if shown_world.camera is not None else "a view from above and the side",
            "seconds_per_frame": view.frame_time,
        },
        case=found.id,
        world=shown_world.id,
        rollout=identifier,
        observation=view.record.id if view.record is not None else None,
        objects=tuple(names),
        interval=span.seconds,
        status=result.status,
        pictures=encoded(drawn),
    )


class _View:
    """A rollout beside what was observed of it."""

    def __init__(self, app: App, case: Case, world: World, result: Rollout, background: str) -> None:
        self.world, self.result = world, result
        self.frame_time = world.time.seconds_per_frame
        times = result.trajectory.times
        if not len(times):
            raise ToolError("this rollout diverged at once: there is nothing to see. ReadProperty shows its parameters")
        self.last_frame = int(np.floor(times[-1] / self.frame_time + 1e-6))
        # A branch is meant to differ from the video: measuring it against the video would mislead.
        self.follows = not any(d.how == "intervention" for d in app.store.worlds.parents(world.id))
        seen = latest_image_observation(app, case)
        self.observation = None if seen is None or not self.follows else seen[1]
        self.record = _tracks(app, case, world) if self.follows else None
        self.video: Path | None = None
        self.video_frames = 0
        self.camera = world.camera or default_camera(world, result.trajectory.positions)
        wanted = background == "video" or (background == "auto" and self.follows)
        if wanted and case.kind == "video" and world.camera is not None:
            with explained():
                self.video = video_file(case)
            self.video_frames = int(case.facts["frame_count"])
        elif background == "video":
            why = "the case has no video" if case.kind != "video" else "the world has no camera: CalibrateCamera first"
            raise ToolError(f"cannot draw over the video: {why}. background='rendered' always works")

    def draw(self, frames: list[int], names: list[str]) -> tuple[dict[str, NDArray[np.uint8]], list[dict[str, Any]]]:
        """Pictures by name, and what the text says about each."""
        drawn, rows = {}, []
        trajectory = self.result.trajectory
        wanted = [] if self.video is None else [frame for frame in frames if frame < self.video_frames]
        with explained():
            filmed = dict(zip(wanted, read_frames(self.video, wanted), strict=True)) if self.video and wanted else {}
        for frame in frames:
            sample = int(np.argmin(np.abs(trajectory.times - frame * self.frame_time)))
            picture = render(
                self.world,
                trajectory.positions[sample],
                trajectory.orientations[sample],
                self.camera,
                visible=trajectory.active[sample].tolist(),
            )
            real = frame in filmed
            base = filmed[frame] if real else np.ascontiguousarray(picture.color[..., ::-1])
            canvas = Canvas.of(np.asarray(base, dtype=np.uint8))
            observed = self.observation if self.observation and frame in self.observation.frames else None
            if observed is not None and real:
                _draw_observed(canvas, observed, [n for n in names if n in observed.names], frame, label=False)
            about = [self._draw_object(canvas, picture, name, sample, frame, observed, real) for name in names]
            _write_names(canvas, {name: picture.mask(trajectory.index(name)) for name in names}, SIMULATED)
            time = frame * self.frame_time
            canvas.write(f"frame {frame}   {time:.3f} s   " + ("over the video" if real else "simulated"), (8, 16))
            drawn[f"frame {frame}"] = canvas.image
            rows.append({"frame": frame, "time": time, "over_video": real, "objects": about})
        return drawn, rows

    def _draw_object(
        self,
        canvas: Canvas,
        picture: Picture,
        name: str,
        sample: int,
        frame: int,
        observed: ImageObservation | None,
        real: bool,
    ) -> dict[str, Any]:
        trajectory = self.result.trajectory
        column = trajectory.index(name)
        about: dict[str, Any] = {"name": name}
        if not trajectory.active[sample, column]:
            return {**about, "simulated": False, "why": "joins later"}
        mask = picture.mask(column)
        began = int(np.argmax(trajectory.active[:, column]))
        canvas.path(self.camera.project(trajectory.positions[began : sample + 1, column]), SIMULATED)
        if real:  # in a picture of the simulated world itself an outline would say nothing
            canvas.outline(mask, SIMULATED)
        about["visible_pixels"] = int(mask.sum())
        place = trajectory.positions[sample, column]
        about["position"] = place.tolist()
        if self.record is not None and name in self.record.tracks.names:
            tracks = self.record.tracks
            row = np.flatnonzero(tracks.frames == frame)
            if len(row) and tracks.confidence[row[0], tracks.index(name)] > 0:
                about["error_m"] = float(np.linalg.norm(place - tracks.positions[row[0], tracks.index(name)]))
        if observed is not None and name in observed.names:
            theirs = observed.mask(name, frame)
            if theirs.any() and mask.any():
                overlap = (mask & theirs).sum() / (mask | theirs).sum()
                about["overlap"] = round(float(overlap), 3)
                about["error_px"] = float(np.linalg.norm(_centroid(mask) - _centroid(theirs)))
        return about

    def accuracy(self) -> dict[str, Any] | None:
        """Root mean square errors over every observed frame that the rollout covers; None without tracks."""
        if self.record is None:
            return None
        tracks = at_rate(self.record.tracks, self.frame_time).window(0, self.last_frame)
        if not len(tracks.frames) or not set(tracks.names) & set(self.result.trajectory.names):
            return None
        with explained():
            return accuracy(self.world, tracks, _sampled(self.result.trajectory, tracks)).to_dict()


def _sampled(trajectory: Trajectory, tracks: ObservedTracks) -> Trajectory:
    rows = [int(np.argmin(np.abs(trajectory.times - time))) for time in tracks.times]
    return Trajectory(
        names=trajectory.names,
        times=trajectory.times[rows],
        positions=trajectory.positions[rows],
        orientations=trajectory.orientations[rows],
        velocities=trajectory.velocities[rows],
        angular_velocities=trajectory.angular_velocities[rows],
        active=trajectory.active[rows],
    )


def _told_rollout(identifier: str, view: _View, rows: list[dict[str, Any]], fit: dict[str, Any] | None) -> str:
    told = f"{identifier}: {len(rows)} pictures"
    if not view.follows:
        return told + " of a branch; it is meant to differ from the video, so no error is given"
    if fit is None or fit["position_rmse"] is None:
        return told + "; nothing observed to compare with"
    each = ", ".join(
        f"{name} {value:.3g}" for name, value in fit["position_rmse_by_object"].items() if value is not None
    )
    return told + f"; distance to the observed positions {fit['position_rmse']:.3g} m rms ({each})"


def _draw_observed(
    canvas: Canvas, observation: ImageObservation, names: list[str], frame: int, *, label: bool
) -> list[dict[str, Any]]:
    row, told = observation.row(frame), []
    for name in names:
        seen = observation.object(name)
        about: dict[str, Any] = {"name": name, "status": seen.status[row]}
        if seen.area[row] > 0:
            mask = observation.mask(name, frame)
            if label:
                canvas.outline(mask, OBSERVED)
            else:
                canvas.outline(mask, OBSERVED, "dotted")
            about["centroid"] = np.round(seen.centroid[row], 1).tolist()
            about["area"] = int(seen.area[row])
            about["confidence"] = round(float(seen.confidence[row]), 3)
        told.append(about)
    if label:
        _write_names(canvas, {name: observation.mask(name, frame) for name in names}, OBSERVED)
    return told


def _write_names(canvas: Canvas, masks: dict[str, NDArray[np.bool_]], color: Color) -> None:
    """Names on top of every outline, from the top of the picture down: most then find room above their object."""
    for name, mask in sorted(masks.items(), key=lambda item: int(np.argmax(item[1].any(axis=1)))):
        canvas.name(name, mask, color)


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
    sigma, confidence = tracks.position_sigma[row[0], column], tracks.confidence[row[0], column]
    return [*tracks.positions[row[0], column].tolist(), float(sigma), float(confidence)]


def _centroid(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def _chosen_frames(frames: list[int] | None, pictures: int, first: int, last: int, what: str) -> list[int]:
    if frames is None:
        return sorted({round(f) for f in np.linspace(first, last, pictures)})
    outside = [frame for frame in frames if not first <= frame <= last]
    if outside:
        raise ToolError(f"frames {outside} are outside {what}: choose among {first}..{last}")
    return list(dict.fromkeys(frames))


def _tracks(app: App, case: Case, world: World | None) -> TrackRecord | None:
    """The track record a world models, else the case's latest; None where there is none."""
    kinds = {kind for kind, _ in app.store.cases.observations(case.id)}
    if "tracks" not in kinds:
        return None
    with explained():
        return modelled_tracks(app, case, world if world is not None else World())


def _seconds_per_frame(app: App, case: Case) -> float:
    """Physical time between frames as the case's world has it, else as the file states it."""
    if app.store.cases.worlds(case.id):
        return app.world(case).time.seconds_per_frame
    rate = float(case.facts.get("frames_per_second") or 0.0)
    if rate > 0:
        return 1.0 / rate
    record = _tracks(app, case, None)
    return record.tracks.seconds_per_frame if record is not None else 1.0
