"""Commands that look after the evidence store: doctor, prune, backup, export, import."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from atw_mcp.store_option import add_store, chosen_store

OK, FAILED, USAGE = 0, 1, 2


def add_parser(commands: Any) -> None:
    """Declare the commands."""
    doctor = commands.add_parser("doctor", help="examine the evidence store and what the server needs")
    doctor.add_argument(
        "--repair",
        action="store_true",
        help="mark work of ended processes failed and rebuild indices; where records are damaged, write all others to "
        "a new store beside the damaged one, which is kept",
    )
    _declare(doctor, _doctor)

    prune = commands.add_parser(
        "prune",
        help="remove cached observations, rollouts and fits that no case and no evidence refers to",
        description="Remove cached observations, rollouts and fits that no case and no evidence refers to, and give "
        "their space back to the disk. No server may use the store meanwhile.",
    )
    prune.add_argument(
        "--case", action="append", default=[], metavar="ID", help="remove this case too, with all its evidence"
    )
    prune.add_argument("--dry-run", action="store_true", help="only say what would be removed")
    _declare(prune, _prune)

    backup = commands.add_parser("backup", help="copy the evidence store, also while servers use it")
    backup.add_argument("file", type=Path, metavar="FILE", help="where to write the copy; must not exist")
    _declare(backup, _backup)

    export = commands.add_parser(
        "export", help="write a case with all it rests on to a file, or its provenance, motion, film or world"
    )
    export.add_argument("case", metavar="CASE")
    export.add_argument("--out", type=Path, metavar="FILE.zip", help="write the whole case here, for `atw-mcp import`")
    export.add_argument("--prov", type=Path, metavar="FILE.json", help="write its provenance here, as W3C PROV-JSON")
    export.add_argument(
        "--motion",
        type=Path,
        metavar="FILE",
        help="write measured and simulated places with 80%% intervals here: .csv a table, .svg, .png or .pdf a figure",
    )
    export.add_argument(
        "--film", type=Path, metavar="FILE", help="write the world over the video here: .mp4, .webm or .webp"
    )
    export.add_argument("--world", type=Path, metavar="FILE", help="write the world here: .json, or .xml as MJCF")
    export.add_argument("--until", type=float, metavar="SECONDS", help="run the world to here; default the last frame")
    _declare(export, _export)

    imported = commands.add_parser(
        "import",
        help="store a case that `export` wrote",
        description="Store a case that `atw-mcp export` wrote. Its evidence keeps its ids where they are free; else "
        "all of it is renumbered, with every reference to it, and each record keeps its old id.",
    )
    imported.add_argument("file", type=Path, metavar="FILE.zip")
    _declare(imported, _import)


def _declare(parser: argparse.ArgumentParser, command: Callable[[argparse.Namespace, Path], int]) -> None:
    add_store(parser)

    def run(options: argparse.Namespace) -> int:
        from evidence_store import StoreError

        try:
            return command(options, chosen_store(options))
        except StoreError as error:
            print(f"atw-mcp: {error}", file=sys.stderr)
            return FAILED

    parser.set_defaults(command=run)


def _doctor(options: argparse.Namespace, store: Path) -> int:
    from atw_mcp.environment import environment
    from evidence_store.checking import check

    repaired = _repair(store) if options.repair and store.exists() else True
    findings = [*check(store), *environment(store)]
    for finding in findings:
        print(f"{'ok   ' if finding.good else 'WRONG'}  {finding.subject}: {finding.text}")
    return OK if repaired and all(finding.good for finding in findings) else FAILED


def _repair(store: Path) -> bool:
    """Repair in place what can be, else recover into a new file; returns whether the store itself is whole now."""
    from evidence_store import NotAStore, StoreDamaged
    from evidence_store.checking import check, mend
    from evidence_store.recovery import recover

    try:
        for line in mend(store):
            print(f"repaired: {line}")
    except NotAStore:
        raise
    except StoreDamaged:
        pass
    if all(finding.good for finding in check(store)):
        return True
    recovery = recover(store, _unused(store))
    print(f"recovered: {recovery.kept} records, to {recovery.path}; {store} is left as it is")
    for line in recovery.lost:
        print(f"lost: {line}")
    for line in recovery.changed:
        print(f"changed: {line}")
    print(f"Next: use --store {recovery.path}, or end the servers and move it to {store}")
    return False


def _unused(store: Path) -> Path:
    number = 1
    while (path := store.with_name(f"{store.stem}.recovered-{number}{store.suffix}")).exists():
        number += 1
    return path


def _prune(options: argparse.Namespace, store: Path) -> int:
    from evidence_store.upkeep import prune

    pruned = prune(store, cases=options.case, dry_run=options.dry_run)
    said = ", ".join(f"{count} {table.replace('_', ' ')}" for table, count in pruned.removed.items() if count)
    print(f"{'would remove' if options.dry_run else 'removed'} {said or 'nothing'}")
    if pruned.after is not None:
        print(f"{store}: {pruned.before / 1e6:.2f} MB before, {pruned.after / 1e6:.2f} MB now")
    return OK


def _backup(options: argparse.Namespace, store: Path) -> int:
    from evidence_store.upkeep import backup

    target = options.file.expanduser().absolute()
    size = backup(store, target)
    print(f"{target}: {size / 1e6:.2f} MB")
    return OK


def _export(options: argparse.Namespace, store: Path) -> int:
    from evidence_store import EvidenceStore, StoreError
    from evidence_store.export import export_case
    from evidence_store.provenance import prov_json

    of_world = (options.motion, options.film, options.world)
    if (options.out, options.prov, *of_world) == (None,) * 5:
        print("atw-mcp: export needs --out, --prov, --motion, --film or --world, each with a FILE", file=sys.stderr)
        return USAGE
    if not store.exists():
        raise StoreError(f"there is no evidence store at {store}: check the path, which --store FILE gives")
    opened = EvidenceStore(store)
    try:
        if options.out is not None:
            counts = export_case(opened, options.case, options.out.expanduser().absolute())
            print(f"{options.out}: {_counted(counts)}")
        if options.prov is not None:
            options.prov.write_text(prov_json(opened, options.case), encoding="utf-8")
            print(f"{options.prov}: provenance of {options.case}")
    except OSError as error:
        print(f"atw-mcp: {options.prov} cannot be written ({error.strerror})", file=sys.stderr)
        return FAILED
    finally:
        opened.close()
    return OK if of_world == (None,) * 3 else _export_of_world(options, store)


def _export_of_world(options: argparse.Namespace, store: Path) -> int:
    from mcp.server.mcpserver.exceptions import ToolError

    from atw_mcp.calls.app import App
    from atw_mcp.world_export import export_film, export_motion, export_world

    app, case, until = App(store), options.case, options.until
    try:
        if options.motion is not None:
            rows, missing = export_motion(app, case, options.motion.expanduser(), until)
            print(f"{options.motion}: {rows} {'rows' if options.motion.suffix == '.csv' else 'instants'}")
            if missing:
                print(f"without 80% intervals: {missing}")
        if options.film is not None:
            print(f"{options.film}: {export_film(app, case, options.film.expanduser(), until)} frames")
        if options.world is not None:
            left_out = export_world(app, case, options.world.expanduser())
            print("\n- ".join([f"{options.world}: the world", *left_out]))
    except (OSError, ToolError, ValueError) as error:
        print(f"atw-mcp: {error}", file=sys.stderr)
        return FAILED
    finally:
        app.close()
    return OK


def _import(options: argparse.Namespace, store: Path) -> int:
    from evidence_store import EvidenceStore
    from evidence_store.export import import_case

    opened = EvidenceStore(store)
    try:
        ids, counts = import_case(opened, options.file.expanduser())
    finally:
        opened.close()
    print(f"{store}: case {ids.case} with {_counted(counts)}")
    if ids.shift:
        print(f"renumbered: case {ids.exported} is {ids.case}, its ev-N is ev-(N + {ids.shift})")
    return OK


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {table.replace('_', ' ')}" for table, count in counts.items() if count)
