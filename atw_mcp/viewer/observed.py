"""What was observed: outlines of the masks in the video, and measured positions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.observation.track_records import TrackRecord, at_rate
from atw_mcp.perception.observation import ImageObservation, ObservedObject
from atw_mcp.viewer import document as view
from atw_mcp.viewer.packing import Blocks

SIMPLEST = 1.0 / 960.0  # of the image's width: half a pixel where a video is shown 480 wide


def observed_view(
    identifier: str, observation: ImageObservation, blocks: Blocks, colors: dict[str, str]
) -> view.Observed:
    """Return the outlines of all observed objects; colors: by name."""
    return view.Observed(
        id=identifier,
        frames=blocks.integers(observation.frames),
        objects=[_outlined(seen, observation, blocks, colors[seen.name]) for seen in observation.objects],
    )


def _outlined(seen: ObservedObject, observation: ImageObservation, blocks: Blocks, color: str) -> view.Outlined:
    points: list[NDArray[np.int32]] = []
    frames: list[int] = []
    for frame, mask, box in zip(observation.frames, seen.masks, seen.box, strict=True):
        if mask is None or mask.area == 0:
            continue
        left, top, width, height = (int(value) for value in box)
        part = mask.decode()[top : top + height, left : left + width]
        for outline in outlines(part, SIMPLEST * observation.video.width):
            points.append(outline + np.array([left, top]))
            frames.append(frame)
    starts = np.concatenate([[0], np.cumsum([len(outline) for outline in points])])
    return view.Outlined(
        name=seen.name,
        color=color,
        points=blocks.small(np.concatenate(points) if points else np.zeros((0, 2))),
        starts=blocks.integers(starts),
        frames=blocks.integers(frames),
        status=list(seen.status),
        confidence=blocks.floats(seen.confidence),
    )


def outlines(mask: NDArray[np.bool_], tolerance: float) -> list[NDArray[np.int32]]:
    """Return polygons (k, 2) x, y through the outermost pixels of a mask's parts and around its holes [px]."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(cv2.approxPolyDP(c, tolerance, True)[:, 0], dtype=np.int32) for c in found]


def tracks_view(
    record: TrackRecord, blocks: Blocks, *, seconds_per_frame: float | None, held_out_from: float | None
) -> view.Tracks:
    """Return measured positions; seconds_per_frame: of the worlds that model them, None where none does."""
    tracks = record.tracks if seconds_per_frame is None else at_rate(record.tracks, seconds_per_frame)
    known = tracks.confidence > 0
    return view.Tracks(
        id=record.id,
        run="",
        names=list(tracks.names),
        times=blocks.floats(tracks.times),
        positions=blocks.floats(np.where(known[..., None], tracks.positions, np.nan)),
        sigma=blocks.floats(np.where(known, tracks.coordinate_sigma, np.nan)),
        held_out_from=held_out_from,
    )
