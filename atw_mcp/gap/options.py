"""Options of `atw-mcp gap` for the world and the table. Imports nothing of the engine, so that --help is quick."""

from __future__ import annotations

import argparse
from pathlib import Path

FORM = "NAME:SHAPE:SIZE:MASS"
EXAMPLES = {
    "sphere": "ball:sphere:r=20mm:2.7g",
    "box": "die:box:40x40x20mm:50g",
    "cylinder": "can:cylinder:r=3cm,h=11cm:350g",
    "disc": "puck:disc:d=76mm,h=25mm:170g",
}


def add_world_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that describe the world: a JSON file, or objects."""
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--world", type=Path, metavar="WORLD.json")
    which.add_argument(
        "--object",
        action="append",
        dest="objects",
        metavar=FORM,
        help="instead of --world: a rigid body, such as " + ", ".join(EXAMPLES.values()) + "; may be repeated. Sizes "
        "are a radius (or d= a diameter), the three edges of a box, r= or d= and the height h=",
    )
    group = parser.add_argument_group("world of --object")
    group.add_argument(
        "--floor",
        nargs="?",
        const="0",
        metavar="Z",
        help="a horizontal ground at this height (default: 0), such as =-2cm",
    )
    group.add_argument(
        "--on-plane",
        action="store_true",
        default=None,
        help="the bodies slide and turn on a level table, seen from above",
    )
    group.add_argument("--restitution", type=float, metavar="E", help="of every body, 0 to 1 (default: 0.5)")
    group.add_argument("--friction", type=float, metavar="MU", help="Coulomb coefficient of every body (default: 0.5)")
    group.add_argument("--gravity", type=float, metavar="G", help="downwards [m/s^2] (default: 9.81)")


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    group = parser.add_argument_group("reading the table")
    group.add_argument(
        "--units", default="", metavar="UNITS", help="of columns that state none, as mm,ms or x=mm,t=ms,theta=deg"
    )
    group.add_argument(
        "--columns",
        default="{}",
        metavar="DICT",
        help="what headers mean, with units, as \"{'Y': 'z [mm]', '2': 'x [0.002 m]'}\"; 1, 2, ... without a header",
    )
    clock = group.add_mutually_exclusive_group()
    clock.add_argument("--fps", type=float, metavar="F", help="frames per second of a column frame, in physical time")
    clock.add_argument("--seconds-per-frame", type=float, metavar="S", help="the same as seconds")
    group.add_argument(
        "--pixels-per-metre", "--pixels-per-meter", type=float, metavar="P", help="scale of columns u, v in pixels"
    )
    group.add_argument("--origin-pixel", metavar="U,V", help="pixel of the world's origin (default: 0,0)")
    group.add_argument("--image-axes", action="store_true", default=None, help="v counts downwards, as in image files")
    group.add_argument(
        "--view",
        choices=("side", "top"),
        help="what u, v are: x and z of a side view (the default), x and y from above",
    )
    angle = group.add_mutually_exclusive_group()
    angle.add_argument(
        "--theta-described", metavar="ANGLE", help="reading of theta in the pose that the world describes (default: 0)"
    )
    angle.add_argument(
        "--theta-hanging", nargs="?", const="0", metavar="ANGLE", help="instead: its reading where the body hangs"
    )
