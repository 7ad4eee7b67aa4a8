"""Slight motion of a camera held by hand: shift and turn of every frame against the first, and frames without them."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOVES = 0.4  # pixels (root mean square at the corners) below which a camera stands still
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-4)
SMOOTHED = 1.2  # pixels: standard deviation of the filter before images are aligned
EDGE = 40.0  # slope (Sobel) of an edge: a step of ten levels
EDGES = 12  # pixels at edges from which on a part of the image shows motion
TILES = 5  # parts of the image across and down
MOST_TILES = 0.6  # share of those with edges that alignment has to make steadier
COMPARED = 8  # frames in which it is seen whether alignment helps
CLIPPED = 40.0  # levels: what covers an edge changes it by more, and counts no more
STEADIER = 0.7  # of the change at edges that alignment has to leave at most
LIKE = 0.5  # correlation below which two images were not aligned


def camera_motion(frames: Frames, tick: Callable[[], None] | None = None) -> Floats | None:
    """Return maps (T, 2, 3) from the first frame's pixels to each frame's; None where the camera stands still.

    Rigid motions in the image, by maximal correlation of whole images (ECC: Evangelidis & Psarakis 2008, IEEE TPAMI 30,
    1858); a frame that cannot be aligned has the map of the frame before.
    """
    first = _smooth_gray(frames[0])
    found = np.zeros((len(frames), 2, 3))
    warp = np.eye(2, 3, dtype=np.float32)
    found[0] = warp
    for t in range(1, len(frames)):
        if tick is not None:
            tick()
        gray = _smooth_gray(frames[t])
        try:
            likeness, new = cv2.findTransformECC(first, gray, warp.copy(), cv2.MOTION_EUCLIDEAN, CRITERIA)
        except cv2.error:  # too little texture to align
            likeness, new = 0.0, warp
        warp = np.asarray(new, dtype=np.float32) if likeness > LIKE else warp
        found[t] = warp
    height, width = first.shape
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], dtype=float)
    moved = corners @ found.transpose(0, 2, 1) - corners[:, :2]
    if float(np.sqrt((moved**2).sum(axis=2).mean())) < MOVES or not _steadies(frames, found):
        return None  # bodies that move pull the alignment of a plain scene
    return found


def _smooth_gray(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    gray = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), SMOOTHED), dtype=np.float32)


def _steadies(frames: Frames, motion: Floats) -> bool:
    """Return whether frames freed of a motion differ clearly less from the first one at edges in most of the image.

    Where only bodies have edges, their motion is not the camera's: too few parts of the image show any.
    """
    picks = np.unique(np.linspace(1, len(frames) - 1, min(COMPARED, len(frames) - 1)).round().astype(int))
    first = cv2.cvtColor(frames[0], cv2.COLOR_BGR2GRAY).astype(np.float32)
    edges = np.hypot(cv2.Sobel(first, cv2.CV_32F, 1, 0), cv2.Sobel(first, cv2.CV_32F, 0, 1)) > EDGE
    change = []
    for images in (frames[picks], stabilised(frames[picks], motion[picks])):
        gray = np.stack([cv2.cvtColor(f, cv2.COLOR_BGR2GRAY).astype(np.float32) for f in images])
        change.append(np.median(np.minimum(np.abs(gray - first), CLIPPED), axis=0))
    steadier = []
    for rows in np.array_split(np.arange(first.shape[0]), TILES):
        for columns in np.array_split(np.arange(first.shape[1]), TILES):
            tile = np.ix_(rows, columns)
            own = edges[tile]
            if own.sum() >= EDGES:
                before, after = (float(c[tile][own].mean()) for c in change)
                steadier.append(after < STEADIER * before)
    return len(steadier) >= TILES and float(np.mean(steadier)) > MOST_TILES


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
