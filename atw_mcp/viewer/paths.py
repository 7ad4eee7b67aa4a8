"""Texts without the folders of the machine that they were written on: documents are mailed."""

from __future__ import annotations

import re
from collections.abc import Collection

ABSOLUTE = re.compile(r"(?<![\w.:/])(?:[A-Za-z]:\\|/)(?:[^\s\\/:;,'\"()]+[\\/])+(?=[^\s\\/])")
"""The folders of an absolute path, of POSIX or Windows, without spaces; a unit such as m/s is none."""


def without_folders(text: str, known: Collection[str] = ()) -> str:
    """Return a text in which paths are names of files. known: paths that it may hold, with spaces or not."""
    for path in sorted(known, key=len, reverse=True):
        name = re.split(r"[\\/]", path)[-1]
        if name and name != path:
            text = text.replace(path, name)
    return ABSOLUTE.sub("", text)
