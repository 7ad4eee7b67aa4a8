"""Video files in: what a file holds, and its frames as arrays."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.containers import NAMES, decodable

Frames = NDArray[np.uint8]
Progress = Callable[[float, str], None]
Cancelled = Callable[[], bool]

MAX_FRAMES = 2000
MAX_BYTES = 1_500_000_000


class VideoError(ValueError):
    """A file that cannot be read as a video; the message says what is wrong and what to do."""


class PerceptionCancelled(RuntimeError):
    """The caller's `cancelled` returned true."""


@dataclass(frozen=True)
class VideoInfo:
    """Contents of a video file.

    frame_count is the number of frames that really decode, after `stride`; declared_frame_count is what the
    header claims. frames_per_second is the file's own rate, which says nothing certain about physical time.
    width, height [px]; sha256 of the file's bytes.
    """

    path: str
    frame_count: int
    width: int
    height: int
    frames_per_second: float
    sha256: str
    declared_frame_count: int
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {**asdict(self), "warnings": list(self.warnings)}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the inverse of `to_dict`."""
        return cls(**{**data, "warnings": tuple(data["warnings"])})


def probe(path: str | Path) -> VideoInfo:
    """Decode a video once, counting its frames.

    Raises VideoError for a missing file (naming the nearest ones), a folder, an empty file, a file that is not
    a video, a video without frames, and one above 2000 frames or 1.5 GB decoded. A truncated video is
    accepted with a warning that says how many frames decoded.
    """
    file = existing_file(path)
    count, size = 0, (0, 0)
    for number, frame in _decode(file):
        count, size = number + 1, (int(frame.shape[1]), int(frame.shape[0]))
        _refuse_excess(file, count, size, 1)
    return _info(file, count, size, 1)


def load(path: str | Path, *, stride: int = 1) -> tuple[VideoInfo, Frames]:
    """`probe` and `read_frames` in one decoding: info and every `stride`-th frame (T, height, width, 3)."""
    frames = read_frames(path, stride=stride)
    file = existing_file(path)
    return _info(file, len(frames), (int(frames.shape[2]), int(frames.shape[1])), stride), frames


def read_frames(path: str | Path, indices: Sequence[int] | None = None, *, stride: int = 1) -> Frames:
    """Frames as BGR bytes, shape (T, height, width, 3).

    All frames, every `stride`-th one, or those of `indices` (frame numbers of the file, in the order given).
    Frames are decoded in sequence, never sought, so that frame i is the i-th that decodes. Raises VideoError
    as `probe` does, and for an index outside the video.
    """
    file = existing_file(path)
    if stride < 1:
        raise VideoError(f"stride must be 1 or more, got {stride}")
    wanted = None if indices is None else sorted({int(i) for i in indices})
    if wanted is not None and (not wanted or wanted[0] < 0):
        raise VideoError("frame numbers start at 0 and at least one is needed")
    kept: dict[int, Frames] = {}
    count = 0
    for number, frame in _decode(file):
        count = number + 1
        if wanted is not None:
            if number in wanted:
                kept[number] = frame
            if number >= wanted[-1]:
                break
        elif number % stride == 0:
            kept[number] = frame
            _refuse_excess(file, len(kept), (frame.shape[1], frame.shape[0]), stride)
    if count == 0:
        raise VideoError(f"{file} holds no frame that decodes")
    if wanted is not None:
        missing = [i for i in wanted if i not in kept]
        if missing:
            raise VideoError(f"frames {missing[:8]} are outside the video: valid frames are 0..{count - 1}")
        assert indices is not None
        return np.stack([kept[int(i)] for i in indices])
    return np.stack([kept[i] for i in sorted(kept)])


def each_frame(path: str | Path) -> Iterator[Frames]:
    """Yield the frames (height, width, 3) of a video as `read_frames` returns them, one at a time."""
    for _, frame in _decode(existing_file(path)):
        yield frame


@dataclass(frozen=True)
class Coding:
    """How a video file holds its frames.

    codec, pixels: four characters each; declared: the number of frames by its header; times (T,): when each frame that
    decodes begins by the file's own clock [s].
    """

    codec: str
    pixels: str
    declared: int
    times: NDArray[np.float64]


def coding(path: str | Path) -> Coding:
    """Read how a video file holds its frames; raises VideoError as `probe` does."""
    capture = _open(existing_file(path))
    try:
        times = []
        while capture.grab():
            times.append(1e-3 * float(capture.get(cv2.CAP_PROP_POS_MSEC)))
        return Coding(
            codec=_letters(capture.get(cv2.CAP_PROP_FOURCC)),
            pixels=_letters(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)),
            declared=_declared_count(capture),
            times=np.asarray(times, dtype=float),
        )
    finally:
        capture.release()


def existing_file(path: str | Path) -> Path:
    """Return the file at `path`; raises VideoError saying why it cannot be read."""
    file = Path(path).expanduser()
    if file.is_dir():
        inside = sorted(p.name for p in file.iterdir() if p.is_file())[:8]
        raise VideoError(f"{file} is a folder, not a video file; files in it: {inside or 'none'}")
    if not file.exists():
        raise VideoError(f"no file {file}; {_nearest(file)}")
    if file.stat().st_size == 0:
        raise VideoError(f"{file} is empty (0 bytes)")
    return file


def _nearest(file: Path) -> str:
    folder = file.parent
    if not folder.is_dir():
        return f"its folder {folder} does not exist either"
    names = sorted(p.name for p in folder.iterdir() if p.is_file())
    close = difflib.get_close_matches(file.name, names, n=5, cutoff=0.3) or names[:5]
    return f"nearest files in {folder}: {close}" if close else f"{folder} holds no files"


def _open(file: Path) -> cv2.VideoCapture:
    # OpenCV's backends write their own complaints to stderr; the error raised here says all of it.
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        with decodable(file) as name:
            if name is None:
                raise VideoError(f"{file} is not a video file: it does not begin as {NAMES} does")
            capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        raise VideoError(
            f"{file} is not a video this can decode ({file.stat().st_size} bytes, suffix {file.suffix or 'none'}); "
            "a truncated MP4 without its index also fails so: re-encode or download it again"
        )
    return capture


def _decode(file: Path) -> Iterator[tuple[int, Frames]]:
    capture = _open(file)
    try:
        number = 0
        while True:
            decoded, frame = capture.read()
            if not decoded:
                return
            yield number, np.asarray(frame, dtype=np.uint8)
            number += 1
    finally:
        capture.release()


def _letters(code: float) -> str:
    return (int(code) & 0xFFFFFFFF).to_bytes(4, "little").decode("latin-1")


def _sha256(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def _declared_count(capture: cv2.VideoCapture) -> int:
    declared = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    return int(declared) if np.isfinite(declared) and 0 < declared < 1e9 else 0


def _refuse_excess(file: Path, count: int, size: tuple[int, int], stride: int) -> None:
    limit = min(MAX_FRAMES, MAX_BYTES // max(3 * size[0] * size[1], 1))
    if count > limit:
        raise VideoError(
            f"{file} has more than {limit} frames of {size[0]} x {size[1]} at stride {stride}, above the limit of "
            f"{MAX_FRAMES} frames or {MAX_BYTES / 1e9:g} GB decoded: give a larger stride, a shorter or a smaller clip"
        )


def _info(file: Path, count: int, size: tuple[int, int], stride: int) -> VideoInfo:
    capture = _open(file)
    try:
        declared = _declared_count(capture)
        rate = float(capture.get(cv2.CAP_PROP_FPS))
    finally:
        capture.release()
    if count == 0:
        claim = f"; its header claims {declared}" if declared else ""
        raise VideoError(f"{file} holds no frame that decodes{claim}")
    warnings = []
    if -(-declared // stride) > count:
        kept = f" (every {stride}th frame kept)" if stride > 1 else ""
        warnings.append(f"truncated: {count} frames decode{kept}, but the header claims {declared}")
    known = bool(np.isfinite(rate) and rate > 0)
    if not known:
        warnings.append("the file states no frame rate")
    return VideoInfo(
        path=str(file),
        frame_count=count,
        width=size[0],
        height=size[1],
        frames_per_second=rate if known else 0.0,
        sha256=_sha256(file),
        declared_frame_count=declared,
        warnings=tuple(warnings),
    )
