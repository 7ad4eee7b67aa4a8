"""Corrections of an observation by whoever looks at it: outline, add, merge, split, rename, drop."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.import_images import observation_of_masks
from atw_mcp.perception.masks import Mask, MaskError, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.propagation import Propagation
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, load

Point = tuple[float, float]
Box = tuple[float, float, float, float]
_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$")


@dataclass(frozen=True)
class Outline:
    """Says where an object is in one frame; it is then followed from there in both directions.

    Give box (left, top, width, height) [px], points inside it (positive) and outside it (negative), or a mask
    (height, width); several together refine each other. A name not in the observation adds an object.
    """

    object: str
    frame: int
    box: Box | None = None
    positive: tuple[Point, ...] = ()
    negative: tuple[Point, ...] = ()
    mask: RunLengthMask | None = None
    add: bool = False


@dataclass(frozen=True)
class Merge:
    """Two tracks are one object: `second` becomes part of `first`."""

    first: str
    second: str


@dataclass(frozen=True)
class Split:
    """From `frame` on a track is another object, called `name`."""

    object: str
    frame: int
    name: str


@dataclass(frozen=True)
class Rename:
    """An object gets another name."""

    object: str
    name: str


@dataclass(frozen=True)
class Drop:
    """What was taken for an object is none."""

    object: str


Correction = Outline | Merge | Split | Rename | Drop
_KINDS: dict[str, type[Correction]] = {
    "outline": Outline,
    "add": Outline,
    "merge": Merge,
    "split": Split,
    "rename": Rename,
    "drop": Drop,
}


def correction_of(data: dict[str, Any]) -> Correction:
    """A correction from JSON: {"kind": "outline" | "add" | "merge" | "split" | "rename" | "drop", ...fields}.

    A mask is a COCO run-length record. Raises ObservationError naming kinds and fields.
    """
    kind = data.get("kind")
    if kind not in _KINDS:
        raise ObservationError(f"unknown kind of correction {kind!r}; kinds: {list(_KINDS)}")
    fields = {k: v for k, v in data.items() if k != "kind" and v is not None}
    try:
        if isinstance(fields.get("mask"), dict):
            fields["mask"] = RunLengthMask.from_dict(fields["mask"])
        for key in ("positive", "negative"):
            if key in fields:
                fields[key] = tuple((float(x), float(y)) for x, y in fields[key])
        if "box" in fields:
            left, top, width, height = (float(v) for v in fields["box"])
            fields["box"] = (left, top, width, height)
        if kind == "add":
            fields["add"] = True
        return _KINDS[kind](**fields)
    except MaskError as error:
        raise ObservationError(f"{kind}: {error}") from error
    except (TypeError, ValueError) as error:
        names = [f for f in _KINDS[kind].__dataclass_fields__ if f != "add"]
        raise ObservationError(f"{kind}: fields are {names}; {error}") from error


def correct(
    observation: ImageObservation,
    video_path: str | Path,
    corrections: Sequence[Correction],
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """The observation with corrections applied in order; objects not concerned keep their masks.

    Raises ObservationError for an unknown object or frame, a name that is taken or not allowed, and an
    outline that holds no object; VideoError for the video.
    """
    if not corrections:
        return observation
    stride = observation.frames[1] - observation.frames[0] if len(observation.frames) > 1 else 1
    info, frames = load(video_path, stride=stride)
    if info.sha256 != observation.video.sha256:
        raise ObservationError(f"{info.path} is not the video of this observation ({observation.video.path})")
    current = observation
    for k, correction in enumerate(corrections):
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("correction cancelled")
        if progress is not None:
            progress(k / len(corrections), f"applying {type(correction).__name__.lower()}")
        current = _apply(current, frames, correction, cancelled)
    if progress is not None:
        progress(1.0, f"{len(corrections)} corrections applied")
    return current


def _apply(
    observation: ImageObservation, frames: Frames, correction: Correction, cancelled: Cancelled | None
) -> ImageObservation:
    if isinstance(correction, Rename):
        observation.object(correction.object)
        name = _new_name(observation, correction.name)
        objects = tuple(replace(o, name=name) if o.name == correction.object else o for o in observation.objects)
        return replace(observation, objects=objects)
    if isinstance(correction, Drop):
        observation.object(correction.object)
        return replace(observation, objects=tuple(o for o in observation.objects if o.name != correction.object))
    masks = {o.name: _masks(observation, o.name) for o in observation.objects}
    if isinstance(correction, Merge):
        return _merge(observation, frames, masks, correction)
    if isinstance(correction, Split):
        return _split(observation, frames, masks, correction)
    return _outline(observation, frames, masks, correction, cancelled)


def _merge(
    observation: ImageObservation, frames: Frames, masks: dict[str, list[Mask]], correction: Merge
) -> ImageObservation:
    observation.object(correction.first)
    observation.object(correction.second)
    if correction.first == correction.second:
        raise ObservationError("merge needs two different objects")
    extra = masks.pop(correction.second)
    both = sum(bool(a.any() and b.any()) for a, b in zip(masks[correction.first], extra, strict=True))
    masks[correction.first] = [a | b for a, b in zip(masks[correction.first], extra, strict=True)]
    kept = replace(observation, objects=tuple(o for o in observation.objects if o.name != correction.second))
    if both:
        note = f"{correction.first} and {correction.second} were merged though both are seen in {both} frames"
        kept = replace(kept, warnings=(*kept.warnings, note))
    return _rebuilt(kept, frames, masks, {correction.first})


def _split(
    observation: ImageObservation, frames: Frames, masks: dict[str, list[Mask]], correction: Split
) -> ImageObservation:
    observed = observation.object(correction.object)
    row = observation.row(correction.frame)
    if not observed.entry_frame < row <= observed.exit_frame:
        frame_of = observation.frames
        raise ObservationError(
            f"{correction.object} can be split at frames {frame_of[min(observed.entry_frame + 1, observed.exit_frame)]}"
            f"..{frame_of[observed.exit_frame]}, not at {correction.frame}"
        )
    name = _new_name(observation, correction.name)
    series = masks[correction.object]
    empty = np.zeros_like(series[0])
    masks[correction.object] = [m if t < row else empty for t, m in enumerate(series)]
    masks[name] = [empty if t < row else m for t, m in enumerate(series)]
    return _rebuilt(observation, frames, masks, {correction.object, name})


def _outline(
    observation: ImageObservation,
    frames: Frames,
    masks: dict[str, list[Mask]],
    correction: Outline,
    cancelled: Cancelled | None,
) -> ImageObservation:
    name = correction.object
    if correction.add:
        name = _new_name(observation, correction.object)
        masks[name] = [np.zeros(frames.shape[1:3], dtype=bool) for _ in frames]
    else:
        observation.object(name)
    row = observation.row(correction.frame)
    others = np.zeros(frames.shape[1:3], dtype=bool)
    for other, series in masks.items():
        if other != name:
            others |= series[row]
    propagation = Propagation(frames, masks, name, cancelled)
    current = masks[name][row]
    if not current.any() and correction.box is None and correction.mask is None:
        current = propagation.regions_at(row, correction.positive) & ~others
    mask = refine_outline(frames[row], current, others, correction)
    changed = propagation.spread(row, mask)
    return _rebuilt(observation, frames, propagation.masks, changed)


def refine_outline(frame: Frames, current: Mask, others: Mask, correction: Outline) -> Mask:
    """The object's mask in one frame from a box, points or a mask, by GrabCut (Rother et al. 2004)."""
    height, width = frame.shape[:2]
    if correction.box is None and not correction.positive and correction.mask is None:
        raise ObservationError("an outline needs a box, positive points or a mask")
    for x, y in (*correction.positive, *correction.negative):
        if not (0 <= x < width and 0 <= y < height):
            raise ObservationError(f"point ({x:g}, {y:g}) is outside the image of {width} x {height}")
    if correction.mask is not None:
        if (correction.mask.height, correction.mask.width) != (height, width):
            raise ObservationError(
                f"the mask is {correction.mask.width} x {correction.mask.height}, the image {width} x {height}"
            )
        mask = correction.mask.decode()
        if mask.sum() < 8:
            raise ObservationError("the mask holds fewer than 8 pixels")
        if correction.box is None and not correction.positive and not correction.negative:
            return mask
        current = mask
    guess = np.full((height, width), cv2.GC_PR_BGD, np.uint8)
    if correction.box is not None:
        left, top, right, bottom = _inside(correction.box, width, height)
        guess[:] = cv2.GC_BGD
        guess[top:bottom, left:right] = cv2.GC_PR_FGD
        if correction.mask is not None or (correction.positive and current.any()):
            guess[top:bottom, left:right] = np.where(current[top:bottom, left:right], cv2.GC_PR_FGD, cv2.GC_PR_BGD)
    elif current.any():
        guess[current] = cv2.GC_PR_FGD
    else:
        reach = max(6, round(0.04 * min(height, width)))
        for x, y in correction.positive:
            cv2.circle(guess, (round(x), round(y)), reach, cv2.GC_PR_FGD, cv2.FILLED)
    guess[others & (guess == cv2.GC_PR_FGD)] = cv2.GC_PR_BGD if correction.box is None else cv2.GC_PR_FGD
    for points, label in ((correction.positive, cv2.GC_FGD), (correction.negative, cv2.GC_BGD)):
        for x, y in points:
            cv2.circle(guess, (round(x), round(y)), 2, label, cv2.FILLED)
    window = _window(guess, height, width)
    refined = grab_cut(frame[window], guess[window])
    mask = np.zeros((height, width), dtype=bool)
    mask[window] = refined
    mask = _parts_wanted(mask, correction)
    if mask.sum() < 8:
        raise ObservationError(
            "nothing in this outline stands out from its surroundings: give a tighter box, more points, or a mask"
        )
    return mask


def grab_cut(image: Frames, guess: NDArray[np.uint8], iterations: int = 4) -> Mask:
    """Object pixels of an image given a first guess (cv2.GC_* labels); the guess itself where it is one-sided."""
    label = guess.copy()
    inside: Mask = (label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)
    if inside.all() or not inside.any():
        return inside
    cv2.setRNGSeed(0)  # the colour clusters start at random: fixed, so that equal inputs give equal masks
    cv2.grabCut(
        np.ascontiguousarray(image),
        label,
        (0, 0, 1, 1),  # not used with an initial mask
        np.zeros((1, 65)),
        np.zeros((1, 65)),
        iterations,
        cv2.GC_INIT_WITH_MASK,
    )
    result: Mask = (label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)
    return result


def _parts_wanted(mask: Mask, correction: Outline) -> Mask:
    """The connected parts that hold a positive point, or else the largest one."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count <= 2:
        return mask
    wanted = {int(labels[round(y), round(x)]) for x, y in correction.positive} - {0}
    if not wanted:
        wanted = {1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))}
    kept: Mask = np.isin(labels, sorted(wanted))
    return kept


def _window(guess: NDArray[np.uint8], height: int, width: int) -> tuple[slice, slice]:
    """The guess's object with as much surroundings again: enough to learn the background's colours from."""
    y, x = np.nonzero((guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD))
    margin = max(int(0.8 * max(np.ptp(y), np.ptp(x))), 12)
    return (
        slice(max(int(y.min()) - margin, 0), min(int(y.max()) + margin + 1, height)),
        slice(max(int(x.min()) - margin, 0), min(int(x.max()) + margin + 1, width)),
    )


def _inside(box: Box, width: int, height: int) -> tuple[int, int, int, int]:
    left, top, wide, tall = box
    if wide < 3 or tall < 3:
        raise ObservationError(f"a box is (left, top, width, height) of at least 3 px, got {box}")
    x0, y0 = max(round(left), 0), max(round(top), 0)
    x1, y1 = min(round(left + wide), width), min(round(top + tall), height)
    if x1 - x0 < 3 or y1 - y0 < 3:
        raise ObservationError(f"the box {box} lies outside the image of {width} x {height}")
    return x0, y0, x1, y1


def _masks(observation: ImageObservation, name: str) -> list[Mask]:
    empty = np.zeros((observation.video.height, observation.video.width), dtype=bool)
    return [empty if m is None else m.decode() for m in observation.object(name).masks]


def _new_name(observation: ImageObservation, name: str) -> str:
    if not _NAME.match(name):
        raise ObservationError(
            f"{name!r} is not a name: 1 to 64 letters, digits, _ or -, beginning with one of the first two"
        )
    if name in observation.names:
        raise ObservationError(f"the name {name!r} is taken; objects: {list(observation.names)}")
    return name


def _rebuilt(
    observation: ImageObservation, frames: Frames, masks: dict[str, list[Mask]], changed: set[str]
) -> ImageObservation:
    """The observation with the changed objects described anew from their masks."""
    fresh = observation_of_masks(masks, frames, observation)
    by_name = {o.name: o for o in fresh.objects}
    objects = []
    for name in masks:
        old = next((o for o in observation.objects if o.name == name), None)
        if name in changed and name in by_name:
            objects.append(by_name[name])
        elif old is not None and name not in changed:
            objects.append(old)
    return replace(observation, objects=tuple(objects))
