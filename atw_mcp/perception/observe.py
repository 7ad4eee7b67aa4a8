"""From a video to an observation: background, foreground, identities, looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.artefacts import artefacts
from atw_mcp.perception.background import Background, Mask, model_background
from atw_mcp.perception.camera_motion import as_filmed, camera_motion, in_full_pixels, stabilised
from atw_mcp.perception.cues import colour_cue, material_cue, shape_cue
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.naming import matched_to_expected, names_for
from atw_mcp.perception.observation import (
    Cue,
    ImageObservation,
    ObservationError,
    ObservedObject,
    Status,
    measure,
)
from atw_mcp.perception.resweep import resweep
from atw_mcp.perception.segmentation import Foreground, segment, shadows_of, without_shadow
from atw_mcp.perception.tracking import Sweep, Sweeper, touches_border
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, VideoInfo, load

MIN_LIFE = 5  # frames an object must be seen in
ANALYSED_PIXELS = 230_000  # of a frame: larger frames are reduced for finding objects, and masks enlarged again
CUE_SAMPLES = 12  # frames looked at for colour, material and shape


def observe(
    path: str | Path,
    *,
    max_objects: int = 20,
    min_area: int | None = None,
    expected: Sequence[str] | None = None,
    stride: int = 1,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """Find the objects of a video from a fixed camera and follow them.

    min_area [px] is the smallest region taken for an object (default: 0.02% of the image, at least 24).
    `expected` are descriptions such as "blue metal sphere": objects that fit one get it as their name, and
    those not found are named in the warnings. `progress(share, what)` is called as work goes on; when
    `cancelled()` is true PerceptionCancelled is raised. Raises VideoError for a file that cannot be read and
    ObservationError for arguments out of range. Equal inputs give equal observations.
    """
    if not 1 <= max_objects <= 200:
        raise ObservationError(f"max_objects must lie in 1..200, got {max_objects}")
    report = progress or (lambda _share, _what: None)
    report(0.0, "reading the video")
    info, frames = load(path, stride=stride)
    smallest = default_min_area(info) if min_area is None else min_area
    if smallest < 4:
        raise ObservationError(f"min_area must be 4 px or more, got {smallest}")
    full = frames
    frames = reduced(frames)
    smallest = max(round(smallest * frames[0].size / full[0].size), 12)
    count = len(frames)

    def stop() -> None:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("observation cancelled")

    stop()
    looked = 0

    def look() -> None:
        nonlocal looked
        stop()
        looked += 1
        report(0.03 + 0.47 * min(looked / (2 * count), 1.0), f"looking whether the camera moves: {looked} pictures")

    motion = camera_motion(frames, look)
    if motion is not None:
        frames = stabilised(frames, motion)
    report(0.5, "modelling the background")
    background = model_background(frames)
    stop()
    shadow = shadows_of(frames, background)
    foregrounds = []
    for t in range(count):
        stop()
        if t % 8 == 0:
            report(0.55 + 0.2 * t / count, f"segmenting frame {t} of {count}")
        foregrounds.append(segment(frames[t], background, min_area=smallest, shadow=shadow))

    def tick(t: int) -> None:
        stop()
        if t % 8 == 0:
            report(0.75 + 0.1 * t / count, f"tracking frame {t} of {count}")

    sweeper = Sweeper(frames, foregrounds, smallest, max_objects)
    sweep = sweeper.run(tick)
    report(0.85, "tracking backwards")
    sweep = resweep(frames, foregrounds, sweep, stop)
    report(0.92, "reading colours and shapes")
    warnings = list(info.warnings)
    if sweeper.dropped:
        warnings.append(f"more than {max_objects} objects: {sweeper.dropped} regions were left out; raise max_objects")
    if float(background.noise.max()) > 15.0:
        warnings.append(
            f"half of the image changes by {float(background.noise.max()):.0f} grey levels or more between the frames "
            "looked at: does the camera move? Masks are then not to be trusted"
        )
    if not background.smooth:
        warnings.append(
            f"the background is textured (residual {background.texture:.1f} grey levels): objects that never move are "
            "found there only by a colour that occurs nowhere else"
        )
    if motion is not None:
        warnings.append(
            "the camera moves a little: frames were aligned to the first before objects were followed, and their "
            "outlines are in each frame's own pixels"
        )
    out = artefacts(
        {k: [sweep.labels[t] == k for t in range(count)] for k in sweep.tracks}, foregrounds, background, shadow
    )
    for reason, what in (
        ("shadow", "follow objects as their shadows do"),
        ("fragment", "are small, brief and mostly beside a large object, as pieces of its rim or shadow"),
        ("fixed", "never move and are no object at rest, as captions and the places that an object left"),
    ):
        if reason in out.values():
            warnings.append(f"{sum(r == reason for r in out.values())} regions were left out that {what}")
    for number in out:
        del sweep.tracks[number]
    stop()
    observation = assemble(full, foregrounds, sweep, background, info, stride, motion)
    if expected:
        observation, missing = matched_to_expected(observation, tuple(expected))
        warnings += [f"expected {m!r} was not found" for m in missing]
    if not observation.objects:
        warnings.append("no object was found: check that the camera is fixed, or lower min_area")
    report(1.0, f"{len(observation.objects)} objects")
    return replace(observation, warnings=(*observation.warnings, *warnings))


def reduced(frames: Frames) -> Frames:
    """Return the frames, made smaller where they have many more pixels than finding objects needs."""
    height, width = frames.shape[1:3]
    share = np.sqrt(ANALYSED_PIXELS / (height * width))
    if share > 0.85:
        return frames
    size = (round(width * share), round(height * share))
    return np.stack([np.asarray(cv2.resize(f, size, interpolation=cv2.INTER_AREA), dtype=np.uint8) for f in frames])


def enlarged(mask: Mask, height: int, width: int) -> Mask:
    """Return a mask of a reduced frame in the size of the full one."""
    if mask.shape == (height, width) or not mask.any():
        return mask if mask.shape == (height, width) else np.zeros((height, width), dtype=bool)
    large: Mask = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
    return large


def default_min_area(info: VideoInfo) -> int:
    """Smallest region taken for an object [px]."""
    return max(24, round(2e-4 * info.width * info.height))


def assemble(
    frames: Frames,
    foregrounds: list[Foreground],
    sweep: Sweep,
    background: Background,
    info: VideoInfo,
    stride: int,
    motion: NDArray[np.float64] | None = None,
) -> ImageObservation:
    """Return the observation that a finished sweep, perhaps over reduced frames, amounts to; frames are the full ones.

    motion (T, 2, 3): of the camera, where the frames of the sweep were freed of it.
    """
    found: list[ObservedObject] = []
    for number in sorted(sweep.tracks):
        masks = [sweep.labels[t] == number for t in range(len(frames))]
        if sum(bool(m.any()) for m in masks) < min(MIN_LIFE, len(frames)):
            continue
        observed = _object(number, masks, frames, foregrounds, sweep, background.white, motion)
        if observed is not None:
            found.append(observed)
    named = names_for([(o.colour, o.material, o.shape) for o in found])
    objects = tuple(replace(o, name=n) for o, n in zip(found, named, strict=True))
    moved = in_full_pixels(motion, frames.shape[2] / sweep.labels[0].shape[1])
    return ImageObservation(info, tuple(range(0, stride * len(frames), stride)), objects, camera_motion=moved)


def _object(
    number: int,
    masks: list[Mask],
    frames: Frames,
    foregrounds: list[Foreground],
    sweep: Sweep,
    white: float,
    motion: NDArray[np.float64] | None,
) -> ObservedObject | None:
    count = len(frames)
    clear = [t for t in range(count) if number in sweep.alone[t] and masks[t].any() and not touches_border(masks[t])]
    shown = clear or [t for t in range(count) if masks[t].any()]
    has_hue = bool(np.median([float(foregrounds[t].hueless[masks[t]].mean()) for t in shown]) < 0.5)
    for t in range(count):
        if masks[t].any():
            masks[t] = without_shadow(masks[t], foregrounds[t], has_hue=has_hue)
    if motion is not None:
        masks = [as_filmed(m, own) if m.any() else m for m, own in zip(masks, motion, strict=True)]
    masks = [enlarged(m, frames.shape[1], frames.shape[2]) for m in masks]
    clarity = [1.0 if number in sweep.alone[t] else sweep.clarity.get((t, number), 0.0) for t in range(count)]
    return describe(masks, frames, clarity, [number in sweep.alone[t] for t in range(count)], white)


def describe(
    masks: list[Mask], frames: Frames, clarity: list[float], alone: list[bool], white: float
) -> ObservedObject | None:
    """Return an object, still without a name, from its masks; None if it is seen in no frame.

    clarity (T,) says how surely its pixels are distinguished from other objects' (0..1); alone (T,) whether its region
    touches no other object's.
    """
    count = len(masks)
    seen = [t for t in range(count) if masks[t].sum() >= 8]
    if not seen:
        return None
    stored = tuple(RunLengthMask.encode(m) if t in set(seen) else None for t, m in enumerate(masks))
    centroid, box, area = measure(stored)
    border = [touches_border(m) for m in masks]
    clear = [t for t in seen if alone[t] and not border[t]]
    full = _full_area(area, clear or seen, count)
    status: list[Status] = []
    confidence = np.zeros(count)
    first, last = seen[0], seen[-1]
    for t in range(count):
        if stored[t] is None:
            outside = (t < first and border[first]) or (t > last and border[last])
            status.append("absent" if outside else "hidden")
            continue
        share = min(float(area[t] / max(full[t], 1.0)), 1.0)
        if border[t]:
            status.append("truncated")
            confidence[t] = (0.35 + 0.45 * share) * clarity[t]
        elif not alone[t] and share < 0.94:
            status.append("occluded")
            confidence[t] = clarity[t] * (0.15 + 0.75 * share)
        else:
            status.append("visible")
            confidence[t] = 0.97 * clarity[t] * (1.0 if alone[t] else 0.95) * (0.5 + 0.5 * share)
    colour, material, shape = _cues(masks, frames, clear, seen, area, white)
    return ObservedObject(
        name="",
        colour=colour,
        material=material,
        shape=shape,
        status=tuple(status),
        confidence=np.round(confidence, 4),
        centroid=centroid,
        box=box,
        area=area,
        masks=stored,
        entry_frame=first,
        exit_frame=last,
        enters=bool(first > 0 and border[first]) or bool(first == 0 and border[0] and area[0] < 0.9 * full[0]),
        exits=bool(last < count - 1 and border[last]),
    )


def _full_area(area: NDArray[np.int64], clear: list[int], count: int) -> NDArray[np.float64]:
    """Area that the whole object would have in every frame: interpolated between the frames it is clear in."""
    rows = np.array(clear)
    values = area[rows].astype(float)
    if len(values) >= 5:  # a frame with a bad mask must not set the scale
        padded = np.pad(values, 2, mode="edge")
        values = np.median(np.stack([padded[k : k + len(values)] for k in range(5)]), axis=0)
    full: NDArray[np.float64] = np.interp(np.arange(count), rows, values)
    return full


def _cues(
    masks: list[Mask], frames: Frames, clear: list[int], seen: list[int], area: NDArray[np.int64], white: float
) -> tuple[Cue, Cue, Cue]:
    """Colour, material and shape, from the clearest frames."""
    chosen = clear or sorted(seen, key=lambda t: -int(area[t]))[:CUE_SAMPLES]
    picks = sorted({chosen[round(k)] for k in np.linspace(0, len(chosen) - 1, min(CUE_SAMPLES, len(chosen)))})
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    samples = []
    for t in picks:
        inner = cv2.erode(masks[t].astype(np.uint8), disc, borderValue=0) > 0
        samples.append((frames[t], inner if inner.sum() >= 5 else masks[t]))
    return colour_cue(samples, white), material_cue(samples), shape_cue([masks[t] for t in picks])
