"""The sources speak the field's language: words of an earlier private dialect do not come back."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = sorted(
    path
    for folder in ("atw_mcp", "polyworld", "evidence_store", "prompts")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".md", ".ts", ".tsx", ".mjs", ".css", ".html")
    and "node_modules" not in path.parts
    and path.name != "viewer.html"  # bundled
)
INSTEAD = {
    r"told|tells?|telling|untold": "reports, states, shows, distinguishes",
    r"foretells?|foretold": "predicts, predicted",
    r"lent|lends?|take_back": "predicted, remove the prediction",
    r"anew|begun": "again, restarted, initial fit",
    r"astray|in vain": "diverged, no minimum found",
    r"borne": "supported",
    r"mending|mended": "refitted, corrected, projected",
    r"hasty|touchy": "short-window, sensitive",
    r"twins|rivals?": "observationally equivalent, competitors",
    r"whereabouts": "poses",
    r"crowded": "contact buffer overflow",
    r"holdback": "held-out",
}


@cache
def text(path: Path) -> str:
    return path.read_text()


@pytest.mark.parametrize("words", INSTEAD)
def test_no_word_of_the_old_dialect_is_left(words: str) -> None:
    pattern = re.compile(rf"(?<![a-z])(?:{words})(?![a-z])", re.IGNORECASE)
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}"
        for path in [*SOURCES, ROOT / "README.md", *(ROOT / ".docs" / "pages").glob("*.md")]
        if pattern.search(text(path))
        for number, line in enumerate(text(path).splitlines(), start=1)
        if pattern.search(line)
    ]
    assert not found, f"write {INSTEAD[words]!r} instead:\n" + "\n".join(found)


def test_docstrings_open_with_what_is_done() -> None:
    opening = re.compile(r'^\s*"""What (?:is|are|a|an|the)\b', re.MULTILINE)
    found = [str(path.relative_to(ROOT)) for path in SOURCES if path.suffix == ".py" and opening.search(text(path))]
    assert not found
