"""Masks of bodies that were followed: in each frame's own pixels, no pixel in two of them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from atw_mcp.perception import eye
from atw_mcp.perception.camera_motion import as_filmed
from atw_mcp.perception.clip import Clip, Floats
from atw_mcp.perception.constraints import Constraint, Exclusion
from atw_mcp.perception.describing import LEAST_PIXELS
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import filled
from atw_mcp.perception.masks import Mask, RunLengthMask

FINER = 8  # parts of a pixel along each axis by which silhouettes are drawn
RIM = 0.3  # radii around a silhouette in which a body's pixels are looked for: more is another body's


def masks_of(
    clip: Clip, tracks: list[eye.Track], scene: Scene, constraints: Sequence[Constraint]
) -> dict[str, list[Mask]]:
    """Masks (T) of each track that share no pixel, the nearest first; those given are taken as they are."""
    shape = clip.frames.shape[1:3]
    given = {
        (c.object, clip.row(c.frame)): c.value.decode()
        for c in constraints
        if isinstance(c, eye.Seed) and isinstance(c.value, RunLengthMask)
    }
    outlined = {c.object for c in constraints if isinstance(c, eye.Seed)}  # as wholes, whoever or whatever found them
    masks: dict[str, list[Mask]] = {t.body.name: [] for t in tracks}
    for k in range(len(clip.numbers)):
        taken = np.zeros(shape, bool)
        for (_, row), mask in given.items():
            if row == k:
                taken |= mask
        seen = [i for i in range(len(tracks)) if np.isfinite(tracks[i].poses[k, 0])]
        made: dict[str, Mask] = {}
        drawn = {i: _silhouette(scene, i, tracks[i].poses[k]) for i in seen}
        for i in sorted(seen, key=lambda i: tracks[i].body.depth(tracks[i].poses[k])):
            name = tracks[i].body.name
            shown = isinstance(tracks[i].body, eye.Outline) and name not in outlined
            own = _as_shown(scene, i, k, drawn) if shown else drawn[i]
            made[name] = (own if clip.motion is None else as_filmed(own, clip.motion[k])) & ~taken
            taken |= made[name]
        for name, series in masks.items():
            found = given.get((name, k), made.get(name, np.zeros(shape, bool)))
            series.append(excluded(found, name, clip.numbers[k], constraints))
    return masks


def _as_shown(scene: Scene, body: int, frame: int, drawn: dict[int, Mask]) -> Mask:
    """Pixels (H, W) that show a body of unknown shape; near other bodies, whose mixtures are neither's, its silhouette.

    A solid that comes nearer or rotates is no outline that moves in the image.
    """
    own = drawn[body]
    found = eye.body_mask(scene, body, frame, RIM)
    rows, columns = (slice(c, c + n) for c, n in zip(found.corner[::-1], found.mask.shape, strict=True))
    others = np.zeros(found.mask.shape, np.uint8)
    for i, mask in drawn.items():
        if i != body:
            others |= mask[rows, columns]
    reach = 2 * int(2 * scene.settings.mixed_near) + 1
    near = cv2.dilate(others, np.ones((reach, reach), np.uint8)) > 0 if others.size else others > 0
    shown = own.copy()
    shown[rows, columns] = np.where(near, own[rows, columns], found.mask)
    return shown


def excluded(mask: Mask, name: str, frame: int, constraints: Sequence[Constraint]) -> Mask:
    """Return a mask of an object in a frame without what was said not to be the object's."""
    for c in constraints:
        if isinstance(c, Exclusion) and c.object in (None, name) and c.first <= frame <= c.last:
            mask = np.zeros_like(mask) if c.mask is None else mask & ~c.mask.decode()
    return mask if mask.sum() >= LEAST_PIXELS else np.zeros_like(mask)


def _silhouette(scene: Scene, body: int, pose: Floats) -> Mask:
    """Pixels (H, W) of a body's silhouette in a steady frame that nothing fixed hides."""
    shape, mask = scene.bodies[body], np.zeros((scene.film.height, scene.film.width), bool)
    (u, v), (width, height) = scene.window(body, pose, 1.0)
    if min(width, height) < 1:
        return mask
    # Filling covers every pixel that an edge touches: of finer ones that is little.
    finer = (shape.polygon(pose) - [u, v] + 0.5) * FINER - 0.5
    share = filled(finer, (0, 0), (width * FINER, height * FINER)).astype(np.float32)
    mask[v : v + height, u : u + width] = cv2.resize(share, (width, height), interpolation=cv2.INTER_AREA) > 0.5
    if scene.hiding is None or not isinstance(shape, eye.Solid):
        return mask
    return np.asarray(mask & (scene.hiding > shape.depth(pose)))
