"""Solids that do not move on their plane: they look larger, or smaller, than on it, and are followed in the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from atw_mcp.perception import eye
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats, Mask, filled
from atw_mcp.perception.eye.states import state_at

LARGER = 1.4  # area over that of the silhouette on the plane: on it 0.8 to 1.25 (contact shadows, sliding clips)
SAMPLED = 16  # frames in which it is compared
LEAST_FRAMES, LEAST_SHARE = 3, 0.2  # of those in which it has to be larger
LEAST_RADIUS = 3.0  # [px] of a silhouette below which its pixels are too few to count
COMPACT = 0.75  # share of its convex hull that a solid's mask fills
COMPARED = 8  # frames in which a cylinder is tried on its side
SHOWN = 0.4  # share of its normals whose edges must be seen, from which on it stands: 0.05 lying, 0.84 standing
BETTER = 0.5  # [nats] of contrast by which it must explain them better: that from which on a body is seen at all
MARGIN, WIDE = 0.5, 6.0  # [radii] around a silhouette in which its pixels are searched for: to compare, for a seed


@dataclass(frozen=True)
class OffPlane:
    """A solid that is not on its plane: rows that show it, the ratio of areas there, and a seed in the image."""

    rows: tuple[int, ...]
    ratio: float
    seed: eye.Seed


def off_plane(scene: Scene, tracks: Sequence[eye.Track]) -> dict[str, OffPlane]:
    """Return the solids on a plane, but for those that may rise, that are clearly larger than their silhouettes."""
    found = {}
    for i, track in enumerate(tracks):
        seen = np.flatnonzero(np.isfinite(track.poses[:, 0]))
        if not isinstance(track.body, eye.Solid) or track.body.rises or len(seen) < LEAST_FRAMES:
            continue
        rows = seen[np.unique(np.linspace(0, len(seen) - 1, min(SAMPLED, len(seen))).astype(int))]
        ratios = np.array([_ratio(scene, i, int(k)) for k in rows])
        larger = rows[ratios > LARGER]
        if len(larger) >= max(LEAST_FRAMES, LEAST_SHARE * len(rows)):
            best = int(rows[int(np.argmax(ratios))])
            seed = _seed(scene, i, best, round=track.body.kind == "sphere")
            ratio = float(np.median(ratios[ratios > LARGER]))
            found[track.body.name] = OffPlane(tuple(int(k) for k in larger), ratio, seed)
    return found


def lying(scene: Scene, tracks: Sequence[eye.Track]) -> frozenset[str]:
    """Return the upright cylinders on a plane that explain their pixels clearly better on their side."""
    found = set()
    for i, track in enumerate(tracks):
        body, seen = track.body, np.flatnonzero(np.isfinite(track.poses[:, 0]))
        if not isinstance(body, eye.Solid) or body.kind != "cylinder" or body.upright or body.lies or not len(seen):
            continue
        gains, standing = [], []
        for k in seen[np.unique(np.linspace(0, len(seen) - 1, min(COMPARED, len(seen))).astype(int))]:
            pose = track.poses[k]
            standing.append(state_at(scene, i, int(k), pose))
            on_side = replace(body, lies=True)
            scene.bodies[i] = on_side
            tried = [state_at(scene, i, int(k), pose + np.array([0, 0, a, 0])).contrast for a in on_side.angles()]
            scene.bodies[i] = body
            gains.append(max(tried) - standing[-1].contrast)
        shown = float(np.median([state.fit.decided for state in standing]))
        if np.median(gains) > BETTER and shown < SHOWN:
            found.add(body.name)
    return frozenset(found)


def _ratio(scene: Scene, body: int, row: int) -> float:
    """Number of a body's pixels in a row's frame over that of its silhouette; one where they are no solid's.

    Pixels that look like the body and surround it, as ground of its colour does, reach the border of the window.
    """
    shape, pose = scene.bodies[body], scene.poses[body, row]
    wide = eye.body_mask(scene, body, row, WIDE)
    picture = (scene.film.width, scene.film.height)
    if (
        shape.radius(pose) < LEAST_RADIUS
        or not wide.mask.any()
        or _leaks(wide, picture)
        or _filling(wide.mask) < COMPACT
    ):
        return 1.0
    mask = eye.body_mask(scene, body, row, MARGIN)
    polygon = scene.bodies[body].polygon(scene.poses[body, row])
    silhouette = filled(polygon, mask.corner, (mask.mask.shape[1], mask.mask.shape[0]))
    return float((mask.mask.sum() + 1) / (silhouette.sum() + 1))


def _leaks(found: eye.BodyMask, picture: tuple[int, int]) -> bool:
    """Whether a mask reaches a border of its window that is not one of the picture (w, h)."""
    mask, (u, v) = found.mask, found.corner
    height, width = mask.shape
    left, right = u > 0 and mask[:, 0].any(), u + width < picture[0] and mask[:, -1].any()
    top, bottom = v > 0 and mask[0].any(), v + height < picture[1] and mask[-1].any()
    return bool(left or right or top or bottom)


def _filling(mask: Mask) -> float:
    """Share of its convex hull that a mask fills."""
    rows, columns = np.nonzero(mask)
    hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
    filled_hull = cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), hull, 1)
    return float(mask.sum() / filled_hull.sum())


def _seed(scene: Scene, body: int, row: int, *, round: bool) -> eye.Seed:
    mask = eye.body_mask(scene, body, row, WIDE)
    name = scene.bodies[body].name
    if round:
        u, v = mask.centre()
        return eye.Seed(name, "circle", row, (u, v, float(np.sqrt(mask.mask.sum() / np.pi))))
    return eye.Seed(name, "outline", row, mask.outline())


def in_image(name: str, seed: eye.Seed) -> eye.Outline:
    """Body of a seed's shape that moves and changes in size in the image."""
    return replace(eye.outline_body(name, seed), scales=True)


def has_place(body: eye.Solid, seed: eye.Seed) -> bool:
    """Whether a seed's centre is on the plane of motion, and not above its horizon."""
    centre = seed.centre()
    if centre is None:
        return True
    pose: Floats = body.placed(centre, np.zeros(4))
    return bool(np.isfinite(pose).all())
