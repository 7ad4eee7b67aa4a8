"""Commands that turn files of other simulators into worlds and worlds into MJCF: import-world, export-world."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

OK, FAILED = 0, 1


def add_parser(commands: Any) -> None:
    """Declare the commands."""
    read = commands.add_parser(
        "import-world",
        help="print an MJCF, URDF or USD file as a world",
        description="Print the world of an MJCF, URDF or USD file as JSON; what it does not hold is listed on stderr. "
        "Needs pip install 'atw-mcp[importers]'.",
    )
    read.add_argument("file", type=Path, metavar="FILE")
    read.add_argument("--keyframe", metavar="NAME", help="keyframe of an MJCF file to start from (name or number)")
    read.add_argument("--floating", action="store_true", help="free the root link of a URDF file from the world")
    read.set_defaults(command=_import)

    write = commands.add_parser(
        "export-world",
        help="print a world as MJCF",
        description="Print a world of spatial rigid bodies, as JSON, as MJCF; what MJCF does not hold is listed on "
        "stderr.",
    )
    write.add_argument("file", type=Path, metavar="WORLD.json")
    write.set_defaults(command=_export)


def _import(options: argparse.Namespace) -> int:
    from polyworld.exchange import import_confined

    keyframe = options.keyframe
    try:
        number = int(keyframe) if (keyframe or "").isdigit() else keyframe
        found = import_confined(options.file, keyframe=number, floating=options.floating)
    except (ImportError, OSError, ValueError) as error:
        return _failed(error)
    print(found.world.canonical_json())
    _list(found.left_out)
    return OK


def _export(options: argparse.Namespace) -> int:
    from polyworld.exchange import export_mjcf
    from polyworld.world import World

    try:
        found = export_mjcf(World.model_validate_json(options.file.read_bytes()))
    except (OSError, ValueError) as error:
        return _failed(error)
    print(found.xml, end="")
    _list(found.left_out)
    return OK


def _list(left_out: Iterable[str]) -> None:
    for sentence in left_out:
        print(f"- {sentence}", file=sys.stderr)


def _failed(error: Exception) -> int:
    print(f"atw-mcp: {error}", file=sys.stderr)
    return FAILED
