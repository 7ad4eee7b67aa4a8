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
        print(_report(options))
    except (StoreError, FileNotFoundError) as error:
        return _failed(str(error))
    except OSError as error:
        return _failed(f"{options.out} cannot be written ({error.strerror})")
    return OK


def _report(options: argparse.Namespace) -> str:
    """Write the file; returns what to print about it."""
    from atw_mcp.viewer.case_document import case_document
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
    finally:
        opened.close()
    text = page(packed(document, blocks))
    out = options.out.expanduser()
    out.write_text(text, encoding="utf-8")
    lines = [f"{out}: {len(text.encode()) / 1e6:.2f} MB", *(f"not shown: {sentence}" for sentence in document.missing)]
    return "\n".join(lines)


def _failed(text: str) -> int:
    print(f"atw-mcp: {text}", file=sys.stderr)
    return FAILED
