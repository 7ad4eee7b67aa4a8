"""Follow bodies from seeds through a video: from tracks of the eye to objects of an observation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception import eye
from atw_mcp.perception.camera_motion import as_filmed, as_stabilised, camera_motion, in_full_pixels, stabilised
from atw_mcp.perception.constraints import Constraint, Exclusion, Seed
from atw_mcp.perception.describing import describe
from atw_mcp.perception.eye.bodies import Body
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import features, filled
from atw_mcp.perception.eye.regions import reduced
from atw_mcp.perception.eye.seeds import word_map
from atw_mcp.perception.import_images import standing_apart
from atw_mcp.perception.known_scene import KnownScene
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ObservationError, ObservedObject, Status
from atw_mcp.perception.off_plane import OffPlane, has_place, in_image, lying, off_plane
from atw_mcp.perception.places import places_of
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress

Floats = NDArray[np.float64]
UNSURE = 0.35  # confidence below which a body is not in full view, and its frames are named
LEAST = 8  # pixels of a mask
FINER = 8  # parts of a pixel along each axis by which silhouettes are drawn
ALIGNED_PIXELS = 230_000  # of a frame in which the camera's motion is measured: more make it no better
RIM = 0.3  # radii around a silhouette in which a body's pixels are looked for: more is another body's
PASSES = 6  # times that the eye goes through all frames: forward, backward, and its rounds
WHITE = 80.0  # percentile of luminance that a bright background has
LUMINANCE = np.array([0.114, 0.587, 0.299], np.float32)  # of BGR levels, as cv2.cvtColor weighs them


@dataclass(frozen=True)
class Clip:
    """Frames (T, H, W, 3) of a video and their numbers in it; steady: as the first frame's camera would have seen them;
    motion (T, 2, 3): of the camera in full pixels, None where it stands still."""

    frames: Frames
    numbers: tuple[int, ...]
    steady: Frames
    motion: Floats | None

    @classmethod
    def of(cls, frames: Frames, stride: int, tick: Callable[[], None]) -> Clip:
        """Return a clip of every `stride`-th frame, freed of the camera's motion."""
        small, factor = reduced(frames, ALIGNED_PIXELS)
        motion = in_full_pixels(camera_motion(small, tick), 1 / factor)
        steady = frames if motion is None else stabilised(frames, motion)
        return cls(frames, tuple(range(0, stride * len(frames), stride)), steady, motion)

    def row(self, frame: int) -> int:
        """Row of a frame number; raises ObservationError naming frames that are looked at."""
        if frame in self.numbers:
            return self.numbers.index(frame)
        near = sorted(self.numbers, key=lambda n: abs(n - frame))[:2]
        raise ObservationError(
            f"frame {frame} is not looked at (frames {self.numbers[0]}..{self.numbers[-1]}): give one that is, such as "
            + " or ".join(map(str, sorted(near)))
        )

    def steadied(self, points: Floats, row: int) -> Floats:
        """Return points (N, 2) [px] of a row's frame as they lie in the steady one."""
        if self.motion is None:
            return points
        turn, shift = self.motion[row, :, :2], self.motion[row, :, 2]
        return np.asarray((points - shift) @ np.linalg.inv(turn).T)


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
    seeds = [c for c in constraints if isinstance(c, Seed)]
    names = list(dict.fromkeys(s.object for s in seeds))
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("observation cancelled")
        if progress is not None and ticks % 8 == 0:
            progress(min(ticks / (PASSES * len(clip.numbers)), 0.95), f"following {', '.join(names)}")

    hints = [_hint(clip, s) for s in seeds]
    bodies: list[Body] = []
    for name in names:
        own = [h for h in hints if h.body == name]
        solid = scene.body(name) if scene is not None and name in scene.solids else None
        if solid is None or not all(has_place(solid, h) for h in own):
            bodies.append(_outline(clip, name, own, scales=solid is not None))
        else:
            bodies.append(solid)
    hiding = None if scene is None else scene.hiding(clip.frames.shape[1:3])
    try:
        tracks, found = eye.observe(clip.steady, bodies, hints, hiding=hiding, tick=tick)
        on_side = lying(found, tracks)
        if on_side:
            bodies = [replace(b, lies=True) if isinstance(b, eye.Solid) and b.name in on_side else b for b in bodies]
            tracks, found = eye.observe(clip.steady, bodies, hints, hiding=hiding, tick=tick)
        off = off_plane(found, tracks)
        if off:
            bodies = [in_image(b.name, off[b.name].seed) if b.name in off else b for b in bodies]
            hints += [o.seed for o in off.values()]
            tracks, found = eye.observe(clip.steady, bodies, hints, hiding=hiding, tick=tick)
    except ValueError as error:
        raise ObservationError(str(error)) from error
    followed = _observed(clip, tracks, found, constraints)
    return replace(followed, warnings=[*followed.warnings, *[_leaves(clip, name, o) for name, o in off.items()]])


def _leaves(clip: Clip, name: str, off: OffPlane) -> str:
    first, last = clip.numbers[off.rows[0]], clip.numbers[off.rows[-1]]
    return (
        f"{name} is {off.ratio:.1f} times as large in frames {first}..{last} as on its plane of motion: it leaves "
        "that, or its size, the camera or the plane is not right. It was followed in the image"
    )


def _hint(clip: Clip, seed: Seed) -> eye.Seed:
    """Return a seed in steady pixels and rows."""
    if seed.frame is None:
        return eye.Seed(seed.object, seed.kind, None, seed.value)
    row = clip.row(seed.frame)
    if isinstance(seed.value, RunLengthMask):
        mask = seed.value.decode()
        if mask.shape != clip.frames.shape[1:3]:
            height, width = clip.frames.shape[1:3]
            raise ObservationError(f"the mask is {mask.shape[1]} x {mask.shape[0]}, the image {width} x {height}")
        return eye.Seed(
            seed.object, "mask", row, mask if clip.motion is None else as_stabilised(mask, clip.motion[row])
        )
    assert isinstance(seed.value, tuple)
    rest = seed.value[2:] if seed.kind == "circle" else ()
    places = clip.steadied(np.array(seed.value[: len(seed.value) - len(rest)]).reshape(-1, 2), row)
    flat = (*places.ravel().tolist(), *rest)
    return eye.Seed(seed.object, seed.kind, row, places if seed.kind == "outline" else flat)


def _outline(clip: Clip, name: str, hints: list[eye.Seed], *, scales: bool) -> eye.Outline:
    """Body of unknown shape, from its first hint that shows one: an outline, circle or mask before a box."""
    shown = sorted((h for h in hints if h.polygon() is not None), key=lambda h: h.kind == "box")
    if not shown:
        raise ObservationError(
            f"{name}: its shape is not known: give an outline, a circle, a box or a mask of it in one frame"
        )
    first = shown[0]
    if first.kind == "box":
        first = replace(first, kind="mask", value=_in_box(clip, first))
    return replace(eye.outline_body(name, first), scales=scales)


def _in_box(clip: Clip, hint: eye.Seed) -> Mask:
    """Mask (H, W) of what stands out in a box: GrabCut (Rother, Kolmogorov & Blake 2004)."""
    assert hint.frame is not None
    height, width = clip.frames.shape[1:3]
    left, top, right, bottom = (round(float(v)) for v in np.asarray(hint.value))
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if right - left < 3 or bottom - top < 3:
        raise ObservationError(f"{hint.body}: the box is smaller than 3 px, or outside the image of {width} x {height}")
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
    if own.sum() < max(LEAST, 0.1 * across * down):
        raise ObservationError(
            f"{hint.body}: nothing in its box of frame {clip.numbers[hint.frame]} stands out from around it: give an "
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
    masks = _masks(clip, tracks, scene, constraints)
    apart = dict(zip(masks, standing_apart(list(masks.values())), strict=True)) if masks else {}
    white = float(np.percentile(clip.frames[0].astype(np.float32) @ LUMINANCE, WHITE))
    objects: dict[str, ObservedObject] = {}
    for track in tracks:
        name = track.body.name
        own = masks[name]
        made = describe(own, clip.frames, track.confidence.tolist(), apart[name], white)
        if made is None:
            continue
        sure: Floats = np.where(made.area > 0, track.confidence, 0.0).round(4)
        status = tuple(_status(s, c) for s, c in zip(made.status, sure, strict=True))
        places = places_of(track, scene.settings.systematic) if isinstance(track.body, eye.Solid) else None
        objects[name] = replace(made, name=name, status=status, confidence=sure, places=places)
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


def _masks(
    clip: Clip, tracks: list[eye.Track], scene: Scene, constraints: Sequence[Constraint]
) -> dict[str, list[Mask]]:
    """Masks (T) of each track that share no pixel, the nearest first; those given are taken as they are."""
    shape = clip.frames.shape[1:3]
    given = {
        (c.object, clip.row(c.frame)): c.value.decode()
        for c in constraints
        if isinstance(c, Seed) and isinstance(c.value, RunLengthMask) and c.frame is not None
    }
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
            body = tracks[i].body
            own = _as_shown(scene, i, k, drawn) if isinstance(body, eye.Outline) and body.scales else drawn[i]
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
    return mask if mask.sum() >= LEAST else np.zeros_like(mask)


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


def first_frame_showing(clip: Clip, word: str, pixel: tuple[float, float], settings: eye.EyeSettings) -> int | None:
    """Number of the first frame in which a pixel (u, v) has a colour; None where none has."""
    column, row = (round(v) for v in pixel)
    reach = 2
    part = clip.frames[:, max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    usual = features(np.median(part, axis=0).astype(np.float32), settings)[..., 0]
    for k, frame in enumerate(part):
        if word_map(frame, word, usual).mean() > 0:
            return clip.numbers[k]
    return None
