"""Tables as Markdown that is also readable as plain text."""

from __future__ import annotations

from collections.abc import Sequence

from tests.benchmarks.peers.table import Table


def markdown(table: Table) -> str:
    """Return a table with its title and note; columns are padded to equal width."""
    lines = [table.columns, *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.columns))]
    text = [_line(line, widths) for line in lines]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    note = [table.note, ""] if table.note else []
    return "\n".join([f"### {table.title}", "", *note, text[0], rule, *text[1:]])


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    padded = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
    return "| " + " | ".join(padded) + " |"
