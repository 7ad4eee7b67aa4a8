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
    gap.add_argument("--seed", type=int, default=0, help="of the null control (default: %(default)s)")
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
    from atw_mcp.gap import work as gap_work
    from atw_mcp.gap.unknowns import unknowns_at
    from atw_mcp.gap.words import verdict_text
    from atw_mcp.gap.world_from_options import world_of
    from atw_mcp.observation.recording_options import read_with_remarks, recording_form
    from polyworld.gap import GapSettings, find_gap
    from polyworld.gap.catalogue import named
    from polyworld.gap.held_out import Split, hold_out
    from polyworld.gap.settings import SearchSettings

    wanted = named(options.effects.split(",")) if options.effects else None
    world, form = world_of(options), recording_form(options)
    recording = read_with_remarks(options.data, form, world)
    if options.sealed is not None:
        parts = Split(recording, read_with_remarks(options.sealed, form, world), f"sealed {options.sealed}")
    else:
        chosen = None if options.seal is None else [] if options.seal == "none" else options.seal.split(",")
        parts = hold_out(recording, chosen)
    report = find_gap(
        world,
        parts.fitted,
        held_out=parts.held_out,
        held_out_world=parts.held_out_world,
        base=unknowns_at(world, options.fit),
        candidates=wanted,
        settings=GapSettings(
            search=SearchSettings(max_effects=options.max_effects),
            time_limit=options.time_limit,
            refuse=not options.units,
            seed=options.seed,
        ),
        progress=_Steps(),
    )
    summary = report.to_dict()
    summary["sealed_data"] = parts.summary
    if options.out is not None and summary["world"] is not None:
        options.out.write_text(json.dumps(summary["world"], indent=2) + "\n")
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for name, content in gap_work.pictures_of(report).items():
            (options.pictures / name).write_bytes(content)
    if options.json:
        print(json.dumps(summary, indent=2))
        return OK
    print(verdict_text(summary))
    print(_sealed(summary))
    if summary["null_control"] is not None:
        print(_null_control(summary))
    return OK


class _Steps:
    """Writes each step of the search to the terminal, once however often it is repeated."""

    def __init__(self) -> None:
        self._last = ""

    def __call__(self, share: float, step: str) -> None:
        if step != self._last:
            print(f"  {100 * share:3.0f} % {step}", file=sys.stderr)
        self._last = step


def _sealed(summary: dict[str, Any]) -> str:
    if summary["sealed"] is None:
        return summary["sealed_data"] if summary["verdict"] != "nothing_missing" else "no effect added"
    gap = summary["sealed"]
    closed = "" if gap["closed"] is None else f", {100 * gap['closed']:.0f}% closed"
    return (
        f"{summary['sealed_data']}: gap {gap['gap_before']:.4g} {gap['unit']} before, {gap['gap_after']:.4g} after"
        f"{closed}; noise {gap['noise_floor']:.4g} {gap['unit']}"
    )


def _null_control(summary: dict[str, Any]) -> str:
    null = summary["null_control"]
    text = f"null control: {null['verdict']} in data made from the base world, with its noise"
    if null["chi2_after"] is None:
        return text
    gained = null["chi2_before"] - null["chi2_after"]
    return f"{text}; the effect named takes {gained:.3g} off a chi2 of {null['chi2_before']:.4g} there"
