"""What `atw-mcp export CASE` writes of a case's world: its motion as a table or a figure, a film, itself."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import cast

import av
import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.probing.ensembles import Ensemble, compute_ensemble, most_members
from atw_mcp.probing.prediction_errors import travelled_since
from atw_mcp.probing.rollout_view import RolloutView, case_tracks
from atw_mcp.worlds.rollouts import compute_rollout
from evidence_store import Case
from polyworld.data.recording import Run
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import with_model_error
from polyworld.exchange import export_mjcf
from polyworld.pictures.motion import plot
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]
FIGURES = (".svg", ".png", ".pdf")
COLUMNS = ["object", "t", "x", "y", "z", "x_low", "x_high", "y_low", "y_high", "z_low", "z_high",
           "x_measured", "y_measured", "z_measured", "sigma"]  # fmt: skip
ENDS = (10.0, 90.0)  # percentiles
CODECS = {".mp4": "libx264", ".webm": "libvpx-vp9", ".webp": "libwebp_anim"}
RATE = 25  # [1/s] frames of the case's video, whatever time lies between them
AT_ONCE = 32  # frames drawn before they are encoded: a picture takes 4 MB


def export_motion(app: App, case: str, file: Path, until: float | None = None) -> tuple[int, str]:
    """Write the motion of a case's committed world, else of its latest, beside what was measured.

    Returns the rows, and why there is no interval where there is none.

    The file's suffix says what is written. `.csv`: one row an object and frame [s, m], with the ends of the 80%
    interval of what the data allow (model error included) and measured places with their standard deviation; empty
    cells where there is none. `.svg`, `.png`, `.pdf`: a figure of the same. until: time [s] from the first frame to run
    to; default the last observed frame. Raises ToolError for another suffix, or where there is no world.
    """
    _check_suffix(file, (".csv", *FIGURES))
    found, world, rollout = _rolled_out(app, case, until)
    record = case_tracks(app, found, world)
    tracks = None if record is None else record.tracks
    band, missing = None, ""
    try:
        members = compute_ensemble(app, found, world, rollout.horizon, None, most_members(app, found, world))
        band = interval(members, rollout.trajectory)
    except (ToolError, ValueError) as error:  # never fitted, or a sample too large or too wild to be run
        missing = str(error)
    if file.suffix != ".csv":
        plot(rollout, None if tracks is None else Run.of_tracks(found.id, tracks), band).savefig(file)
        return len(rollout.trajectory.times), missing
    rows = table(rollout.trajectory, tracks, band)
    with file.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows([COLUMNS, *rows])
    return len(rows), missing


def export_film(app: App, case: str, file: Path, until: float | None = None) -> int:
    """Write a case's world over its video, as InspectRollout draws it, as `CODECS` has it; return the frames.

    Raises ToolError as `export_motion` does.
    """
    _check_suffix(file, tuple(CODECS))
    found, world, rollout = _rolled_out(app, case, until)
    view = RolloutView(app, found, world, rollout, "auto")
    names, frames = list(rollout.trajectory.names), range(view.last_frame + 1)
    largest = next(iter(view.draw([view.last_frame], names)[0].values()))  # first: its plan holds the whole motion
    height, width = (size - size % 2 for size in largest.shape[:2])  # one colour is kept of 2 x 2 pixels
    with av.open(str(file), "w") as film:
        stream = cast(av.VideoStream, film.add_stream(CODECS[file.suffix], rate=RATE))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for first in frames[::AT_ONCE]:
            pictures, rows = view.draw(list(frames[first : first + AT_ONCE]), names)
            for picture in list(pictures.values())[: len(rows)]:
                shown = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[:height, :width]), format="bgr24")
                film.mux(stream.encode(shown))
        film.mux(stream.encode())
    return len(frames)


def export_world(app: App, case: str, file: Path) -> tuple[str, ...]:
    """Write a case's committed world, else its latest, as JSON or MJCF (`.xml`); return what MJCF does not hold."""
    _check_suffix(file, (".json", ".xml"))
    world = app.world(app.case(case))
    if file.suffix == ".json":
        file.write_text(world.canonical_json(), encoding="utf-8")
        return ()
    made = export_mjcf(world)
    file.write_text(made.xml, encoding="utf-8")
    return tuple(made.left_out)


def _check_suffix(file: Path, known: tuple[str, ...]) -> None:
    if file.suffix not in known:
        raise ToolError(f"cannot write {file.suffix or file.name!r}: use {', '.join(known)}")


def _rolled_out(app: App, case: str, until: float | None) -> tuple[Case, World, Rollout]:
    """Return a case, its committed world, else its latest, and that one's rollout."""
    found = app.case(case)
    world = app.world(found)
    horizon = until or (world.time.frame_count - 1) * world.time.seconds_per_frame
    return found, world, compute_rollout(app, world, horizon)[1]


def interval(ensemble: Ensemble, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return the ends (T, n, 3) [m] of the 80% interval of places; NaN where no member is."""
    ends = np.full((2, *trajectory.positions.shape), np.nan)
    for column, name in enumerate(trajectory.names):
        places = np.full((ensemble.size, len(trajectory.times), 3), np.nan)
        reach = np.zeros_like(places)
        for member, own in enumerate(ensemble.rollouts):
            count = min(len(trajectory.times), len(own.trajectory.times))
            places[member, :count] = own.trajectory.positions[:count, own.trajectory.index(name)]
            reach[member] = travelled_since(ensemble, member, name, trajectory.times)
        known = np.isfinite(places).all(axis=(1, 2))
        if known.any():
            ends[:, :, column] = np.percentile(with_model_error(places[known], reach[known]), ENDS, axis=0)
    return ends[0], ends[1]


def table(motion: Trajectory, tracks: ObservedTracks | None, band: tuple[Array, Array] | None) -> list[list[str]]:
    """Return rows as `COLUMNS` names them, object by object; measured places are given at the nearest sample."""
    nearest, rows = {}, []
    if tracks is not None:
        nearest = {int(np.argmin(np.abs(motion.times - t))): row for row, t in enumerate(tracks.times)}
    for column, name in enumerate(motion.names):
        for k in np.flatnonzero(motion.active[:, column]):
            ends = np.full(6, np.nan) if band is None else np.stack([end[k, column] for end in band], axis=1).ravel()
            measured, row = np.full(4, np.nan), nearest.get(int(k))
            own = -1 if tracks is None or name not in tracks.names else tracks.index(name)
            if tracks is not None and row is not None and own >= 0 and tracks.confidence[row, own] > 0.0:
                measured = np.array([*tracks.positions[row, own], tracks.position_sigma[row, own]])
            numbers = [motion.times[k], *motion.positions[k, column], *ends, *measured]
            rows.append([name, *(f"{x:.9g}" if np.isfinite(x) else "" for x in numbers)])
    return rows
