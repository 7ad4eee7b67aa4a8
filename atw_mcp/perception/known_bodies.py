"""From a video and the bodies it is known to show to an observation of these bodies, and of nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from atw_mcp.perception.clip import Clip
from atw_mcp.perception.eye import EyeSettings, Seed
from atw_mcp.perception.eye.colour_names import colour_name, colour_word, log_look
from atw_mcp.perception.eye.finding import find_solids
from atw_mcp.perception.follow_bodies import follow_bodies
from atw_mcp.perception.known_scene import OFF_PLANE, KnownScene
from atw_mcp.perception.observation import ImageObservation, ObservationError, check_camera
from atw_mcp.perception.video import Cancelled, Progress, load, report

NEAR = 2  # pixels around one that is pointed at, that show the body too


@dataclass(frozen=True)
class KnownBody:
    """A solid of a known scene. colour: a description that holds a colour's name; pixel: near its centre (u, v) [px] in
    `frame` of the video, or in the first that has its colour there where that is None."""

    name: str
    colour: str | None
    pixel: tuple[float, float] | None = None
    frame: int | None = None


def observe_known(
    path: str | Path,
    bodies: Sequence[KnownBody],
    scene: KnownScene,
    *,
    stride: int = 1,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> ImageObservation:
    """Find and follow known bodies, which are the scene's solids, in a video.

    A body that was not found is named in the warnings. Raises ObservationError for a body without colour and pixel or
    whose pixel is in a frame that is not looked at, VideoError for a file that cannot be read. Equal inputs give equal
    observations.
    """
    stop = partial(report, None, cancelled)
    for body in bodies:
        if body.pixel is None and colour_word(body.colour or "") is None:
            raise ObservationError(
                f"{body.name}: {body.colour!r} names no colour; names are such as red, dark grey, pink. Or give a pixel"
            )
    info, frames = load(path, stride=stride)
    check_camera(scene.camera, info)
    clip = Clip.of(frames, stride, stop)
    seeds, aside, notes = _seeds(clip, bodies, scene, stop)
    scene = replace(scene, off_plane=aside)
    followed = follow_bodies(clip, seeds, scene, progress, cancelled)
    warnings = [*info.warnings]
    if clip.motion is not None:
        warnings.append("the camera moves a little: frames were aligned to the first before bodies were looked for")
    return ImageObservation(
        info,
        clip.numbers,
        tuple(followed.objects[b.name] for b in bodies if b.name in followed.objects),
        tuple(warnings),
        constraints=tuple(seeds),
        notes=(*followed.warnings, *notes),
        scene=scene,
        camera_motion=clip.motion,
    )


def _seeds(
    clip: Clip, bodies: Sequence[KnownBody], scene: KnownScene, stop: Callable[[], None]
) -> tuple[list[Seed], frozenset[str], list[str]]:
    """Seeds of the bodies that are found, in each frame's own pixels, the names of those not on their plane, and what
    is to be said of them and of those that are not found."""
    words = {b.name: name for b in bodies if (name := colour_name(b.colour or "")) is not None}
    pointed: dict[str, tuple[int, tuple[float, float]]] = {}
    for b in bodies:
        if b.pixel is not None:
            frame = _frame(clip, b, colour_word(b.colour or ""))
            u, v = clip.steadied(np.array([b.pixel]), clip.row(frame))[0]
            pointed[b.name] = (clip.row(frame), (float(u), float(v)))
    solids = [scene.body(b.name) for b in bodies]
    hiding = scene.hiding(clip.frames.shape[1:3])
    found = find_solids(clip.steady, solids, words, pointed, EyeSettings(), hiding, stop)
    seeds: list[Seed] = []
    notes = []
    for b in bodies:
        if b.name not in found:
            if b.pixel is not None:
                seeds.append(Seed(b.name, "centre", clip.numbers[pointed[b.name][0]], b.pixel))
            else:
                notes.append(f"{b.name} was not found: give a circle or an outline of it in a frame that shows it")
            continue
        hint, others = found[b.name].seed, found[b.name].others
        points, frame = clip.filmed(hint.points(), hint.frame), clip.numbers[hint.frame]
        if len(others):
            places = [points.mean(axis=0), *clip.filmed(others, hint.frame)]
            at = " or ".join(f"({u:.0f}, {v:.0f})" for u, v in places)
            notes.append(
                f"{b.name} was not found: in frame {frame} it may be at {at}; give a circle or an outline of it"
            )
            continue
        seeds.append(Seed.outlined(b.name, frame, points.round(2)))
        if not found[b.name].on_plane:
            notes.append(
                f"{b.name} {OFF_PLANE}, or turned otherwise: it leaves that, or its size, the camera or the plane is "
                "not right. It was followed in the image"
            )
    return seeds, frozenset(name for name, one in found.items() if not one.on_plane), notes


def _frame(clip: Clip, body: KnownBody, word: str | None) -> int:
    assert body.pixel is not None
    if body.frame is not None:
        return body.frame
    if word is None:
        return clip.numbers[0]
    column, row = (round(v) for v in body.pixel)
    part = clip.frames[:, max(row - NEAR, 0) : row + NEAR + 1, max(column - NEAR, 0) : column + NEAR + 1]
    for number, frame in zip(clip.numbers, part, strict=True):
        if log_look(frame.reshape(-1, 3), word) > np.log(EyeSettings().named):
            return number
    raise ObservationError(f"{body.name}: no frame shows {word} at pixel {list(body.pixel)}: give the frame too")
