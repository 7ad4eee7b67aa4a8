"""A rollout beside what was observed: pictures of both, and how far apart they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.calls.results import explained
from atw_mcp.looking.legend import Entry, arrow, cross, dot, legend, line, star
from atw_mcp.looking.overlay import OBSERVED, SIMULATED, SIMULATED_NAME, Canvas
from atw_mcp.looking.plan_frame import PlanFrame, round_length
from atw_mcp.looking.plan_view import CROWD, EVENT, PlanView, pathless, plan_frame, short_names
from atw_mcp.observation.observing import (
    chosen_image_observation,
    latest_image_observation,
    modelled_tracks,
    moment_of,
    video_file,
)
from atw_mcp.observation.track_records import TrackRecord, at_rate
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import read_frames
from atw_mcp.probing.marked_events import marked_events
from atw_mcp.probing.misfits import Misfit, misfits
from atw_mcp.worlds.marks import LEGEND, WorldMarks
from evidence_store import Case
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import accuracy
from polyworld.pictures.contact_shadow import with_contact_shadows
from polyworld.pictures.render import Picture, default_camera, render
from polyworld.probing.compare import positions_at
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import World, geometry

SOME = 12  # samples of a trajectory that the default camera looks at


class RolloutView:
    """A rollout beside what was observed of it."""

    def __init__(self, app: App, case: Case, world: World, result: Rollout, background: str) -> None:
        self.world, self.result = world, result
        self.pathless = pathless(world)
        self.frame_time = world.time.seconds_per_frame
        times = result.trajectory.times
        if not len(times):
            raise ToolError("this rollout diverged at once: there is nothing to see. ReadProperty shows its parameters")
        self.last_frame = int(np.floor(times[-1] / self.frame_time + 1e-6))
        self.mark_every = round_length(max(times[-1], self.frame_time) / 5) if times[-1] > 0 else self.frame_time
        self.events = marked_events(world, result)
        frame_count = world.time.frame_count
        self.axes: PlanFrame | None = None  # of the plan, once drawn
        # A branch is meant to differ from the video: measuring it against the video would mislead.
        self.follows = not any(d.how == "intervention" for d in app.store.worlds.parents(world.id))
        self.record = case_tracks(app, case, world) if self.follows else None
        self._clock = [moment_of(case, frame) for frame in range(self.last_frame + 1)]
        taken = np.array(self._clock) * self.frame_time
        if not np.array_equal(self._clock, np.arange(len(taken))):
            taken = np.concatenate([taken[taken <= times[-1]], times[times > taken[-1] + 1e-9]])
            self.result = replace(result, trajectory=_sampled(result.trajectory, taken))
        self.marks = [self._nearest(t) for t in np.arange(0.0, times[-1] + 1e-9, self.mark_every)]
        self.dashed_from = self._sample(frame_count - 1) if 2 <= frame_count <= self.last_frame else None
        self.observation = self._modelled(app, case) if self.follows else None
        self.video: Path | None = None
        self.video_frames = 0
        self.camera = world.camera or default_camera(world, everywhere(world, result.trajectory))
        self.marks_of_world = WorldMarks(world, result.trajectory, self.camera)
        wanted = background == "video" or (background == "auto" and self.follows)
        if wanted and case.kind == "video" and world.camera is not None:
            with explained():
                self.video = video_file(app, case)
            self.video_frames = int(case.facts["frame_count"])
        elif background == "video":
            why = "the case has no video" if case.kind != "video" else "the world has no camera: CalibrateCamera first"
            raise ToolError(f"cannot draw over the video: {why}. background='rendered' always works")

    def draw(self, frames: list[int], names: list[str]) -> tuple[dict[str, NDArray[np.uint8]], list[dict[str, Any]]]:
        """Pictures by name, each with the plan beside it, and what the text says about each."""
        drawn, rows = {}, []
        trajectory = self.result.trajectory
        wanted = [] if self.video is None else [frame for frame in frames if frame < self.video_frames]
        with explained():
            filmed = dict(zip(wanted, read_frames(self.video, wanted), strict=True)) if self.video and wanted else {}
        samples = [self._sample(frame) for frame in frames]
        short = short_names(names)
        for frame, sample in zip(frames, samples, strict=True):
            visible = trajectory.active[sample].tolist()
            place, turn = trajectory.positions[sample], trajectory.orientations[sample]
            points = {name: motion.points[sample] for name, motion in trajectory.deformables.items()}
            picture = render(self.world, place, turn, self.camera, points=points, visible=visible)
            real = frame in filmed
            if real:
                base = filmed[frame]
            else:
                color = with_contact_shadows(
                    self.world, place, turn, self.camera, picture, points=points, visible=visible
                )
                base = np.ascontiguousarray(color[..., ::-1])
            canvas = Canvas.of(np.asarray(base, dtype=np.uint8))
            observed = self.observation if self.observation and frame in self.observation.frames else None
            self.marks_of_world.draw(canvas, sample)
            since = self._since(sample, names)
            about = [self._draw_object(canvas, picture, name, sample, frame, observed, real, since) for name in names]
            if observed is not None and real:
                draw_observed(canvas, observed, [n for n in names if n in observed.names], frame, label=False)
            objects = (picture.labels >= 0) & (picture.labels < len(trajectory.names))
            if observed is not None and real:
                for name in observed.names:
                    objects |= observed.mask(name, frame)
            masks = {short[name]: picture.mask(trajectory.index(name)) for name in names}
            canvas.names(masks, SIMULATED_NAME, objects)
            time = self._time(frame)
            canvas.write(f"frame {frame}   {time:.3f} s   " + ("over the video" if real else "simulated"), (8, 16))
            self.axes = self.axes or plan_frame(
                [(self.world, trajectory)], self.camera, names, samples, len(canvas.image)
            )
            plan = PlanView(self.world, trajectory, self.axes, names)
            measured = self._observed_places(names, frame)
            strip = plan.draw(sample, self.marks, self.dashed_from, measured, self.events, since)
            gap = np.full((len(strip), 3, 3), 255, np.uint8)
            whole = np.concatenate([canvas.image, gap, strip], axis=1)
            # Stored pictures come back in the order of their names.
            drawn[f"frame {frame:06d}"] = np.concatenate([whole, legend(self._entries(names), whole.shape[1])])
            rows.append({"frame": frame, "time": time, "over_video": real, "objects": about})
        off = [m for m in self._misfits() if m.name in names and np.isfinite(m.distance).any()]
        if off and self.axes is not None:
            from atw_mcp.probing.misfit_picture import misfit_picture  # matplotlib is slow to import

            drawn["off the measured positions"] = misfit_picture(off, self.axes)
        return drawn, rows

    def _misfits(self) -> list[Misfit]:
        """How far every observed object is off, in every frame that was observed."""
        if self.record is None:
            return []
        return misfits(self.world, self.result.trajectory, at_rate(self.record.tracks, self.frame_time))

    def _modelled(self, app: App, case: Case) -> ImageObservation | None:
        """The observation of the video that the world models, else the latest."""
        source = None if self.record is None else self.record.source.get("objects")
        if source is not None:
            return chosen_image_observation(app, case, source)[1]
        latest = latest_image_observation(app, case)
        return None if latest is None else latest[1]

    def _time(self, frame: int) -> float:
        """When a frame was taken [s]."""
        return self._clock[frame] * self.frame_time

    def _sample(self, frame: int) -> int:
        return self._nearest(self._time(frame))

    def _nearest(self, time: float) -> int:
        return int(np.argmin(np.abs(self.result.trajectory.times - time)))

    def _observed_places(self, names: list[str], frame: int) -> dict[str, NDArray[np.float64]]:
        """Measured positions (3,) [m] in one frame, of the objects that have one."""
        if self.record is None:
            return {}
        tracks = self.record.tracks
        row = np.flatnonzero(tracks.frames == frame)
        known = [name for name in names if len(row) and name in tracks.names]
        return {
            name: tracks.positions[row[0], tracks.index(name)]
            for name in known
            if tracks.confidence[row[0], tracks.index(name)] > 0
        }

    def _draw_object(
        self,
        canvas: Canvas,
        picture: Picture,
        name: str,
        sample: int,
        frame: int,
        observed: ImageObservation | None,
        real: bool,
        since: int,
    ) -> dict[str, Any]:
        trajectory = self.result.trajectory
        column = trajectory.index(name)
        about: dict[str, Any] = {"name": name}
        if not trajectory.active[sample, column]:
            return {**about, "simulated": False, "why": "joins later"}
        mask = picture.mask(column)
        began = max(int(np.argmax(trajectory.active[:, column])), since)
        points = self.camera.project(trajectory.positions[began : sample + 1, column])
        dashed = None if self.dashed_from is None else max(self.dashed_from - began, 0)
        if name not in self.pathless:  # the centre of a rope or a fluid is nothing that can be seen
            dots = [m - began for m in self.marks if began <= m <= sample and not since]
            canvas.path(points, SIMULATED, dots, dashed)
        if real:  # in a picture of the simulated world itself an outline would say nothing
            canvas.outline(mask, SIMULATED)
        about["visible_pixels"] = int(mask.sum())
        place = trajectory.positions[sample, column]
        about["position"] = place.tolist()
        for measured in self._observed_places([name], frame).values():
            about["error_m"] = float(np.linalg.norm(place - measured))
        if observed is not None and name in observed.names:
            theirs = observed.mask(name, frame)
            if theirs.any() and mask.any():
                overlap = (mask & theirs).sum() / (mask | theirs).sum()
                about["overlap"] = round(float(overlap), 3)
                about["error_px"] = float(np.linalg.norm(_centroid(mask) - _centroid(theirs)))
        return about

    def legend(self, names: list[str]) -> str:
        """Explain the colours and lines of the pictures that `draw` made."""
        legend = "magenta: simulated outline (over the video) and path up to the frame; "
        plane = "the plan" if self.axes is None else self.axes.shows
        legend += f"right: {plane}, to scale in metres of the world, with paths to come dotted"
        if self.observation is not None or self.record is not None:
            legend += "; white dashes: observed outline; white crosses in the plan: observed positions, "
            legend += "with a line to where the object is simulated"
        if self.record is not None:
            legend += (
                "; last picture: where and when objects are off, in m and in standard deviations of the measurement"
            )
        if self.events:
            legend += "; yellow stars in the plan: collisions, hollow: to come"
        short = short_names(names)
        if len(names) > CROWD:
            legend += f"; paths and collisions of the last {2 * self.mark_every:g} s; objects are written as "
            legend += ", ".join(f"{text} {name}" for name, text in short.items())
        else:
            legend += f"; dots on paths every {self.mark_every:g} s"
        if self.marks_of_world.any:
            legend += f"; {LEGEND}"
        if self.dashed_from is None:
            return legend
        return legend + f"; paths dashed after frame {self.world.time.frame_count - 1}, the last observed"

    def _entries(self, names: list[str]) -> list[Entry]:
        """Return the legend that is drawn below a picture."""
        found = []
        if self.video is not None:
            found.append(Entry("simulated outline", line(SIMULATED)))
        if self.video is not None and self.observation is not None:
            found.append(Entry("observed outline", line(OBSERVED, "dashed")))
        if self.record is not None:
            found.append(Entry("observed position", cross(OBSERVED)))
        if len(names) > CROWD:
            found.append(Entry(f"path, last {2 * self.mark_every:g} s", line(SIMULATED)))
        else:
            found.append(Entry("path", arrow(SIMULATED)))
            found.append(Entry("path to come", line(SIMULATED, thin=True)))
            found.append(Entry(f"every {self.mark_every:g} s", dot(SIMULATED)))
        if self.dashed_from is not None:
            last = (self.world.time.frame_count - 1) * self.frame_time
            found.append(Entry(f"path beyond {last:.3g} s, the last observed", line(SIMULATED, "dashed")))
        if self.events:
            found.append(Entry("collision", star(EVENT)))
            if len(names) <= CROWD:
                found.append(Entry("collision to come", star(EVENT, filled=False)))
        return found

    def _since(self, sample: int, names: list[str]) -> int:
        """Return the sample from which paths are drawn: the first, but for a crowd only the last two marks."""
        past = [m for m in self.marks if m <= sample]
        return 0 if len(names) <= CROWD or len(past) < 2 else past[-2]

    def accuracy(self) -> dict[str, Any] | None:
        """Root mean square errors over every observed frame that the rollout covers; None without tracks."""
        tracks = self._compared_tracks()
        if tracks is None:
            return None
        with explained():
            return accuracy(self.world, tracks, _sampled(self.result.trajectory, tracks.times)).to_dict()

    def worst_errors(self) -> dict[str, tuple[float, int]]:
        """The largest distance [m] to the observed position and its frame, over every observed frame, by object."""
        tracks = self._compared_tracks()
        if tracks is None:
            return {}
        simulated, worst = _sampled(self.result.trajectory, tracks.times), {}
        normal = geometry.plane_axes(self.world.environment.motion_plane)[2]
        for name in tracks.names:
            if name not in simulated.names:
                continue
            column, theirs = simulated.index(name), tracks.index(name)
            apart = simulated.positions[:, column] - tracks.positions[:, theirs]
            if self.world.planar:  # as `accuracy` compares: in the plane
                apart = apart - np.outer(apart @ normal, normal)
            distance = np.linalg.norm(apart, axis=1)
            known = (tracks.confidence[:, theirs] > 0) & simulated.active[:, column] & np.isfinite(distance)
            if known.any():
                row = int(np.argmax(np.where(known, distance, -1.0)))
                worst[name] = float(distance[row]), int(tracks.frames[row])
        return worst

    def _compared_tracks(self) -> ObservedTracks | None:
        """Return the tracks that the rollout can be compared with; None where nothing observed is in it."""
        if self.record is None:
            return None
        tracks = at_rate(self.record.tracks, self.frame_time).window(0, self.last_frame)
        return tracks if len(tracks.frames) and set(tracks.names) & set(self.result.trajectory.names) else None


def everywhere(world: World, trajectory: Trajectory) -> NDArray[np.float64]:
    """Places (k, 3) [m] that a picture of a rollout should show: centres of bodies, some of all points."""
    places = [trajectory.positions[:, : len(world.objects)].reshape(-1, 3)]
    for motion in trajectory.deformables.values():
        rows = np.unique(np.linspace(0, len(motion.points) - 1, SOME).astype(int))
        places.append(motion.points[rows][:, :: max(1, motion.points.shape[1] // 2000)].reshape(-1, 3))
    return np.concatenate(places)


def draw_observed(
    canvas: Canvas, observation: ImageObservation, names: list[str], frame: int, *, label: bool
) -> list[dict[str, Any]]:
    """Outline observed objects on a frame: solid with names (label), or dashed; returns what was measured of each."""
    row, measured = observation.row(frame), []
    for name in names:
        seen = observation.object(name)
        about: dict[str, Any] = {"name": name, "status": seen.status[row]}
        if seen.area[row] > 0:
            mask = observation.mask(name, frame)
            if label:
                canvas.outline(mask, OBSERVED)
            else:
                canvas.outline(mask, OBSERVED, "dashed")
            about["centroid"] = np.round(seen.centroid[row], 1).tolist()
            about["area"] = int(seen.area[row])
            about["confidence"] = round(float(seen.confidence[row]), 3)
        measured.append(about)
    if label and observation.names:
        masks = {name: observation.mask(name, frame) for name in observation.names}
        others = np.any(list(masks.values()), axis=0)
        canvas.names({name: masks[name] for name in names}, OBSERVED, others)
    return measured


def case_tracks(app: App, case: Case, world: World | None) -> TrackRecord | None:
    """The track record a world models, else the case's latest; None where there is none."""
    kinds = {kind for kind, _ in app.store.cases.observations(case.id)}
    if "tracks" not in kinds:
        return None
    with explained():
        return modelled_tracks(app, case, world if world is not None else World())


def _sampled(trajectory: Trajectory, times: NDArray[np.float64]) -> Trajectory:
    """The motion at other times (T,) [s]: centres of objects interpolated, all else as at the nearest sample."""
    times = np.minimum(times, trajectory.times[-1])
    near = np.array([int(np.argmin(np.abs(trajectory.times - time))) for time in times])
    places = [positions_at(trajectory, column, times) for column in range(len(trajectory.names))]
    return replace(trajectory.select(near), times=times, positions=np.stack(places, axis=1))


def _centroid(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])
