"""`atw-mcp report`: a case as one HTML file, to be looked at in any browser and mailed."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

OK, FAILED = 0, 1


def add_parser(commands: Any) -> None:
    """Declare the command."""
    report = commands.add_parser(
        "report",
        help="write a case as one HTML file: video, worlds, rollouts, fits, answers, and what they rest on",
    )
    report.add_argument("case", metavar="CASE")
    report.add_argument("--out", type=Path, required=True, metavar="FILE.html")
    report.add_argument(
        "--rollout", action="append", default=[], metavar="ID", help="show this rollout first; twice for two together"
    )
    report.add_argument(
        "--store", type=Path, metavar="FILE", help="evidence store (default: in the user's data folder)"
    )
    report.set_defaults(command=run)


def run(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from evidence_store import StoreError

    try:
        text, missing = _report(options)
    except (StoreError, FileNotFoundError) as error:
        return _failed(str(error))
    out = options.out.expanduser()
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        return _failed(f"{out} cannot be written ({error.strerror})")
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")
    for sentence in missing:
        print(f"not shown: {sentence}")
    return OK


def _report(options: argparse.Namespace) -> tuple[str, list[str]]:
    """Return the page, and sentences about what it does not show."""
    from atw_mcp.viewer.case_document import case_document
    from atw_mcp.viewer.film import with_film
    from atw_mcp.viewer.packing import packed
    from atw_mcp.viewer.page import page
    from evidence_store import EvidenceStore

    store = options.store
    if store is None:
        from atw_mcp.server import default_store  # imports every tool: only where its answer is wanted

        store = default_store()
    opened = EvidenceStore.to_read(store)
    try:
        document, blocks = case_document(opened, options.case, first=options.rollout)
        case = opened.cases.get(options.case)
        document = with_film(document, blocks, case, Path(case.path))
    finally:
        opened.close()
    return page(packed(document, blocks)), document.missing


def _failed(text: str) -> int:
    print(f"atw-mcp: {text}", file=sys.stderr)
    return FAILED
