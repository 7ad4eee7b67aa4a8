"""Corrections of an observation by whoever looks at it: where objects are and are not, and which tracks are one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from atw_mcp.perception.body_masks import excluded
from atw_mcp.perception.clip import Clip
from atw_mcp.perception.constraints import Constraint, Exclusion, Rest, Seed, SeedKind, ordered
from atw_mcp.perception.corrections import Correction, Exclude, Outline, Place, Stay
from atw_mcp.perception.describing import describe
from atw_mcp.perception.follow_bodies import Followed, follow_bodies
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.track_edits import TrackEdits
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, load
from polyworld.world.camera import Camera

SHAPES = ("outline", "circle", "box", "centre", "mask")


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

    def stop() -> None:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("correction cancelled")

    stop()
    stride = observation.frames[1] - observation.frames[0] if len(observation.frames) > 1 else 1
    info, frames = load(video_path, stride=stride)
    if info.sha256 != observation.video.sha256:
        raise ObservationError(f"{info.path} is not the video of this observation ({observation.video.path})")
    edits = TrackEdits(observation)
    for correction in corrections:
        edits.apply(correction)
    edits.check()
    constraints = ordered(_constraints(edits, camera))
    _check(constraints, edits)
    again = edits.again or len(edits.statements) > 0
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


def _constraints(edits: TrackEdits, camera: Camera | None) -> list[Constraint]:
    """All constraints that hold: the earlier ones but for seeds that are given again, and the new ones."""
    new = [_constraint(edits, statement, camera) for statement in edits.statements]
    given = [(c.object, c.frame) for c in new if isinstance(c, Seed)]
    twice = sorted({f"{name} in frame {frame}" for name, frame in given if given.count((name, frame)) > 1})
    if twice:
        raise ObservationError(f"two seeds of {', '.join(twice)}: give one of each object in a frame")
    kept = [c for c in edits.constraints if not (isinstance(c, Seed) and (c.object, c.frame) in given)]
    edits.constraints = [*kept, *[c for c in new if c not in kept]]
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


def _constraint(edits: TrackEdits, said: Outline | Place | Exclude | Stay, camera: Camera | None) -> Constraint:
    observation = edits.observation
    observation.row(said.frame)
    width, height = observation.video.width, observation.video.height
    if isinstance(said, Outline):
        return _seed(said, width, height)
    if isinstance(said, Place):
        if camera is None:
            raise ObservationError("a place in the world needs a camera: CalibrateCamera first")
        u, v = (float(x) for x in camera.project(np.array([said.position]))[0])
        if not (0 <= u < width and 0 <= v < height):
            raise ObservationError(
                f"{said.object} in frame {said.frame}: the place {list(said.position)} is seen at pixel "
                f"({u:.0f}, {v:.0f}), outside the image of {width} x {height}"
            )
        return Seed(said.object, "centre", said.frame, (u, v), said.position)
    last = said.frame if said.last_frame is None else said.last_frame
    observation.row(last)
    if last < said.frame:
        raise ObservationError(f"last_frame {last} is before frame {said.frame}")
    if isinstance(said, Stay):
        return Rest(said.object, said.frame, last)
    if said.box is not None and said.mask is not None:
        raise ObservationError("give box or mask, not both: a region is one of them")
    mask = said.mask
    if said.box is not None:
        left, top, wide, tall = said.box
        region = np.zeros((height, width), dtype=bool)
        region[max(round(top), 0) : max(round(top + tall), 0), max(round(left), 0) : max(round(left + wide), 0)] = True
        if not region.any():
            raise ObservationError(f"the box {list(said.box)} lies outside the image of {width} x {height}")
        mask = RunLengthMask.encode(region)
    if mask is not None and (mask.height, mask.width) != (height, width):
        raise ObservationError(f"the mask is {mask.width} x {mask.height}, the image {width} x {height}")
    if mask is None and said.object is None:
        raise ObservationError("exclude needs an object, a region (box or mask), or both")
    return Exclusion(said.frame, last, said.object, mask)


def _seed(said: Outline, width: int, height: int) -> Seed:
    """Return the seed of a statement; raises ObservationError where it has not one shape, or one outside the image."""
    given = [key for key in SHAPES if getattr(said, key) is not None]
    where = f"{said.object} in frame {said.frame}"
    if len(given) != 1:
        raise ObservationError(f"{where}: give one of {', '.join(SHAPES)}, not {', '.join(given) or 'none'}")
    if said.mask is not None:
        return Seed(said.object, "mask", said.frame, said.mask)
    kind: SeedKind
    value: tuple[float, ...]
    if said.outline is not None:
        if len(said.outline) < 3:
            raise ObservationError(f"{where}: an outline has three points or more")
        kind, value, points = "outline", tuple(x for point in said.outline for x in point), np.array(said.outline)
    elif said.circle is not None:
        kind, value, points = "circle", said.circle, np.array([said.circle[:2]])
        if said.circle[2] < 1:
            raise ObservationError(f"{where}: a circle has a radius of 1 px or more")
    elif said.box is not None:
        left, top, wide, tall = said.box
        if wide < 3 or tall < 3:
            raise ObservationError(f"{where}: a box is left, top, width, height of at least 3 px")
        kind, value = "box", (left, top, left + wide, top + tall)
        points = np.array([[left, top], [left + wide, top + tall]])
    else:
        assert said.centre is not None
        kind, value, points = "centre", said.centre, np.array([said.centre])
    if (points.max(axis=0) < 0).any() or (points.min(axis=0) >= [width, height]).any():
        raise ObservationError(f"{where}: the {kind} lies outside the image of {width} x {height}")
    return Seed(said.object, kind, said.frame, value)


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
    assert isinstance(seed.value, tuple)
    flat = np.array(seed.value[:2] if seed.kind == "circle" else seed.value).reshape(-1, 2)
    column, row = flat.mean(axis=0).round().astype(int)
    inside = 0 <= row < region.shape[0] and 0 <= column < region.shape[1]
    return bool(inside and region[row, column])


def _taken(name: str, followed: Followed) -> str:
    return f"{name} is no longer an object: its pixels are " + " or ".join(
        ["excluded", *[f"now of {other}" for other in followed.objects]]
    )


def _equal(masks: list[Mask], others: list[Mask]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(masks, others, strict=True))
