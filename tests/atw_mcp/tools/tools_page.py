"""The table of tools in `.docs/pages/tools.md`, between two marker comments; regenerated with the snapshots."""

from __future__ import annotations

from pathlib import Path

from atw_mcp.calls.toolsets import CORE
from atw_mcp.tools import manifest

PAGE = Path(__file__).parents[3] / ".docs" / "pages" / "tools.md"
BEGIN, END = "<!-- tools: generated from the manifest -->", "<!-- end of the tools -->"
STAGES = {
    "world construction": "World Modeling",
    "gap": "World Modeling, where a gap is left",
    "world inspection": "looking, at any time",
    "world experimentation": "World Probing",
    "execution control": "at any time",
}


def table() -> str:
    """One row a tool in Markdown, in the order of the method."""
    rows = ["| stage | tool | what it does | listed | leaves the case as it is |", "| --- | --- | --- | --- | --- |"]
    for entry in manifest.entries():
        unchanged = "yes" if entry["annotations"]["readOnlyHint"] else "no"
        listed = "always" if entry["name"] in CORE else "on request"
        rows.append(f"| {STAGES[entry['role']]} | `{entry['name']}` | {entry['title']} | {listed} | {unchanged} |")
    return "\n".join(rows)


def with_table(text: str) -> str:
    """The text with what stands between the markers replaced; raises ValueError where there are none."""
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page of the tools has no lines {BEGIN} and {END}")
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


def write() -> None:
    """Replace the table in the page."""
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
