"""Worlds in files: a world's own JSON, and the formats of other simulators."""

from __future__ import annotations

from pathlib import Path

from atw_mcp.calls.files import AllowedFiles
from polyworld.world import World


def world_of_file(files: AllowedFiles, path: str) -> tuple[World, tuple[str, ...]]:
    """Read a world from a file that calls may read, with what of the file it does not hold.

    Files that it names (meshes) must be allowed as well. Raises ValueError, FileRefused among them.
    """
    found = files.file(path)
    if found.suffix.lower() == ".json":
        return World.model_validate_json(_content(files, found)), ()
    from polyworld.exchange import import_confined

    try:
        read = import_confined(found, read=lambda other: _content(files, other))
    except ImportError as error:
        raise ValueError(str(error)) from error
    return read.world, read.left_out


def _content(files: AllowedFiles, path: Path) -> bytes:
    with files.opened(str(path), "text_bytes") as view:
        return view.read_bytes()
