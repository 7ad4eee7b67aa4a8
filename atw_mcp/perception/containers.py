"""Recognise video containers by their first bytes.

FFmpeg chooses a reader by content and by name, and some of its readers open further files or addresses: playlists
(HLS, DASH, concat), session descriptions, numbered images. A file is decoded only if it begins as a container that
holds its own pictures.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NAMES = "MP4 or MOV, Matroska or WebM, AVI, MPEG, FLV, Ogg, ASF, GIF, MJPEG, Y4M or IVF"
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
    b"\xff\xd8\xff",  # MJPEG
    b"YUV4MPEG2",
    b"DKIF",  # IVF
)
_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot")  # of MP4 and MOV, after a length


def is_container(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a video container that is read here."""
    if head.startswith(_STARTS) or head[4:8] in _BOXES:
        return True
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return True
    return len(head) >= _HEAD and all(head[i] == 0x47 for i in range(0, _HEAD, 188))  # MPEG transport stream


@contextmanager
def decodable(file: Path) -> Iterator[str | None]:
    """Yield the name under which a decoder may open a file, None where it is no regular file with a video container.

    Where the system shows open files as files, the name is that of the file examined, whatever its path becomes.
    """
    descriptor = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode) or not is_container(os.read(descriptor, _HEAD)):
            yield None
            return
        shown = f"/proc/self/fd/{descriptor}"
        yield shown if os.path.exists(shown) else str(file)
    finally:
        os.close(descriptor)
