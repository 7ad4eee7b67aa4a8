"""Films in: what a file holds, and its frames as arrays, each with the time at which it was taken."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.decoding import Coding, coding, combed, decode
from atw_mcp.perception.decoding import Frames as Frames
from atw_mcp.perception.decoding import VideoError as VideoError

Progress = Callable[[float, str], None]
Cancelled = Callable[[], bool]

MAX_FRAMES = 2000
MAX_BYTES = 1_500_000_000
REPEATED = 0.25  # of the usual largest change from frame to frame [grey levels]: coding changes a repeated one by 0.1
FEWEST_CHANGES = 5  # changes, all n frames apart, that show a film of pictures shown n times: by chance n**-5


class PerceptionCancelled(RuntimeError):
    """The caller's `cancelled` returned true."""


def report(progress: Progress | None, cancelled: Cancelled | None, share: float = 0.0, what: str = "") -> None:
    """Report a share of the work, where it is named; raises PerceptionCancelled where the caller wants it to end."""
    if cancelled is not None and cancelled():
        raise PerceptionCancelled("cancelled")
    if progress is not None and what:
        progress(share, what)


@dataclass(frozen=True)
class VideoInfo:
    """Contents of a video file.

    frame_count is the number of frames that really decode, after `stride`; declared_frame_count is what the header
    claims. frames_per_second is the file's own rate, which says nothing certain about physical time. width, height
    [px]; sha256 of the file's bytes. shown_times: how many times each picture of the film is shown before the next.
    clock: when each frame that decodes was taken by the file's time stamps, from the first, in units of
    1 / frames_per_second; None where frame i was at i.
    """

    path: str
    frame_count: int
    width: int
    height: int
    frames_per_second: float
    sha256: str
    declared_frame_count: int
    warnings: tuple[str, ...] = ()
    shown_times: int = 1
    clock: tuple[float, ...] | None = None

    def moments(self, frames: Sequence[int]) -> NDArray[np.float64] | None:
        """Return when frames (T,) were taken, in units of 1 / frames_per_second; None where frame i was at i."""
        return None if self.clock is None else np.array([self.clock[f] for f in frames])

    def facts(self) -> dict[str, Any]:
        """JSON-ready values for a reader, without the time stamps."""
        return {k: v for k, v in self.to_dict().items() if k not in ("shown_times", "clock")}

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values; `from_dict` reads them back."""
        values = {**asdict(self), "warnings": list(self.warnings)}
        if self.shown_times == 1:
            values.pop("shown_times")
        if self.clock is None:
            values.pop("clock")
        return values

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the inverse of `to_dict`."""
        clock = data.get("clock")
        return cls(**{**data, "warnings": tuple(data["warnings"]), "clock": None if clock is None else tuple(clock)})


def probe(path: str | Path) -> VideoInfo:
    """Decode a video once: count its frames, read their times, and compare each with the one before.

    Raises VideoError for a missing file (naming the nearest ones), a folder without numbered pictures, an empty file,
    a file that is not a video, a video without frames or of equal frames, and one above 2000 frames or 1.5 GB decoded.
    A truncated video is accepted with a warning that says how many frames decoded.
    """
    file = existing_film(path)
    film = _Film(file, 1)
    for moment, frame in decode(file):
        film.add(moment, frame)
    return film.info()


def load(path: str | Path, *, stride: int = 1) -> tuple[VideoInfo, Frames]:
    """`probe` and `read_frames` in one decoding: info and every `stride`-th frame (T, height, width, 3)."""
    if stride < 1:
        raise VideoError(f"stride must be 1 or more, got {stride}")
    file = existing_film(path)
    film, kept = _Film(file, stride), []
    for number, (moment, frame) in enumerate(decode(file)):
        film.add(moment, frame)
        if number % stride == 0:
            kept.append(frame)
    return film.info(), np.stack(kept)


def read_frames(path: str | Path, indices: Sequence[int] | None = None, *, stride: int = 1) -> Frames:
    """Frames as BGR bytes, shape (T, height, width, 3).

    All frames, every `stride`-th one, or those of `indices` (frame numbers of the file, in the order given).
    Frames are decoded in sequence, never sought, so that frame i is the i-th that decodes. Raises VideoError
    as `probe` does, and for an index outside the video.
    """
    if indices is None:
        return load(path, stride=stride)[1]
    wanted = {int(i) for i in indices}
    if not wanted or min(wanted) < 0:
        raise VideoError("frame numbers start at 0 and at least one is needed")
    kept: dict[int, Frames] = {}
    count = 0
    for number, frame in enumerate(each_frame(path)):
        count = number + 1
        if number in wanted:
            kept[number] = frame
        if len(kept) == len(wanted):
            return np.stack([kept[int(i)] for i in indices])
    missing = sorted(wanted - set(kept))
    raise VideoError(f"frames {missing[:8]} are outside the video: valid frames are 0..{count - 1}")


def each_frame(path: str | Path) -> Iterator[Frames]:
    """Yield the frames (height, width, 3) of a video as `read_frames` returns them, one at a time."""
    for _, frame in decode(existing_film(path)):
        yield frame


def existing_film(path: str | Path) -> Path:
    """Return the file or the folder of pictures at `path`; raises VideoError saying why it cannot be read."""
    file = Path(path).expanduser()
    return file if file.is_dir() else existing_file(file)


def existing_file(path: str | Path) -> Path:
    """Return the file at `path`; raises VideoError saying why it cannot be read."""
    file = Path(path).expanduser()
    if file.is_dir():
        inside = sorted(p.name for p in file.iterdir() if p.is_file())[:8]
        raise VideoError(f"{file} is a folder, not a file; files in it: {inside or 'none'}")
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


class _Film:
    """Facts of a film, gathered as its frames are decoded; every `stride`-th of them is kept in memory."""

    def __init__(self, file: Path, stride: int) -> None:
        self.file, self.stride, self.held = file, stride, coding(file)
        self.moments: list[float | None] = []
        self.changes: list[float] = []  # largest change from the frame before [grey levels]
        self.last: Frames | None = None

    def add(self, moment: float | None, frame: Frames) -> None:
        if self.last is not None and self.last.shape != frame.shape:
            raise VideoError(f"{self.file}: frame {len(self.moments)} has another size than those before: re-encode it")
        self.moments.append(moment)
        limit = min(MAX_FRAMES, MAX_BYTES // max(frame.size, 1))
        if -(-len(self.moments) // self.stride) > limit:
            raise VideoError(
                f"{self.file} has more than {limit} frames of {frame.shape[1]} x {frame.shape[0]} at stride "
                f"{self.stride}, above the limit of {MAX_FRAMES} frames or {MAX_BYTES / 1e9:g} GB decoded: give a "
                "larger stride, a shorter or a smaller clip"
            )
        if self.last is not None:
            self.changes.append(float(cv2.norm(self.last, frame, cv2.NORM_INF)))
        self.last = frame

    def info(self) -> VideoInfo:
        count, declared = len(self.moments), self.held.declared
        if self.last is None:
            claim = f"; its header claims {declared}" if declared else ""
            raise VideoError(f"{self.file} holds no frame that decodes{claim}")
        if count > 1 and not any(self.changes):
            raise VideoError(
                f"all {count} frames of {self.file} are equal: nothing moves in it. If it plays with motion elsewhere, "
                "re-encode it, as with ffmpeg -i FILM -c:v libx264 NEW.mp4"
            )
        warnings = []
        if declared > count:
            warnings.append(f"truncated: {count} frames decode, but the header claims {declared}")
        if self.held.codec != "pictures" and combed(self.file):
            warnings.append(
                "frames hold two fields of their own times (interlaced): deinterlaced, every other row interpolated"
            )
        rate, clock, doubt = frame_times(self.moments, self.held)
        shown, repeats = repeated(self.changes)
        if shown > 1:
            motion = f": motion is at {rate / shown:.6g} frames per second" if rate else ""
            looked = f"frames 0, {shown}, {2 * shown}, ... are looked at"
            warnings.append(f"each picture is shown {shown} times{motion}; {looked}")
        elif repeats:
            warnings.append(
                f"{len(repeats)} frames repeat the one before while all moves (frames {_listed(repeats)}): pictures "
                "were lost, and the places seen in these frames are late"
            )
        return VideoInfo(
            path=str(self.file),
            frame_count=-(-count // self.stride),
            width=int(self.last.shape[1]),
            height=int(self.last.shape[0]),
            frames_per_second=rate,
            sha256=_sha256(self.file),
            declared_frame_count=declared,
            warnings=(*warnings, *doubt),
            shown_times=shown,
            clock=clock,
        )


def frame_times(
    stamps: Sequence[float | None], held: Coding
) -> tuple[float, tuple[float, ...] | None, tuple[str, ...]]:
    """Return a film's frame rate [1/s], its clock as of `VideoInfo`, and warnings.

    Stamps are rounded to the file's tick: where one rate explains all of them within it, the film has that rate.
    Else every frame keeps its stamp, and the rate is the mean one. 0 where the file states no rate.
    """
    stated = float(held.rate or 0.0)
    times = np.array([np.nan if s is None else s for s in stamps])
    times -= times[0]
    order = np.arange(1, len(times))
    if held.codec == "pictures":
        doubt = ("the pictures state no frame rate: give seconds_per_frame",)
        return 0.0, None if np.array_equal(times[1:], order) else tuple(times.tolist()), doubt
    if len(times) < 2 or not np.all(np.diff(times) > 0.0):
        if not stated:
            return 0.0, None, ("the file states no frame rate",)
        lacking = f"its frames have no increasing time stamps: {stated:.6g} per second, as its header says, are assumed"
        return stated, None, (lacking,) * (len(times) > 1)
    slack = held.tick * (1.0 + 1e-6)
    least, most = float(np.max((times[1:] - slack) / order)), float(np.min((times[1:] + slack) / order))
    if least <= most:
        even = stated if stated and least <= 1.0 / stated <= most else 2.0 / (least + most)
        return even, None, ()
    gaps, mean = np.diff(times), float(order[-1] / times[-1])
    off = float(np.abs(times - np.arange(len(times)) / mean).max())
    warning = (
        f"frames are {gaps.min():.4g} to {gaps.max():.4g} s apart: each keeps its own time, up to {off:.2g} s from "
        "frame / frames_per_second"
    )
    return mean, tuple((times * mean).tolist()), (warning,)


def repeated(changes: Sequence[float]) -> tuple[int, list[int]]:
    """Return how many times each picture of a film is shown, and the frames that repeat the one before amid motion.

    changes (T - 1,): how much each frame differs from the one before. A frame repeats where that is a small part of
    the usual change; every picture is shown n times where all changes are a multiple of n frames apart.
    """
    size = np.asarray(changes)
    moved = size > REPEATED * np.median(size[size >= np.median(size)]) if len(size) else np.zeros(0, dtype=bool)
    at = np.flatnonzero(moved) + 1
    shown = int(np.gcd.reduce(np.diff(at))) if len(at) > FEWEST_CHANGES else 1
    still = [f for a, b in pairwise(at) if b - a <= 2 for f in range(int(a) + 1, int(b))]
    return max(shown, 1), still


def _sha256(file: Path) -> str:
    digest = hashlib.sha256()
    for part in sorted(p for p in file.iterdir() if p.is_file()) if file.is_dir() else [file]:
        with part.open("rb") as content:
            while block := content.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _listed(frames: Sequence[int], most: int = 8) -> str:
    return ", ".join(map(str, frames[:most])) + ", ..." * (len(frames) > most)
