"""Follow bodies from seeds through a video: from tracks of the eye to objects of an observation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from atw_mcp.perception import eye
from atw_mcp.perception.body_masks import masks_of
from atw_mcp.perception.camera_motion import as_stabilised
from atw_mcp.perception.clip import Clip, Floats
from atw_mcp.perception.constraints import Constraint
from atw_mcp.perception.describing import LEAST_PIXELS, describe
from atw_mcp.perception.eye.bodies import Body
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.known_scene import KnownScene
from atw_mcp.perception.lying import has_place, lying
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ObservationError, ObservedObject, Status
from atw_mcp.perception.places import places_of
from atw_mcp.perception.video import Cancelled, Progress, report

UNSURE = 0.35  # confidence below which a body is not in full view, and its frames are named
PASSES = 6  # times that the eye goes through all frames: forward, backward, and its rounds


@dataclass(frozen=True)
class Followed:
    """Objects that were followed, by name, and warnings about them."""

    objects: dict[str, ObservedObject]
    warnings: list[str]


def follow_bodies(
    clip: Clip,
    constraints: Sequence[Constraint],
    scene: KnownScene | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> Followed:
    """Follow every body that a seed names: solids of the scene by their silhouettes, others by their outlines.

    Raises ObservationError for a seed that cannot be used, saying what can.
    """
    seeds = [c for c in constraints if isinstance(c, eye.Seed)]
    names = list(dict.fromkeys(s.object for s in seeds))
    if not names:
        return Followed({}, [])
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        doing = "" if ticks % 8 else f"following {', '.join(names)}"
        report(progress, cancelled, min(ticks / (PASSES * len(clip.numbers)), 0.95), doing)

    hints = [_hint(clip, s) for s in seeds]
    bodies: list[Body] = []
    for name in names:
        own = [h for h in hints if h.object == name]
        on_plane = scene is not None and name in scene.solids and name not in scene.off_plane
        solid = scene.body(name) if scene is not None and on_plane else None
        if solid is None or not all(has_place(solid, h) for h in own):
            bodies.append(_outline(clip, name, own))
        else:
            bodies.append(solid)
    hiding = None if scene is None else scene.hiding(clip.frames.shape[1:3])
    try:
        tracks, found = eye.observe(clip.steady, bodies, hints, hiding=hiding, tick=tick)
        on_side = lying(found, tracks)
        if on_side:
            bodies = [replace(b, lies=True) if isinstance(b, eye.Solid) and b.name in on_side else b for b in bodies]
            tracks, found = eye.observe(clip.steady, bodies, hints, hiding=hiding, tick=tick)
    except ValueError as error:
        raise ObservationError(str(error)) from error
    return _observed(clip, tracks, found, constraints)


def _hint(clip: Clip, seed: eye.Seed) -> eye.Seed:
    """Return a seed in steady pixels and rows."""
    row = clip.row(seed.frame)
    if isinstance(seed.value, RunLengthMask):
        mask = seed.value.decode()
        if mask.shape != clip.frames.shape[1:3]:
            height, width = clip.frames.shape[1:3]
            raise ObservationError(f"the mask is {mask.shape[1]} x {mask.shape[0]}, the image {width} x {height}")
        steady = mask if clip.motion is None else as_stabilised(mask, clip.motion[row])
        return replace(seed, frame=row, value=RunLengthMask.encode(steady))
    return replace(seed, frame=row, value=seed.moved(clip.steadied(seed.points(), row)))


def _outline(clip: Clip, name: str, hints: list[eye.Seed]) -> eye.Outline:
    """Body of unknown shape, from its first hint that shows one: an outline, circle or mask before a box."""
    shown = sorted((h for h in hints if h.polygon() is not None), key=lambda h: h.kind == "box")
    if not shown:
        raise ObservationError(
            f"{name}: its shape is not known: give an outline, a circle, a box or a mask of it in one frame"
        )
    first = shown[0]
    if first.kind == "box":
        first = replace(first, kind="mask", value=RunLengthMask.encode(_in_box(clip, first)))
    return replace(eye.outline_body(name, first), scales=True)


def _in_box(clip: Clip, hint: eye.Seed) -> Mask:
    """Mask (H, W) of what stands out in a box: GrabCut (Rother, Kolmogorov & Blake 2004)."""
    height, width = clip.frames.shape[1:3]
    left, top, right, bottom = (round(float(v)) for v in hint.points().ravel())
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if right - left < 3 or bottom - top < 3:
        raise ObservationError(
            f"{hint.object}: the box is smaller than 3 px, or outside the image of {width} x {height}"
        )
    across, down = right - left, bottom - top
    x, y = max(left - across, 0), max(top - down, 0)
    window = clip.steady[hint.frame, y : bottom + down, x : right + across]
    labels = np.zeros(window.shape[:2], np.uint8)
    cv2.setRNGSeed(1)
    cv2.grabCut(
        np.ascontiguousarray(window),
        labels,
        (left - x, top - y, across, down),
        np.zeros((1, 65)),
        np.zeros((1, 65)),
        5,
        cv2.GC_INIT_WITH_RECT,
    )
    own = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    if own.sum() < max(LEAST_PIXELS, 0.1 * across * down):
        raise ObservationError(
            f"{hint.object}: nothing in its box of frame {clip.numbers[hint.frame]} stands out from around it: give an "
            "outline or a circle"
        )
    mask = np.zeros((height, width), bool)
    mask[y : y + own.shape[0], x : x + own.shape[1]] = own
    return mask


def _observed(clip: Clip, tracks: list[eye.Track], scene: Scene, constraints: Sequence[Constraint]) -> Followed:
    """Objects of tracks, and warnings where they are unsure or not found."""
    objects = described(clip, tracks, scene, constraints)
    found = [t.body.name for t in tracks]
    warnings = [
        f"{name} was not found: give its centre, a circle or an outline in a frame that shows it"
        for name in found
        if name not in objects
    ]
    for track in tracks:
        name = track.body.name
        if name in objects:
            warnings += doubts(clip, name, track, objects[name].confidence)
    return Followed(objects, warnings)


def described(
    clip: Clip, tracks: list[eye.Track], scene: Scene, constraints: Sequence[Constraint]
) -> dict[str, ObservedObject]:
    """Objects of tracks that are seen: masks, in each frame's own pixels, and places of solids."""
    masks = masks_of(clip, tracks, scene, constraints)
    seen = describe(masks, clip.frames, {t.body.name: t.confidence for t in tracks})
    objects: dict[str, ObservedObject] = {}
    for track in tracks:
        name = track.body.name
        if name not in seen:
            continue
        made = seen[name]
        sure: Floats = np.where(made.area > 0, track.confidence, 0.0).round(4)
        status = tuple(_status(s, c) for s, c in zip(made.status, sure, strict=True))
        body = track.body
        places = places_of(body, track.poses, track.covariances) if isinstance(body, eye.Solid) else None
        objects[name] = replace(made, status=status, confidence=sure, places=places)
    return objects


def _status(status: Status, sure: float) -> Status:
    return "occluded" if status == "visible" and sure < UNSURE else status


def doubts(clip: Clip, name: str, track: eye.Track, sure: Floats) -> list[str]:
    """Warnings of a track that breaks, or that its pixels do not show well."""
    cure = "look there and give its centre, a circle or an outline"
    found = []
    if track.breaks:
        found.append(f"{name} jumps at frames {[clip.numbers[k] for k in track.breaks]}: {cure}")
    unsure = np.flatnonzero((sure > 0) & (sure < UNSURE))
    if len(unsure) > 0.2 * max(int((sure > 0).sum()), 1):
        first, last = clip.numbers[unsure[0]], clip.numbers[unsure[-1]]
        found.append(f"{name} is unsure in {len(unsure)} of frames {first}..{last}: {cure}")
    return found
