"""Decode films with FFmpeg: upright frames of square pixels, deinterlaced, each with its own time stamp.

FFmpeg chooses a reader by content and by name, and some of its readers open further files or addresses: playlists
(HLS, DASH, concat), session descriptions, numbered images. A file is decoded only if it begins as a container that
holds its own pictures, and is handed over open, whatever its path becomes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import chain, islice
from pathlib import Path

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.filter import Graph
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from polyworld.core import interruption

Frames = NDArray[np.uint8]

NAMES = "MP4 or MOV, Matroska or WebM, AVI, MPEG, FLV, Ogg, ASF, GIF, APNG, MJPEG, Y4M or IVF"
PICTURES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")  # what OpenCV reads
LOOKED_AT = 60  # frames by whose content a film is taken for interlaced: some hold motion
COMBED = 0.25  # share of these: of progressive films the filter's first decisions mark up to four
_HEAD = 4 * 188 + 1  # bytes: four packets of a transport stream
_STARTS = (
    b"\x1a\x45\xdf\xa3",  # Matroska, WebM
    b"\x00\x00\x01\xba",  # MPEG program stream
    b"\x00\x00\x01\xb3",  # MPEG video
    b"\x00\x00\x01\x67",  # H.264
    b"\x00\x00\x00\x01",  # H.264, H.265
    b"FLV\x01",
    b"OggS",
    b"\x30\x26\xb2\x75\x8e\x66\xcf\x11",  # ASF, WMV
    b"GIF87a",
    b"GIF89a",
    b"\x89PNG\r\n\x1a\n",  # APNG
    b"\xff\xd8\xff",  # MJPEG
    b"YUV4MPEG2",
    b"DKIF",  # IVF
)
_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot")  # of MP4 and MOV, after a length


class VideoError(ValueError):
    """A file that cannot be read as a video; the message says what is wrong and what to do."""


@dataclass(frozen=True)
class Coding:
    """How a video file holds its frames.

    codec: FFmpeg's name of the format; pixels: its pixel format; declared: the number of frames by the header, 0 where
    it says none; rate: the header's rate [1/s], None where it says none; tick: the unit of its time stamps [s].
    """

    codec: str
    pixels: str
    declared: int
    rate: Fraction | None
    tick: float


def decode(path: Path) -> Iterator[tuple[float | None, Frames]]:
    """Yield time stamp [s] and picture (height, width, 3), BGR, of each frame; packets that do not decode are left out.

    The pictures of a folder have the numbers in their names for time stamps, counted from the first [frames].
    Raises `Interrupted` where the computation was asked to end.
    """
    if path.is_dir():
        numbers = _numbered(path)
        for number, file in sorted(numbers.items()):
            interruption.check()
            picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
            if picture is None:
                raise VideoError(f"{file} is not a picture this can decode")
            yield float(number - min(numbers)), np.asarray(picture, dtype=np.uint8)
        return
    two_fields = combed(path)
    with _opened(path) as (container, stream):
        ratio = stream.sample_aspect_ratio or Fraction(1)
        for frame in _progressive(_decoded(container, stream), two_fields):
            interruption.check()  # a long film takes many seconds
            yield frame.time, _upright(frame, ratio)


def coding(path: Path) -> Coding:
    """Read how a video file, or a folder of numbered pictures, holds its frames."""
    if path.is_dir():
        numbers = _numbered(path)
        return Coding("pictures", "bgr24", len(numbers), None, 0.0)
    with _opened(path) as (_, stream):
        codec, tick = stream.codec_context, float(stream.time_base or 0)
        if stream.codec_context.name == "gif":
            tick = 0.01  # its delays are whole hundredths of a second
        rate = stream.guessed_rate or stream.average_rate
        return Coding(codec.codec.canonical_name, codec.pix_fmt or "", stream.frames, rate, tick)


def media_times(path: Path) -> NDArray[np.float64]:
    """Time stamps [s] of the frames that decode, by the file's own clock; of pictures of a folder, their numbers."""
    if path.is_dir():
        return np.array(sorted(_numbered(path)), dtype=float)
    with _opened(path) as (container, stream):
        return np.array([np.nan if f.time is None else f.time for f in _decoded(container, stream)], dtype=float)


def is_container(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a video container that is read here."""
    if head.startswith(_STARTS) or head[4:8] in _BOXES:
        return True
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return True
    return len(head) >= _HEAD and all(head[i] == 0x47 for i in range(0, _HEAD, 188))  # MPEG transport stream


@contextmanager
def _opened(file: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    if not file.is_file():
        raise VideoError(f"{file} is not a regular file")
    with file.open("rb") as content:
        head = content.read(_HEAD)
        if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
            raise VideoError(f"{file} is WebP, whose animations FFmpeg does not decode: save it as APNG, GIF or MP4")
        if not is_container(head):
            raise VideoError(f"{file} is not a video file: it does not begin as {NAMES} does")
        content.seek(0)
        try:
            with av.open(content, "r") as container:
                stream = container.streams.best("video")
                if not isinstance(stream, VideoStream):
                    raise VideoError(f"{file} is not a video: it holds no video stream")
                yield container, stream
        except av.FFmpegError as error:
            raise VideoError(
                f"{file} is not a video this can decode ({file.stat().st_size} bytes, suffix {file.suffix or 'none'}): "
                f"{error.strerror}; a truncated MP4 without its index "
                "also fails so: re-encode or download it again"
            ) from error


def _decoded(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    try:
        for packet in container.demux(stream):
            try:
                yield from stream.codec_context.decode(packet)
            except av.InvalidDataError:
                continue  # a broken packet; those after it may decode
    except (av.InvalidDataError, av.EOFError):
        return  # cut short: the frames that there are have been given


def combed(path: Path) -> bool:
    """Whether many of a film's first frames hold two fields by their content (FFmpeg's idet), whatever they are marked.

    A film that was coded again without deinterlacing is not marked, and shows moving bodies twice, in combs.
    """
    held = path.stat()
    return _combed(path, held.st_size, held.st_mtime_ns)


@lru_cache(maxsize=64)
def _combed(path: Path, size: int, changed: int) -> bool:
    """Look once at a file as long as its size [bytes] and last change [ns] stay the same."""
    del size, changed
    with _opened(path) as (container, stream):
        frames = list(_through(islice(_decoded(container, stream), LOOKED_AT), "idet"))
    return sum(f.interlaced_frame for f in frames) > COMBED * len(frames)


def _progressive(frames: Iterator[VideoFrame], two_fields: bool) -> Iterator[VideoFrame]:
    """Deinterlace frames that are marked as interlaced, or all, one for each; the others pass as they are."""
    for frame in frames:
        if two_fields or frame.interlaced_frame:
            which = "all" if two_fields else "interlaced"
            yield from _through(chain([frame], frames), "bwdif", f"mode=send_frame:parity=auto:deint={which}")
        else:
            yield frame


def _through(frames: Iterator[VideoFrame], name: str, arguments: str | None = None) -> Iterator[VideoFrame]:
    """Pass frames through one of FFmpeg's filters."""
    graph: Graph | None = None
    for frame in frames:
        if graph is None:
            graph = Graph()
            source = graph.add_buffer(
                width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
            )
            graph.link_nodes(source, graph.add(name, arguments), graph.add("buffersink")).configure()
        graph.vpush(frame)
        yield from _filtered(graph)
    if graph is not None:
        graph.vpush(None)
        yield from _filtered(graph)


def _filtered(graph: Graph) -> Iterator[VideoFrame]:
    while True:
        try:
            frame = graph.vpull()
        except (av.BlockingIOError, av.EOFError):
            return
        yield frame


def _upright(frame: VideoFrame, ratio: Fraction) -> Frames:
    """Return the picture with square pixels, ratio: width of a pixel over its height, turned as the file says."""
    width, height = frame.width, frame.height
    if ratio > 1:
        width = round(width * ratio)
    elif ratio < 1:
        height = round(height / ratio)
    if frame.rotation % 90:
        raise VideoError(f"the file says that it is to be turned by {frame.rotation} degrees: re-encode it upright")
    picture = frame.to_ndarray(format="bgr24", width=width, height=height)
    return np.ascontiguousarray(np.rot90(picture, frame.rotation // 90), dtype=np.uint8)


def _numbered(folder: Path) -> dict[int, Path]:
    """Pictures of a folder by the numbers that end their names' stems; raises VideoError where they are no series."""
    inside = sorted(p for p in folder.iterdir() if p.is_file() and not p.is_symlink())
    pictures = [p for p in inside if p.suffix.lower() in PICTURES]
    found = [re.fullmatch(r"(.*?)(\d+)", p.stem) for p in pictures]
    series = {(m[1], p.suffix.lower()) for m, p in zip(found, pictures, strict=True) if m}
    if not pictures or None in found or len(series) != 1:
        named = [p.name for p in inside][:8] or "none"
        raise VideoError(
            f"{folder} is a folder, not a video file, and no series of numbered pictures (as frame_0001.png, "
            f"frame_0002.png, ...); files in it: {named}"
        )
    numbers = {int(m[2]): p for m, p in zip(found, pictures, strict=True) if m}
    if len(numbers) < len(pictures):
        raise VideoError(f"{folder} has several pictures of one number: {[p.name for p in pictures][:8]}")
    return numbers
