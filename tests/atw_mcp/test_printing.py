"""The live line of progress: one line of a terminal, cut to its width, and nothing elsewhere."""

from __future__ import annotations

import io
import os

import pytest

from atw_mcp.printing import ProgressLine


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


def lines_of(text: str) -> list[str]:
    """What the only line of the terminal shows after each rewriting."""
    assert "\n" not in text
    return text.split("\r")[1:]


def test_progress_rewrites_one_line_within_the_width_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("shutil.get_terminal_size", lambda: os.terminal_size((30, 24)))
    line = ProgressLine()
    line.show(3, 10, "generation 3 of 10, error 3.1 mm, best 2.8 mm")
    line.show(4, 10, "done soon")
    line.clear()
    first, second, blank, _ = lines_of(terminal.getvalue())
    assert first == "   30 % generation 3 of 10, e"
    assert second == "   40 % done soon".ljust(len(first))
    assert not blank.strip()


def test_progress_writes_nothing_where_stderr_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    line = ProgressLine()
    line.show(1, 2, "half")
    line.clear()
    assert stream.getvalue() == ""
