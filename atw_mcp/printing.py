"""Output of the command line: replies as JSON, tools as lines, progress on stderr."""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
from pathlib import Path

from atw_mcp.replies import Reply, save_pictures


def tool_line(name: str, description: str | None) -> str:
    """Format a tool as one line: its name and the start of its description."""
    return f"{name:24}{textwrap.shorten(description or '', 120, placeholder=' ...')}"


def print_reply(reply: Reply, *, indent: bool, pictures: Path) -> None:
    """Print a reply as JSON, on one line unless `indent`; write its pictures to the folder `pictures`."""
    body = dict(reply.body)
    paths = save_pictures(reply, pictures)
    if paths:
        body["pictures"] = [str(path) for path in paths]
    if indent:
        print(json.dumps(body, indent=2, ensure_ascii=False))
    else:
        print(json.dumps(body, separators=(",", ":"), ensure_ascii=False), flush=True)


class ProgressLine:
    """Progress on stderr: one line that is rewritten in place; nothing where stderr is no terminal."""

    def __init__(self) -> None:
        self._width = 0

    def show(self, done: float, total: float | None, message: str) -> None:
        """Show how far the work is, as far as it fits the width of the terminal."""
        if not sys.stderr.isatty():
            return
        share = f"{100 * done / total:3.0f} % " if total else ""
        width = shutil.get_terminal_size().columns - 1  # a character in the last column would begin a new line
        line = f"  {share}{message}".rstrip()[:width]
        sys.stderr.write("\r" + line.ljust(min(self._width, width)))
        sys.stderr.flush()
        self._width = len(line)

    def clear(self) -> None:
        """Remove the line."""
        if self._width:
            sys.stderr.write("\r" + " " * self._width + "\r")
            sys.stderr.flush()
            self._width = 0
