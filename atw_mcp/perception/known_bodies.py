"""From a video and the bodies it is known to show to an observation of these bodies, and of nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from atw_mcp.perception.clip import Clip
from atw_mcp.perception.colour_words import colour_word
from atw_mcp.perception.constraints import Seed
from atw_mcp.perception.eye import EyeSettings
from atw_mcp.perception.follow_bodies import first_frame_showing, follow_bodies
from atw_mcp.perception.known_scene import KnownScene
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
    seeds = [_seed(clip, body) for body in bodies]
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
        notes=tuple(followed.warnings),
        scene=scene,
        camera_motion=clip.motion,
    )


def _seed(clip: Clip, body: KnownBody) -> Seed:
    word = colour_word(body.colour or "")
    if body.pixel is None:
        assert word is not None
        return Seed(body.name, "words", None, word)
    frame = body.frame
    if frame is None:
        frame = clip.numbers[0] if word is None else first_frame_showing(clip, word, body.pixel, EyeSettings())
        if frame is None:
            raise ObservationError(
                f"{body.name}: no frame shows {word} at pixel {list(body.pixel)}: give the frame too"
            )
    return Seed(body.name, "centre", frame, body.pixel)
