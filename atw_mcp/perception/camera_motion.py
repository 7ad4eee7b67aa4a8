"""Slight motion of a camera held by hand: shift and turn of every frame against the first, and frames without them."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CameraMotionSettings:
    """When a camera is seen to move, and by which corners and edges.

    moves: pixels (root mean square at the corners of the image) below which a camera stands still.
    tiles: parts of the image across and down.
    corners: corners of the image that are followed at most.
    tile_corners: the same in each part of the image.
    corner_quality: strength of a corner at least, of the strongest one.
    corner_spacing: distance between corners [px].
    least_corners: corners that are followed, below which they say nothing of the camera.
    followed: pixels by which a corner followed there and back may miss itself.
    lost: share of the frames that may have no motion on which corners agree.
    agreeing: share of corners that agree at least: bodies have corners too.
    agrees: pixels from the common motion up to which a corner agrees.
    remembered: clips whose motion is kept, so that each correction of a clip does not measure it again.
    """

    moves: float = 0.4
    tiles: int = 5
    corners: int = 2000
    tile_corners: int = 10
    corner_quality: float = 0.003
    corner_spacing: float = 6.0
    least_corners: int = 8
    followed: float = 0.7
    lost: float = 0.1
    agreeing: float = 0.4
    agrees: float = 1.0
    remembered: int = 64


SETTINGS = CameraMotionSettings()
_remembered: dict[bytes, Floats | None] = {}
_remembering = threading.Lock()


def camera_motion(frames: Frames, tick: Callable[[], None] | None = None) -> Floats | None:
    """Return maps (T, 2, 3) from the first frame's pixels to each frame's; None where the camera stands still.

    Rigid motions in the image, of corners followed from the first frame (Lucas & Kanade), on most of which they agree.
    A frame that cannot be aligned has the map of the frame before. Measured once per content of a clip.
    """
    digest = hashlib.blake2b(repr(frames.shape).encode())
    digest.update(np.ascontiguousarray(frames).data)
    key = digest.digest()
    with _remembering:
        known = key in _remembered
        found = _remembered.get(key)
    if not known:
        found = _measured(frames, tick or (lambda: None))
        with _remembering:
            _remembered[key] = found
            while len(_remembered) > SETTINGS.remembered:
                del _remembered[next(iter(_remembered))]
    return None if found is None else found.copy()


def _measured(frames: Frames, stop: Callable[[], None]) -> Floats | None:
    found = _of_corners(frames, stop)
    return found if found is not None and _is_motion(found, frames) else None


def _is_motion(found: Floats, frames: Frames) -> bool:
    height, width = frames.shape[1:3]
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], dtype=float)
    moved = corners @ found.transpose(0, 2, 1) - corners[:, :2]
    return float(np.sqrt((moved**2).sum(axis=2).mean())) >= SETTINGS.moves


def _of_corners(frames: Frames, tick: Callable[[], None]) -> Floats | None:
    """Motion on which most corners agree, all over the image, in nearly all frames; None where there is none."""
    first = cv2.cvtColor(frames[0], cv2.COLOR_BGR2GRAY)
    corners = _corners(first)
    if len(corners) < SETTINGS.least_corners:
        return None
    found = np.zeros((len(frames), 2, 3))
    found[0] = warp = np.eye(2, 3)
    lost = 0
    for t in range(1, len(frames)):
        tick()
        gray = cv2.cvtColor(frames[t], cv2.COLOR_BGR2GRAY)
        guess = cv2.transform(corners, warp).astype(np.float32)
        there, good, _ = cv2.calcOpticalFlowPyrLK(first, gray, corners, guess, flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
        back, also, _ = cv2.calcOpticalFlowPyrLK(gray, first, there, there.copy())
        kept = (
            (np.asarray(good) > 0).ravel()
            & (np.asarray(also) > 0).ravel()
            & (np.linalg.norm(back - corners, axis=2).ravel() < SETTINGS.followed)
        )
        new = _rigid(corners[kept, 0], there[kept, 0], (first.shape[1], first.shape[0]))
        lost += new is None
        warp = warp if new is None else new
        found[t] = warp
    return found if lost <= SETTINGS.lost * len(frames) else None


def _corners(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the strongest corners (k, 1, 2) of every part of an image: captions have stronger ones than scenes."""
    corners = cv2.goodFeaturesToTrack(gray, SETTINGS.corners, SETTINGS.corner_quality, SETTINGS.corner_spacing)
    if corners is None:
        return np.empty((0, 1, 2), dtype=np.float32)
    tiles = (corners[:, 0] * SETTINGS.tiles / np.array(gray.shape[::-1])).astype(int) @ [1, SETTINGS.tiles]
    kept = np.concatenate([np.flatnonzero(tiles == tile)[: SETTINGS.tile_corners] for tile in np.unique(tiles)])
    return np.asarray(corners[np.sort(kept)], dtype=np.float32)


def _rigid(before: NDArray[np.float32], after: NDArray[np.float32], size: tuple[int, int]) -> Floats | None:
    """Return the rotation and shift (2, 3) on which most points of an image (width, height) agree, all over it.

    None where fewer agree, or only points of a part of the image, as those of one body do."""
    if len(before) < SETTINGS.least_corners:
        return None
    similar, inliers = cv2.estimateAffinePartial2D(
        before, after, method=cv2.RANSAC, ransacReprojThreshold=SETTINGS.agrees
    )
    if similar is None:
        return None
    kept = inliers.ravel().astype(bool)
    tiles = np.unique((before[kept] * SETTINGS.tiles / np.array(size)).astype(int), axis=0)
    if kept.sum() < max(SETTINGS.agreeing * len(before), SETTINGS.least_corners) or len(tiles) < SETTINGS.tiles:
        return None
    p, q = before[kept].astype(float), after[kept].astype(float)
    angle = float(np.arctan2(similar[1, 0], similar[0, 0]))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.column_stack([turn, np.median(q - p @ turn.T, axis=0)])


def stabilised(frames: Frames, motion: Floats) -> Frames:
    """Return frames (T, H, W, 3) as the first frame's camera would have seen them."""
    size = (frames.shape[2], frames.shape[1])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.stack(
        [
            np.asarray(cv2.warpAffine(f, m, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)
            for f, m in zip(frames, motion, strict=True)
        ]
    )


def in_full_pixels(motion: Floats | None, scale: float) -> Floats | None:
    """Return maps between reduced frames as maps between full ones, which are `scale` times as wide.

    Rounded to what is stored of them, so that an observation is the same before and after."""
    if motion is None:
        return None
    full = motion.copy()
    # Pixel centres are at whole numbers: of a reduced pixel u the middle is scale * (u + 1/2) - 1/2.
    middle = 0.5 * (scale - 1.0)
    full[:, :, 2] = scale * motion[:, :, 2] + middle - motion[:, :, :2].sum(axis=2) * middle
    return np.round(full, 6)


def steadied(points: Floats, motion: Floats | None, row: int) -> Floats:
    """Return points (..., 2) [px] of a row's frame as the first frame's camera would have seen them."""
    if motion is None:
        return points
    return np.asarray((points - motion[row, :, 2]) @ np.linalg.inv(motion[row, :, :2]).T)


def filmed(points: Floats, motion: Floats | None, row: int) -> Floats:
    """Return the inverse of `steadied`."""
    return points if motion is None else np.asarray(points @ motion[row, :, :2].T + motion[row, :, 2])


def as_filmed(mask: Mask, motion: Floats) -> Mask:
    """Return a mask (H, W) of a stabilised frame in that frame's own pixels."""
    size = (mask.shape[1], mask.shape[0])
    moved: Mask = np.asarray(cv2.warpAffine(mask.astype(np.float32), motion, size, flags=cv2.INTER_LINEAR)) > 0.5
    return moved


def as_stabilised(mask: Mask, motion: Floats) -> Mask:
    """Return a mask (H, W) in a frame's own pixels as it lies in the stabilised frame; the inverse of `as_filmed`."""
    size = (mask.shape[1], mask.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    moved: Mask = np.asarray(cv2.warpAffine(mask.astype(np.float32), motion, size, flags=flags)) > 0.5
    return moved
