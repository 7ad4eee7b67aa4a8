"""Corrections of an observation by whoever looks at it: where objects are and are not, and which tracks are one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from atw_mcp.perception.body_masks import excluded
from atw_mcp.perception.clip import Clip
from atw_mcp.perception.constraints import Constraint, Exclusion, Rest, ordered
from atw_mcp.perception.corrections import Correction
from atw_mcp.perception.describing import describe
from atw_mcp.perception.eye.seeds import Seed
from atw_mcp.perception.follow_bodies import Followed, follow_bodies
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.track_edits import TrackEdits
from atw_mcp.perception.video import Cancelled, Frames, Progress, load, report
from polyworld.world.camera import Camera


def correct(
    observation: ImageObservation,
    video_path: str | Path,
    corrections: Sequence[Correction],
    *,
    camera: Camera | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """Return the observation with corrections applied.

    Merges, splits, renamings and drops apply in the order given. Everything else becomes a constraint, kept with the
    observation and binding for all later corrections: all objects that have a seed are followed again from all their
    seeds; the others keep their masks but for pixels of those. camera: needed for places in the world. Raises
    ObservationError for an unknown object or frame, a name that is taken or not allowed, a seed that shows no object,
    and constraints that contradict each other; VideoError for the video.
    """
    if not corrections:
        return observation
    stop = partial(report, None, cancelled)
    stop()
    stride = observation.frames[1] - observation.frames[0] if len(observation.frames) > 1 else 1
    info, frames = load(video_path, stride=stride)
    if info.sha256 != observation.video.sha256:
        raise ObservationError(f"{info.path} is not the video of this observation ({observation.video.path})")
    edits = TrackEdits(observation, camera)
    for correction in corrections:
        edits.apply(correction)
    edits.check()
    constraints = ordered(_constraints(edits))
    _check(constraints, edits)
    again = edits.again or len(edits.said) > 0
    seeded = any(isinstance(c, Seed) for c in constraints)
    followed = Followed({}, [])
    if again and seeded:
        clip = Clip.of(frames, stride, stop)
        followed = follow_bodies(clip, constraints, edits.scene, progress, cancelled)
    objects = _objects(edits, frames, constraints, followed, again=again and seeded)
    names = {o.name for o in objects}
    gone = [n for n, own in edits.masks.items() if not (n in names or edits.seeded(n)) and any(m.any() for m in own)]
    return replace(
        observation,
        objects=tuple(objects),
        constraints=tuple(c for c in constraints if c.object is None or c.object in names),
        warnings=(*observation.warnings, *edits.notes, *[_taken(name, followed) for name in gone]),
        notes=tuple(followed.warnings) if again else observation.notes,
        scene=edits.scene,
    )


def _objects(
    edits: TrackEdits, frames: Frames, constraints: Sequence[Constraint], followed: Followed, *, again: bool
) -> list[ObservedObject]:
    """Objects in their order: those followed now, those as they were, and those whose masks changed, described."""
    numbers = edits.observation.frames
    masks: dict[str, list[Mask]] = {}
    for name, series in edits.masks.items():
        if (again and edits.seeded(name)) or name in followed.objects:
            continue
        others = [followed.objects[other].masks for other in followed.objects]
        own = []
        for row, mask in enumerate(series):
            mask = excluded(mask, name, numbers[row], constraints)
            for other in others:
                stored = other[row]
                if stored is not None and mask.any():
                    mask = mask & ~stored.decode()
            own.append(mask)
        masks[name] = own
    kept = {n: o for n, o in edits.described.items() if n in masks and _equal(masks[n], edits.masks[n])}
    made = kept | describe(masks, frames, only=[n for n in masks if n not in kept]) | followed.objects
    return [made[name] for name in edits.masks if name in made]


def _constraints(edits: TrackEdits) -> list[Constraint]:
    """All constraints that hold: the earlier ones but for seeds that are given again, and the new ones."""
    given = [(c.object, c.frame) for c in edits.said if isinstance(c, Seed)]
    twice = sorted({f"{name} in frame {frame}" for name, frame in given if given.count((name, frame)) > 1})
    if twice:
        raise ObservationError(f"two seeds of {', '.join(twice)}: give one of each object in a frame")
    kept = [c for c in edits.constraints if not (isinstance(c, Seed) and (c.object, c.frame) in given)]
    edits.constraints = [*kept, *[c for c in edits.said if c not in kept]]
    for name in {name for name, _ in given}:
        _seed_shape(edits, name)
    return edits.constraints


def _seed_shape(edits: TrackEdits, name: str) -> None:
    """Give an object of unknown shape, whose seeds are centres alone, the mask in which it was seen best."""
    own = [c for c in edits.constraints if isinstance(c, Seed) and c.object == name]
    known = edits.scene is not None and name in edits.scene.solids
    described = edits.described.get(name)
    if known or described is None or any(c.kind != "centre" for c in own):
        return
    sure = described.confidence * np.sqrt(described.area / max(float(described.area.max()), 1.0))
    taken = {c.frame for c in own}
    rows = [r for r in np.argsort(-sure, kind="stable") if edits.observation.frames[r] not in taken and sure[r] > 0]
    if rows:
        stored = described.masks[rows[0]]
        assert stored is not None
        edits.constraints.append(Seed(name, "mask", edits.observation.frames[rows[0]], stored))


def _check(constraints: Sequence[Constraint], edits: TrackEdits) -> None:
    """Raise ObservationError where constraints contradict each other, or say nothing about where an object is."""
    for c in constraints:
        if isinstance(c, Rest):
            rows = range(edits.observation.row(c.first), edits.observation.row(c.last) + 1)
            if not edits.seeded(c.object) and not any(edits.masks[c.object][row].any() for row in rows):
                raise ObservationError(
                    f"{c.object} is seen in none of frames {c.first}..{c.last}: outline it in one of them too"
                )
        if not isinstance(c, Exclusion):
            continue
        for seed in constraints:
            if not isinstance(seed, Seed) or not c.first <= seed.frame <= c.last:
                continue
            if c.object in (None, seed.object) and (c.mask is None or _lies_in(seed, c.mask.decode())):
                raise ObservationError(
                    f"{seed.object} was given in frame {seed.frame} where it, or anything, was said not to be: give it "
                    "there again, or exclude a smaller region or fewer frames"
                )


def _lies_in(seed: Seed, region: Mask) -> bool:
    """Whether the middle of a seed lies in a region, or any pixel of a mask."""
    if isinstance(seed.value, RunLengthMask):
        return bool((seed.value.decode() & region).any())
    column, row = seed.points().mean(axis=0).round().astype(int)
    inside = 0 <= row < region.shape[0] and 0 <= column < region.shape[1]
    return bool(inside and region[row, column])


def _taken(name: str, followed: Followed) -> str:
    return f"{name} is no longer an object: its pixels are " + " or ".join(
        ["excluded", *[f"now of {other}" for other in followed.objects]]
    )


def _equal(masks: list[Mask], others: list[Mask]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(masks, others, strict=True))
