"""Cases to look at: `atw-mcp report` writes one as an HTML file, `atw-mcp view` follows it in a browser."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from atw_mcp.store_option import add_store, chosen_store

OK, FAILED = 0, 1


def add_parser(commands: Any) -> None:
    """Declare the commands."""
    report = commands.add_parser(
        "report",
        help="write a case as one HTML file: video, worlds, rollouts, fits, answers, and what they rest on",
    )
    report.add_argument("case", metavar="CASE")
    report.add_argument("--out", type=Path, required=True, metavar="FILE.html")
    report.add_argument(
        "--rollout", action="append", default=[], metavar="ID", help="show this rollout first; twice for two together"
    )
    add_store(report)
    report.set_defaults(command=run)

    view = commands.add_parser(
        "view",
        help="look at a case in a browser and follow it while it is worked on",
        description="Serve a page on this machine that shows a case, or lists all, and follows what is added to it. It "
        "only reads the store. Whoever has the address that is printed can read it too.",
    )
    view.add_argument("case", nargs="?", metavar="CASE", help="default: a list of all cases")
    view.add_argument("--port", type=int, default=0, help="port on 127.0.0.1 (default: any that is free)")
    view.add_argument("--no-browser", action="store_true", help="only print the address")
    add_store(view)
    view.set_defaults(command=run_view)


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


def run_view(options: argparse.Namespace) -> int:
    """Follow a case until a signal ends the process; returns the exit code."""
    from atw_mcp.view_serving import view
    from evidence_store import StoreError

    try:
        code = view(chosen_store(options), options.case, options.port, browser=not options.no_browser)
    except (StoreError, FileNotFoundError) as error:
        return _failed(str(error))
    except OverflowError:
        return _failed(f"{options.port} is no port: 0 to 65535")
    except OSError as error:
        return _failed(f"cannot listen on 127.0.0.1, port {options.port} ({error.strerror or error})")
    if code:  # a signal: all is closed, and the interpreter's own end takes seconds with the engine loaded
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _report(options: argparse.Namespace) -> tuple[str, list[str]]:
    """Return the page, and sentences about what it does not show."""
    from atw_mcp.viewer.case_document import case_document
    from atw_mcp.viewer.film import with_film
    from atw_mcp.viewer.packing import packed
    from atw_mcp.viewer.page import page
    from evidence_store import EvidenceStore

    opened = EvidenceStore.to_read(chosen_store(options))
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
