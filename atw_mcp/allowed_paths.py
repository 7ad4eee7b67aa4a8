"""Folders and files that the server of a command may read: where its user works, and what its user names."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path

LONGEST = 4096  # characters of a path


def add_allow(parser: argparse.ArgumentParser) -> None:
    """Declare --allow."""
    parser.add_argument(
        "--allow",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="a further folder (or file) whose content the tools may read; repeatable; also ATW_MCP_ALLOW",
    )


def allowed_here(given: Iterable[Path], pairs: Mapping[str, str], *folders: Path) -> list[Path]:
    """Return what a command's own server may read.

    That is the working folder, `folders`, what --allow gives, and every path that is itself a value of the command
    line: naming it there is the user's wish. Paths in a script or typed at the prompt are not.
    """
    named = [path for value in pairs.values() if (path := _named(value)) is not None]
    return [Path.cwd(), *folders, *given, *named]


def _named(value: str) -> Path | None:
    if not value or len(value) > LONGEST:
        return None
    try:
        path = Path(value).expanduser()
        return path.absolute() if path.exists() or path.is_absolute() else None
    except (OSError, ValueError, RuntimeError):
        return None
