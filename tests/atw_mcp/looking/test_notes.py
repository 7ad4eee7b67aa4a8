"""Lists beside pictures: broken between words, within their room, and honest about what had none."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.looking import notes
from atw_mcp.looking.overlay import OBSERVED, Canvas


def test_long_lines_are_broken_between_words() -> None:
    text = "   gone: a_rather_long_name and another_rather_long_name collide at 0.881 s"
    lines = notes.wrapped(text, 250)
    assert len(lines) > 1
    assert " ".join(" ".join(lines).split()) == " ".join(text.split())
    assert all(line.startswith("   ") for line in lines)


@pytest.mark.parametrize(("items", "last"), [(4, "item 4"), (5, "and 2 more")])
def test_lists_stay_within_their_room(items: int, last: str, monkeypatch: pytest.MonkeyPatch) -> None:
    canvas = Canvas(np.zeros((200, 200, 3), np.uint8), 1.0)
    written: list[tuple[str, float]] = []
    monkeypatch.setattr(Canvas, "write", lambda _, text, at, __: written.append((text.strip(), at[1])))
    room = 5 * notes.PITCH
    notes.write_list(canvas, "title", [f"item {k}" for k in range(1, items + 1)], OBSERVED, (0, 10), (150, room))
    assert written[0][0] == "title"
    assert written[-1][0] == last
    assert len(written) == 5
    assert written[-1][1] <= 10 + room
