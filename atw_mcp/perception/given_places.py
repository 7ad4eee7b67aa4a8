"""Positions in the world that were given, and why others are missing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from atw_mcp.perception.constraints import Rest
from atw_mcp.perception.eye import Seed
from atw_mcp.perception.observation import ImageObservation, ObservedObject
from polyworld.data.tracks import ObservedTracks

GIVEN_SIGMA = 0.002  # [m] standard deviation of a position that was given, where the measured ones are no better
SHORT = 40  # pixels of a mask whose outline is too short to place a solid


def with_given_places(tracks: ObservedTracks, seen: ImageObservation) -> ObservedTracks:
    """Return the tracks with the places that were given, and one place for every rest that was stated.

    During a rest an object is where it was given, else at the median of its measured positions, known the better the
    more frames measure it.
    """
    positions, sigma = tracks.positions.copy(), tracks.position_sigma.copy()
    confidence = tracks.confidence.copy()
    given: dict[tuple[str, int], np.ndarray] = {}
    for c in seen.constraints:
        if isinstance(c, Seed) and c.position is not None and c.object in tracks.names:
            column, rows = tracks.index(c.object), np.flatnonzero(tracks.frames == c.frame)
            measured = tracks.position_sigma[tracks.confidence[:, column] > 0, column]
            least = float(np.median(measured)) if len(measured) else GIVEN_SIGMA
            for row in rows:
                positions[row, column], confidence[row, column] = c.position, 1.0
                sigma[row, column] = min(GIVEN_SIGMA, least)
            given[c.object, c.frame] = np.asarray(c.position)
    for c in seen.constraints:
        if isinstance(c, Rest) and c.object in tracks.names:
            column = tracks.index(c.object)
            rows = np.flatnonzero((tracks.frames >= c.first) & (tracks.frames <= c.last))
            known = rows[confidence[rows, column] > 0]
            if not len(known):
                continue
            stated = [
                place for (name, frame), place in given.items() if name == c.object and c.first <= frame <= c.last
            ]
            place = np.mean(stated, axis=0) if stated else np.median(positions[known, column], axis=0)
            positions[rows, column] = place
            sigma[rows, column] = float(np.min(sigma[known, column]))
            confidence[rows, column] = np.maximum(confidence[rows, column], float(np.median(confidence[known, column])))
    spread = tracks.position_spread
    if spread is not None:
        spread = np.where((positions == tracks.positions).all(axis=2, keepdims=True), spread, 0.0)
    return replace(tracks, positions=positions, position_sigma=sigma, confidence=confidence, position_spread=spread)


def unplaced(tracks: ObservedTracks, seen: ImageObservation) -> dict[str, list[dict[str, Any]]]:
    """Return for each object the frames without a position, {"first", "last", "reason"}, in order."""
    found: dict[str, list[dict[str, Any]]] = {}
    for name in tracks.names:
        observed, column = seen.object(name), tracks.index(name)
        runs: list[dict[str, Any]] = []
        for row, frame in enumerate(tracks.frames.tolist()):
            if tracks.confidence[row, column] > 0:
                continue
            reason = _reason(observed, seen.row(frame))
            if runs and runs[-1]["reason"] == reason and seen.row(frame) == seen.row(runs[-1]["last"]) + 1:
                runs[-1]["last"] = frame
            else:
                runs.append({"first": frame, "last": frame, "reason": reason})
        if runs:
            found[name] = runs
    return found


def _reason(observed: ObservedObject, row: int) -> str:
    status, area = observed.status[row], int(observed.area[row])
    if area == 0:
        return "not in the image" if status == "absent" else "not seen in the frame"
    if status == "truncated":
        return "cut by the border of the image"
    if area < SHORT:
        return "too few pixels of it are seen to place it"
    if status == "occluded":
        return "too little of its outline is seen beside what is in front of it"
    return "the outline of its shape and size fits no place on the plane of motion"
