"""`atw-mcp gap`: a world and a table of measured motion in, the missing effect and a better world out."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from atw_mcp.gap.options import add_recording_options, add_world_options

OK, FAILED, USAGE = 0, 1, 2

DESCRIPTION = """\
Find what a world lacks to explain measured motion. The table is a CSV with columns run, object, t [s], x, y, z [m] and
optionally qw, qx, qy, qz, spins wx, wy, wz [rad/s], or theta [rad] of a body on a hinge; headers may state other units,
as in x [mm]; cells that were not measured are empty. The world is WORLD.json (`atw-mcp schema world` prints its form),
or bodies given by --object. The verdict is one of identified, identified_with_remainder, ambiguous, unexplained,
nothing_missing.
"""


def add_parser(commands: Any) -> None:
    """Declare the command."""
    gap = commands.add_parser(
        "gap",
        help="find the effect that a world lacks to explain measured motion",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_world_options(gap)
    gap.add_argument("--data", type=Path, required=True, metavar="DATA.csv")
    gap.add_argument("--sealed", type=Path, metavar="FILE.csv", help="runs to judge the result by, seen by no step")
    gap.add_argument(
        "--seal", metavar="RUN,RUN", help="hold out these runs of --data (default: the last quarter); 'none' for none"
    )
    gap.add_argument(
        "--fit", action="append", default=[], metavar="PATH", help="a parameter of the world that is not known exactly"
    )
    gap.add_argument(
        "--effects", metavar="NAME,NAME", help="consider these effects only (default: the whole catalogue)"
    )
    gap.add_argument("--max-effects", type=int, default=3, choices=(1, 2, 3), help="default: %(default)s")
    gap.add_argument("--seed", type=int, default=0, help="of the bootstrap over runs (default: %(default)s)")
    gap.add_argument(
        "--time-limit", type=float, metavar="SECONDS", help="end the search by then with the best verdict so far"
    )
    gap.add_argument("--out", type=Path, metavar="FILE", help="write the better world here")
    gap.add_argument("--pictures", type=Path, metavar="FOLDER", help="write pictures here")
    gap.add_argument("--json", action="store_true", help="print the whole result as JSON")
    add_recording_options(gap)
    gap.set_defaults(command=run)


def run(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from pydantic import ValidationError

    from atw_mcp.calls.results import validation_text

    try:
        return _run(options)
    except ValidationError as error:
        advice = "`atw-mcp schema world` prints every field"
        print(f"{options.world}: {validation_text(error)}; {advice}", file=sys.stderr)
    except (OSError, ValueError, KeyError) as error:
        print(error.args[0] if isinstance(error, KeyError) else error, file=sys.stderr)
    return FAILED


def _run(options: argparse.Namespace) -> int:
    from atw_mcp.gap.unknowns import unknowns_at
    from atw_mcp.gap.words import sealed_text, verdict_text
    from atw_mcp.gap.work import pictures_of, result_of
    from atw_mcp.gap.world_from_options import world_of
    from atw_mcp.observation.recording_options import read_with_remarks, recording_form
    from polyworld.gap import GapSettings, find_gap
    from polyworld.gap.catalogue import named
    from polyworld.gap.sealed import Split, hold_out
    from polyworld.screening import screen

    wanted = named(options.effects.split(",")) if options.effects else None
    world, form = world_of(options), recording_form(options)
    recording = read_with_remarks(options.data, form, world)
    if options.sealed is not None:
        parts = Split(recording, read_with_remarks(options.sealed, form, world), f"sealed {options.sealed}")
    else:
        chosen = None if options.seal is None else [] if options.seal == "none" else options.seal.split(",")
        parts = hold_out(recording, chosen)
    screening = screen(world, parts.fitted)
    if screening.refused and not options.units:
        raise ValueError(" ".join(f.message for f in screening.findings if f.severity == "refuse"))
    report = find_gap(
        world,
        parts.fitted,
        held_out=parts.held_out,
        held_out_world=parts.held_out_world,
        base=unknowns_at(world, options.fit),
        candidates=wanted,
        settings=GapSettings(depth=options.max_effects, time_limit=options.time_limit, seed=options.seed),
        progress=lambda share, step: print(f"  {100 * share:3.0f} % {step}", file=sys.stderr),
    )
    result = result_of(report, world) | {"sealed_data": parts.summary}
    if options.out is not None and report.names:
        options.out.write_text(json.dumps(result["world"], indent=2) + "\n")
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for name, content in pictures_of(report).items():
            (options.pictures / name).write_bytes(content)
    print(json.dumps(result, indent=2) if options.json else f"{verdict_text(result)}\n{sealed_text(result)}")
    return OK
