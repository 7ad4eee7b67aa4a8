"""From a video to an observation: bodies are proposed where they move or stand out, and followed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from atw_mcp.perception import eye
from atw_mcp.perception.camera_motion import as_filmed
from atw_mcp.perception.clip import Clip
from atw_mcp.perception.describing import describe
from atw_mcp.perception.eye.colours import learn_colours
from atw_mcp.perception.eye.pixels import features
from atw_mcp.perception.follow_bodies import PASSES, described, doubts
from atw_mcp.perception.masks import Mask
from atw_mcp.perception.naming import matched_to_expected, names_for
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.video import Cancelled, Frames, Progress, VideoInfo, load, report

MIN_LIFE = 5  # frames an object must be seen in
MEANT = 0.5  # probability from which a proposal is taken for a body
SURE = 0.8  # usual confidence of a body that is surely followed
TEXTURED = 4.0  # [levels] of the background about its smooth course: coding and noise of cameras are 1 to 3


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

    Objects at rest are found where they differ from what lies widely around them. min_area [px] is the smallest region
    taken for an object (default: 0.02% of the image, at least 24). `expected` are descriptions such as "blue metal
    sphere": objects that fit one get it as their name, and those not found are named in the warnings. `progress(share,
    what)` is called as work goes on; when `cancelled()` is true PerceptionCancelled is raised. Raises VideoError for a
    file that cannot be read and ObservationError for arguments out of range. Equal inputs give equal observations.
    """
    if not 1 <= max_objects <= 200:
        raise ObservationError(f"max_objects must lie in 1..200, got {max_objects}")
    report(progress, cancelled, 0.0, "reading the video")
    info, frames = load(path, stride=stride)
    smallest = default_min_area(info) if min_area is None else min_area
    if smallest < 4:
        raise ObservationError(f"min_area must be 4 px or more, got {smallest}")
    ticks, steps, first, size, doing = 0, len(frames), 0.03, 0.15, "looking whether the camera moves"

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        report(progress, cancelled, first + size * min(ticks / steps, 1.0), "" if ticks % 8 else doing)

    tick()
    clip = Clip.of(frames, stride, tick)
    ticks, steps, first, size, doing = 0, 3 * len(frames), 0.2, 0.2, "looking for objects"
    proposals = eye.discover(clip.steady, least=smallest, tick=tick)
    warnings = list(info.warnings)
    bodies = [p for p in proposals if p.moves > MEANT]
    if len(bodies) > max_objects:
        warnings.append(
            f"more than {max_objects} objects: {len(bodies) - max_objects} regions were left out; raise max_objects"
        )
    ticks, steps, first, size = 0, PASSES * len(frames), 0.4, 0.55
    doing = f"following {len(bodies[:max_objects])} bodies"
    observation = ImageObservation(info, clip.numbers, (), camera_motion=clip.motion)
    kept, objects, unsure = _objects(clip, bodies[:max_objects], tick)
    observation = replace(observation, objects=tuple(objects))
    warnings += unsure
    for kind, why in (
        ("shadow", "as shadows, since they darken the ground and move as a body does"),
        ("changing", "since their shape changes and they are seen for a part of the time"),
        ("body", "since they are seen briefly, change in size, or rest and are not of the size of what moves"),
    ):
        left = [p for p in proposals if p.kind == kind and p not in kept]
        if left:
            warnings.append(f"left out {why}: {_places(clip, left)}. If one is a body, add it by an outline")
    if expected:
        observation, missing = matched_to_expected(observation, tuple(expected))
        warnings += [f"expected {m!r} was not found" for m in missing]
    if not observation.objects:
        warnings.append("no object was found: check that the camera is fixed, or lower min_area")
    unrest = _unrest(clip.steady)
    if unrest > 15.0:
        warnings.append(
            f"half of the image changes by {unrest:.0f} grey levels or more between the frames "
            "looked at: does the camera move? Masks are then not to be trusted"
        )
    texture = _texture(clip.steady)
    if texture > TEXTURED:
        warnings.append(
            f"the background is textured (residual {texture:.1f} grey levels): bodies that never move are found there "
            "only where they differ by several times as much"
        )
    if clip.motion is not None:
        warnings.append(
            "the camera moves a little: frames were aligned to the first before objects were followed, and their "
            "outlines are in each frame's own pixels"
        )
    report(progress, None, 1.0, f"{len(observation.objects)} objects")
    return replace(observation, warnings=(*observation.warnings, *warnings))


def _objects(
    clip: Clip, proposals: list[eye.Proposal], tick: Callable[[], None]
) -> tuple[list[eye.Proposal], list[ObservedObject], list[str]]:
    """Proposals that are objects, these, named, and warnings where they are unsure.

    All are followed as rigid bodies; those that are not surely followed are kept as seen where they are probable.
    """
    found: dict[str, ObservedObject] = {}
    tracks: dict[str, eye.Track] = {}
    if proposals:
        seeds = [s for p in proposals for s in p.seeds]
        followed, scene = eye.observe(clip.steady, [p.body for p in proposals], seeds, tick=tick)
        tracks = {t.body.name: t for t in followed}
        found = described(clip, followed, scene, ())
    width = clip.frames.shape[2]
    unlike = [
        p for p in proposals if p.regions and not _is_rigid(p, tracks[p.body.name], found.get(p.body.name), width)
    ]
    for p in unlike:
        found.pop(p.body.name, None)
        tracks.pop(p.body.name, None)
    for p in unlike:
        made = _as_seen(clip, p, found) if p.unlike_rigid() > MEANT else None
        if made is not None:
            found[p.body.name] = made
    least = min(MIN_LIFE, len(clip.numbers))
    kept = [p for p in proposals if p.body.name in found and (found[p.body.name].area > 0).sum() >= least]
    looks = [found[p.body.name] for p in kept]
    names = names_for([(o.colour, o.material, o.shape) for o in looks])
    warnings = []
    for name, p, seen in zip(names, kept, looks, strict=True):
        if p.body.name in tracks:
            warnings += doubts(clip, name, tracks[p.body.name], seen.confidence)
        if p in unlike or p.ask:
            if p in unlike:
                why = "its area or shape changes: it may be deformable, several bodies, or a part of one"
            elif p.kind == "changing":
                why = "what moves there changes in area: its outline may be of a part, or of more than it"
            else:
                why = "it only darkens the ground, and may be a shadow, or it is seen briefly"
            warnings.append(f"{name} is doubtful: {why}. Look at it, then outline, drop or merge it")
    return kept, [replace(o, name=n) for n, o in zip(names, looks, strict=True)], warnings


def _is_rigid(proposal: eye.Proposal, track: eye.Track, followed: ObservedObject | None, width: int) -> bool:
    """Whether a body was surely followed, and stays within a radius of where something moves, in most frames."""
    if followed is None or float(np.median(followed.confidence[followed.area > 0])) < SURE:
        return False
    apart = []
    for region in proposal.regions:
        scale = width / region.picture[1]
        middle, pose = (region.centre + 0.5) * scale - 0.5, track.poses[region.frame]
        if np.isfinite(pose[0]):
            apart.append(float(np.linalg.norm(track.centres[region.frame] - middle)) / track.body.radius(pose))
    return len(apart) > 0.5 * len(proposal.regions) and float(np.median(apart)) < 1.0


def _as_seen(clip: Clip, proposal: eye.Proposal, others: dict[str, ObservedObject]) -> ObservedObject | None:
    """Object of a proposal by its regions alone, without pixels of others."""
    count, height, width = clip.frames.shape[:3]
    masks = [np.zeros((height, width), bool) for _ in range(count)]
    for region in proposal.regions:
        mask = region.enlarged(height, width)
        if clip.motion is not None:
            mask = as_filmed(mask, clip.motion[region.frame])
        for other in others.values():
            stored = other.masks[region.frame]
            if stored is not None:
                mask &= ~stored.decode()
        masks[region.frame] = mask
    _complete(clip, masks, proposal.body.radius(np.zeros(4)))
    return describe({proposal.body.name: masks}, clip.frames).get(proposal.body.name)


def _complete(clip: Clip, masks: list[Mask], reach: float) -> None:
    """Add to masks (T) what touches them within a reach [px] and has their colours, which are rare in the film: a part
    that never moves, as the end of a rope that is held, is no difference from the still scene."""
    s = eye.EyeSettings()
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    chosen = seen[:: max(1, len(seen) // 12)]
    own = np.concatenate([clip.frames[k][masks[k]] for k in chosen] or [np.zeros((0, 3))])
    film = clip.frames[chosen].reshape(-1, 3)[::97]
    looks = [features(v.astype(np.float32), s) for v in (own, film)]
    colours, usual = (learn_colours(v, np.zeros((len(v), 2)), s) for v in looks)
    if colours is None or usual is None:
        return
    margin = round(reach)
    for k in seen:
        rows, columns = (np.flatnonzero(masks[k].any(axis=a)) for a in (1, 0))
        window = np.s_[
            max(rows[0] - margin, 0) : rows[-1] + margin + 1, max(columns[0] - margin, 0) : columns[-1] + margin + 1
        ]
        mask = masks[k][window]
        values = features(clip.frames[k][window].astype(np.float32), s).reshape(-1, 3)
        alike = (colours.log_density(values) - usual.log_density(values) > s.rare).reshape(mask.shape)
        near = cv2.dilate(mask.astype(np.uint8), np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0
        parts = cv2.connectedComponents((mask | (alike & near)).astype(np.uint8), connectivity=4)[1]
        masks[k][window] = np.isin(parts, np.unique(parts[mask]))


def _places(clip: Clip, proposals: list[eye.Proposal]) -> str:
    """Where proposals are, in words."""
    at = []
    for p in proposals:
        (u, v), frame = p.centre(), p.seeds[0].frame
        at.append(f"({u:.0f}, {v:.0f}) in frame {clip.numbers[frame or 0]}")
    return ", ".join(at)


def default_min_area(info: VideoInfo) -> int:
    """Smallest region taken for an object [px]."""
    return max(24, round(2e-4 * info.width * info.height))


def _texture(frames: Frames) -> float:
    """Levels by which half of the still scene differs from its smooth course."""
    middle = np.median(frames[:: max(1, len(frames) // 12)], axis=0).astype(np.uint8)
    smooth = cv2.medianBlur(middle, 2 * (min(middle.shape[:2]) // 40) + 5)
    return 1.48 * float(np.median(np.abs(middle.astype(np.int16) - smooth).mean(axis=2)))


def _unrest(frames: Frames) -> float:
    """Levels by which half of the image changes between frames."""
    sample = frames[:: max(1, len(frames) // 12), ::4, ::4].astype(np.int16)
    if len(sample) < 3:
        return 0.0
    return float(np.median(np.abs(np.diff(sample, axis=0))) / np.sqrt(2))
