"""What was observed: outlines of the masks in the video, and measured positions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.observation import ImageObservation, ObservedObject
from atw_mcp.viewer import document as view
from atw_mcp.viewer.packing import Blocks
from polyworld.data.recording import Run
from polyworld.data.tracks import ObservedTracks

SIMPLEST = 1.0 / 960.0  # of the image's width: half a pixel where a video is shown 480 wide


def observed_view(
    identifier: str, observation: ImageObservation, blocks: Blocks, colors: dict[str, str]
) -> view.Observed:
    """Return the outlines of all observed objects; colors: by name."""
    return view.Observed(
        id=identifier,
        frames=blocks.integers(observation.frames),
        objects=[_outlined(seen, observation, blocks, colors[seen.name]) for seen in observation.objects],
        camera_motion=None if observation.camera_motion is None else blocks.floats(observation.camera_motion),
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


def tracks_view(identifier: str, tracks: ObservedTracks, blocks: Blocks, *, held_out_from: float | None) -> view.Tracks:
    """Return measured positions, in the time base of the worlds that model them; held_out_from [s]: of a fit."""
    known = tracks.confidence > 0
    return view.Tracks(
        id=identifier,
        run="",
        names=list(tracks.names),
        times=blocks.floats(tracks.times),
        positions=blocks.floats(np.where(known[..., None], tracks.positions, np.nan)),
        sigma=blocks.floats(np.where(known, tracks.coordinate_sigma, np.nan)),
        held_out_from=held_out_from,
    )


def run_view(identifier: str, run: Run, blocks: Blocks) -> view.Tracks:
    """Return the measured positions of one run of a recording, on the clock that begins when the run does."""
    sigma = np.full(run.positions.shape[:2], np.nan if run.sigma is None else run.sigma)
    return view.Tracks(
        id=identifier,
        run=run.name,
        names=list(run.names),
        times=blocks.floats(run.times - run.origin),
        positions=blocks.floats(run.positions),
        sigma=blocks.floats(np.where(np.isfinite(run.positions).all(axis=-1), sigma, np.nan)),
        held_out_from=None,
    )
