"""Observed and simulated motion of a case as a table or a figure: `atw-mcp export CASE --motion FILE`."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.observation.observing import modelled_tracks
from atw_mcp.probing.ensembles import MEMBERS, Ensemble, compute_ensemble
from atw_mcp.probing.prediction_errors import travelled_since
from atw_mcp.worlds.rollouts import compute_rollout
from polyworld.data.recording import Run
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import with_model_error
from polyworld.pictures.motion import plot
from polyworld.trajectory import Trajectory

Array = NDArray[np.float64]
FIGURES = (".svg", ".png", ".pdf")
COLUMNS = ["object", "t", "x", "y", "z", "x_low", "x_high", "y_low", "y_high", "z_low", "z_high",
           "x_measured", "y_measured", "z_measured", "sigma"]  # fmt: skip
ENDS = (10.0, 90.0)  # percentiles


def export_motion(app: App, case: str, file: Path, until: float | None = None) -> int:
    """Write the motion of a case's committed world, else of its latest, beside what was measured; return the rows.

    The file's suffix says what is written. `.csv`: one row an object and frame [s, m], with the ends of the 80%
    interval of what the data allow (model error included) and measured places with their standard deviation; empty
    cells where there is none. `.svg`, `.png`, `.pdf`: a figure of the same. until: time [s] from the first frame to run
    to; default the last observed frame. Raises ToolError for another suffix, or where there is no world.
    """
    if file.suffix not in (".csv", *FIGURES):
        raise ToolError(f"cannot write motion as {file.suffix or file.name!r}: use .csv, {', '.join(FIGURES)}")
    found = app.case(case)
    world = app.world(found)
    horizon = until or (world.time.frame_count - 1) * world.time.seconds_per_frame
    rollout = compute_rollout(app, world, horizon)[1]
    tracks = modelled_tracks(app, found, world).tracks
    try:
        ensemble = compute_ensemble(app, found, world, horizon, None, MEMBERS)
    except ToolError:  # never fitted: there is no interval
        ensemble = None
    band = None if ensemble is None else interval(ensemble, rollout.trajectory)
    if file.suffix != ".csv":
        plot(rollout, Run.of_tracks(found.id, tracks), band).savefig(file)
        return len(rollout.trajectory.times)
    rows = table(rollout.trajectory, tracks, band)
    with file.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows([COLUMNS, *rows])
    return len(rows)


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


def table(motion: Trajectory, tracks: ObservedTracks, band: tuple[Array, Array] | None) -> list[list[str]]:
    """Return rows as `COLUMNS` names them, object by object; measured places are given at the nearest sample."""
    nearest = {int(np.argmin(np.abs(motion.times - t))): row for row, t in enumerate(tracks.times)}
    rows = []
    for column, name in enumerate(motion.names):
        for k in np.flatnonzero(motion.active[:, column]):
            ends = np.full(6, np.nan) if band is None else np.stack([end[k, column] for end in band], axis=1).ravel()
            measured, row = np.full(4, np.nan), nearest.get(int(k))
            if row is not None and name in tracks.names and tracks.confidence[row, tracks.index(name)] > 0.0:
                own = tracks.index(name)
                measured = np.array([*tracks.positions[row, own], tracks.position_sigma[row, own]])
            numbers = [motion.times[k], *motion.positions[k, column], *ends, *measured]
            rows.append([name, *(f"{x:.9g}" if np.isfinite(x) else "" for x in numbers)])
    return rows
