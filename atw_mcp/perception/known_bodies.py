"""From a video and the bodies it is known to show to an observation of these bodies, and of nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from atw_mcp.perception.clip import Clip
from atw_mcp.perception.colour_words import colour_name, colour_word
from atw_mcp.perception.constraints import Seed
from atw_mcp.perception.eye import EyeSettings
from atw_mcp.perception.eye.finding import find_solids
from atw_mcp.perception.follow_bodies import first_frame_showing, follow_bodies
from atw_mcp.perception.known_scene import FAR, OFF_PLANE, KnownScene
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.video import Cancelled, PerceptionCancelled, Progress, load


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

    def stop() -> None:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("observation cancelled")

    for body in bodies:
        if body.pixel is None and colour_word(body.colour or "") is None:
            raise ObservationError(
                f"{body.name}: {body.colour!r} names no colour; names are such as red, dark grey, pink. Or give a pixel"
            )
    info, frames = load(path, stride=stride)
    if (scene.camera.width, scene.camera.height) != (info.width, info.height):
        raise ObservationError(
            f"the camera is for images of {scene.camera.width} x {scene.camera.height}, the video has {info.width} x "
            f"{info.height}: calibrate with the video's own size"
        )
    clip = Clip.of(frames, stride, stop)
    seeds, aside = _seeds(clip, bodies, scene, stop)
    scene = replace(scene, off_plane=aside)
    followed = follow_bodies(clip, seeds, scene, progress, cancelled)
    warnings = [*info.warnings]
    if clip.motion is not None:
        warnings.append("the camera moves a little: frames were aligned to the first before bodies were looked for")
    notes = [
        f"{name} {OFF_PLANE}, or turned otherwise: it leaves that, or its size, the camera or the plane is not right. "
        "It was followed in the image"
        for name in sorted(aside)
    ]
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
) -> tuple[list[Seed], frozenset[str]]:
    """Seeds of the bodies that are found, in each frame's own pixels, and the names of those not on their plane."""
    words = {b.name: name for b in bodies if (name := colour_name(b.colour or "")) is not None}
    pointed: dict[str, tuple[int, tuple[float, float]]] = {}
    for b in bodies:
        if b.pixel is not None:
            frame = _frame(clip, b, colour_word(b.colour or ""))
            u, v = clip.steadied(np.array([b.pixel]), clip.row(frame))[0]
            pointed[b.name] = (clip.row(frame), (float(u), float(v)))
    solids = [scene.body(b.name) for b in bodies]
    hiding = scene.hiding(clip.frames.shape[1:3])
    fixed = None if hiding is None else hiding < FAR
    found = find_solids(clip.steady, solids, words, pointed, EyeSettings(), fixed, stop)
    seeds: list[Seed] = []
    for b in bodies:
        if b.name in found:
            hint = found[b.name].seed
            assert hint.frame is not None
            points = clip.filmed(np.asarray(hint.value), hint.frame)
            seeds.append(Seed(b.name, "outline", clip.numbers[hint.frame], tuple(points.ravel().round(2).tolist())))
        elif b.pixel is not None:
            seeds.append(Seed(b.name, "centre", clip.numbers[pointed[b.name][0]], b.pixel))
        else:  # the colour alone, on the plane of motion: grey bodies on grey ground are no regions
            seeds.append(Seed(b.name, "words", None, words[b.name].split()[-1]))
    return seeds, frozenset(name for name, one in found.items() if not one.on_plane)


def _frame(clip: Clip, body: KnownBody, word: str | None) -> int:
    assert body.pixel is not None
    if body.frame is not None:
        return body.frame
    frame = clip.numbers[0] if word is None else first_frame_showing(clip, word, body.pixel, EyeSettings())
    if frame is None:
        raise ObservationError(f"{body.name}: no frame shows {word} at pixel {list(body.pixel)}: give the frame too")
    return frame
