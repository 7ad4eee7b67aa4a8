"""The video of a case as browsers play it: the file itself where they can, else transcoded to WebM.

Frame i of the film is the i-th frame that decodes from the file, which is frame i of every observation.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.cases.cases import path_hash
from atw_mcp.perception.decoding import Coding, Frames, VideoError, coding, media_times
from atw_mcp.perception.video import each_frame, existing_film
from atw_mcp.viewer.document import Film, ViewDocument
from atw_mcp.viewer.packing import Blocks
from evidence_store import Case

MAX_BYTES = 8_000_000  # of a film: base64 adds a third, and a report of 15 MB holds the page and the worlds as well
LONGEST_SIDE = 960  # [px] of a transcoded frame: more than a panel of the page shows
SHORTEST_LONG_SIDE = 240  # [px] below which outlines no longer show what they enclose
MOST_PIXELS = 40e6  # of all transcoded frames: 2 s of encoding on one core, 8 s and 5 MB where they are noisy
RATE = 25.0  # [1/s] of a transcoded film: a frame begins on a whole millisecond, the unit of WebM
EVEN_START = 1e-3  # [s] players differ in what they show before a first frame that begins later

MP4_CODECS = {"h264", "vp9", "av1"}
WEBM_CODECS = {"vp8", "vp9", "av1"}
PLAIN_PIXELS = "yuv420p"  # 4:2:0, 8 bits: what decoders of every browser take
EBML = b"\x1a\x45\xdf\xa3"
MATROSKA, WEBM = b"B\x82\x88matroska", b"B\x82\x88webm\0\0\0\0"  # the element that names the kind of file
CLUSTER = b"\x1f\x43\xb6\x75"  # the element of Matroska that frames are in


def with_film(document: ViewDocument, blocks: Blocks, case: Case, path: Path) -> ViewDocument:
    """Return a document with the film of the case's video, or with a sentence in `missing` that says why it has none.

    path: where the file is now. A case without a video is returned as it is.
    """
    if case.kind != "video" or not case.path:
        return document
    shown, why = film(case, path, blocks, _covered(document, blocks))
    missing = [*document.missing, why] if why else document.missing
    return document.model_copy(update={"film": shown, "missing": missing})


def _covered(document: ViewDocument, blocks: Blocks) -> int:
    """How many frames of the video, from the first, the worlds model, rollouts reach, or were looked at."""
    steps = {world.id: world.seconds_per_frame for world in document.worlds}
    counts = [world.frame_count for world in document.worlds]
    counts += [int(np.ceil(r.horizon / steps[r.world])) + 1 for r in document.rollouts if r.world in steps]
    if document.observed is not None and document.observed.frames.shape[0]:
        looked_at = document.observed.frames
        counts.append(int(np.frombuffer(blocks.joined(), "<i4", looked_at.shape[0], looked_at.offset)[-1]) + 1)
    return max(counts, default=0)


def film(case: Case, path: Path, blocks: Blocks, covered: int = 0) -> tuple[Film | None, str]:
    """Return the film of a case's video and "", or None and a sentence that says why there is none.

    path: where the file is now; covered: how many frames, from the first, worlds and observations cover (0: unknown),
    which are all that a long video is shown of where it is transcoded.
    """
    if not path.exists():
        where = "not where it was when the case was opened: OpenCase(video=PATH) with its new place continues the case"
        return None, f"The video is not shown: {path.name} is {where}."
    try:
        file = existing_film(path)
        if path_hash(file) != case.content:
            return None, f"The video is not shown: {file.name} has changed since the case was opened."
        held, times = coding(file), media_times(file)
        if not len(times):
            raise VideoError(f"{file.name} holds no frame that decodes")
        first = next(each_frame(file))
        height, width = int(first.shape[0]), int(first.shape[1])
        mime, why = _playable(file, held, times)
        if mime:
            data = file.read_bytes()
            note = "The video file itself."
        else:
            data, times, note = _transcoded(file, (width, height), len(times), covered)
            mime, note = 'video/webm; codecs="vp8"', f"{note}, because {why}."
    except (VideoError, OSError) as error:
        return None, f"The video is not shown: {str(error).replace(str(path), path.name)}."
    shown = Film(
        mime=mime,
        data=blocks.raw(data),
        url=None,
        width=width,
        height=height,
        frame_count=len(times),
        media_times=blocks.floats(times),
        note=note,
    )
    return shown, ""


def _playable(file: Path, held: Coding, times: NDArray[np.float64]) -> tuple[str, str]:
    """The media type of a file that browsers play frame by frame, or "" and why they may not."""
    if file.is_dir():
        return "", "browsers do not play pictures of a folder"
    size = file.stat().st_size
    with file.open("rb") as content:
        head = content.read(64)
    if head[4:8] == b"ftyp" and head[8:12] != b"qt  ":
        mime, codecs = "video/mp4", MP4_CODECS
    elif head.startswith(EBML) and b"webm" in head:
        mime, codecs = "video/webm", WEBM_CODECS
    else:
        return "", "browsers do not play files of its kind"
    if held.codec not in codecs:
        return "", f"browsers do not play its codec, {held.codec}"
    if held.pixels != PLAIN_PIXELS:
        return "", f"not all browsers play its pixel format, {held.pixels}"
    if held.declared not in (0, len(times)):
        return "", f"{len(times)} of the {held.declared} frames that it declares are decoded"
    if not abs(times[0]) <= EVEN_START or not np.all(np.diff(times) > 0):
        return "", "its frames do not begin at 0 s and follow one another in time"
    if size > MAX_BYTES:
        return "", f"it has {size / 1e6:.0f} MB"
    return mime, ""


def _transcoded(
    file: Path, size: tuple[int, int], count: int, covered: int
) -> tuple[bytes, np.ndarray[tuple[int], np.dtype[np.float64]], str]:
    """A file made WebM with VP8: its bytes, when each frame begins [s], how it was made.

    size: width, height [px]. Frames that nothing covers are left out where all would be too many.
    """
    width, height = size
    kept = count
    if 0 < covered < count and count * width * height > MOST_PIXELS:
        kept = covered
    scale = min(1.0, LONGEST_SIDE / max(size), np.sqrt(MOST_PIXELS / (kept * width * height)))
    scale = max(float(scale), min(1.0, SHORTEST_LONG_SIDE / max(size)))
    while True:
        # VP8 codes colours of squares of two pixels: even sides.
        small = tuple(max(2, 2 * round(side * scale / 2)) for side in size)
        data = _encoded(file, (small[0], small[1]), kept)
        if len(data) <= MAX_BYTES or scale <= SHORTEST_LONG_SIDE / max(size):
            break
        scale = max(0.9 * scale * (MAX_BYTES / len(data)) ** 0.5, SHORTEST_LONG_SIDE / max(size))
    parts = [f"Transcoded to VP8 in WebM at {small[0]} x {small[1]} px"]
    if kept < count:
        parts.append(f"frames 0 to {kept - 1} of {count}")
    return data, np.arange(kept) / RATE, ", ".join(parts)


def _encoded(file: Path, size: tuple[int, int], count: int) -> bytes:
    """The first frames of a video as WebM; size: width, height [px]."""
    with tempfile.TemporaryDirectory(prefix="atw-film-") as folder:
        # Matroska, of which WebM is a part: OpenCV writes VP8 in WebM too, but complains on stderr that it does.
        made = Path(folder) / "film.mkv"
        writer = cv2.VideoWriter(str(made), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"VP80"), RATE, size)
        if not writer.isOpened():
            raise VideoError("this installation of OpenCV encodes no VP8")
        try:
            for number, frame in enumerate(each_frame(file)):
                if number == count:
                    break
                writer.write(_resized(frame, size))
        finally:
            writer.release()
        data = made.read_bytes()
    if MATROSKA not in data[:64]:
        raise VideoError("OpenCV wrote another kind of file than Matroska")
    return _without_chance(data.replace(MATROSKA, WEBM, 1))


def _without_chance(data: bytes) -> bytes:
    """Replace the random numbers that the muxer gives a file and its track, so that equal frames give equal bytes.

    They are the elements SegmentUID, TrackUID and TagTrackUID of RFC 9559; the CRC-32 elements of what contains them
    become Void elements of the same size.
    """
    head, cluster, rest = data.partition(CLUSTER)
    digest = hashlib.sha256(rest).digest()
    for mark, size in ((b"\x73\xa4\x90", 16), (b"\x73\xc5\x88", 8), (b"\x63\xc5\x88", 8)):
        at = head.find(mark) + len(mark)
        if at >= len(mark):
            head = head[:at] + digest[:size] + head[at + size :]
    head = re.sub(rb"\xbf\x84.{4}", b"\xec\x84" + bytes(4), head, flags=re.DOTALL)
    return head + cluster + rest


def _resized(frame: Frames, size: tuple[int, int]) -> Frames:
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
