"""The reader of all tables: lines, cells and numbers, in the variants that spreadsheets and trackers write."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from polyworld.data.table_forms import Line, Table, has_number, plain_form

MISSING = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "—"})
SHOWN = 3  # lines of one kind of error that are listed
_LONGEST = 200  # characters of a cell or header that are printed
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?|[+-]?\d+,")
_COMMENT = re.compile(r"\s*([#%]+|;(?=[^;]*$))(.*)")  # a line of cells between semicolons may begin with an empty one


class Problems:
    """Errors of single lines, collected by kind: a message shows the first of each kind and counts the rest."""

    def __init__(self) -> None:
        self._found: dict[str, list[str]] = {}
        self._cures: dict[str, str] = {}

    def add(self, kind: str, line: int, text: str, cure: str = "") -> None:
        """Note an error of a line; `cure` says what to do about errors of that kind."""
        self._found.setdefault(kind, []).append(f"line {line}: {text}")
        self._cures.setdefault(kind, cure)

    def check(self) -> None:
        """Raise ValueError with a sentence for each kind of error that was noted."""
        if self._found:
            raise ValueError("\n".join(self._sentence(kind) for kind in self._found))

    def _sentence(self, kind: str) -> str:
        lines = self._found[kind]
        more = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
        return "; ".join([*lines[:SHOWN], *more, *filter(None, [self._cures[kind]])])


def read_table(text: str) -> Table:
    """Return header and rows of a table.

    Cells are separated by tabs, semicolons or commas, whichever the header has (in this order), or by blanks where it
    has none of them. Lines that begin with #, % or ; are comments, but the last of them is the header where only
    numbers follow, as NumPy writes it; where no header is found, columns are called 1, 2, ... `plain_form` rewrites
    what programs write above and beside a header. Raises ValueError for a text without rows, and for lines with more or
    fewer cells than the header; cells beyond the header's may be there if they are empty.
    """
    comment: tuple[int, str] | None = None
    lines: list[Line] = []
    separator: str | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        remark = _COMMENT.fullmatch(line)
        if remark is not None:
            if not lines:
                comment = (number, remark[2].strip())
        elif line.strip() and not re.fullmatch(r'"?sep=.?"?', line.strip()):  # a spreadsheet's note to itself
            separator = separator if lines else _separator(line)
            cells = _cells(number, line, separator)
            if any(cells):
                lines.append(Line(number, cells))
    if not lines:
        raise ValueError("no rows; expected a header line that names the columns, such as run, object, t, x, y, z")
    if all(has_number(c) for c in lines[0].cells):
        named = None if comment is None else Line(comment[0], _cells(*comment, _separator(comment[1])))
        if named is None or len(named.cells) != len(lines[0].cells):
            named = Line(lines[0].number, [str(i) for i in range(1, len(lines[0].cells) + 1)])
        lines.insert(0, named)
    table = plain_form(lines)
    _check_widths(table)
    if not table.rows:
        raise ValueError(f"line {table.header.number} is a header, but no rows of data follow it")
    return table


def _check_widths(table: Table) -> None:
    problems, width = Problems(), len(table.header.cells)
    for row in table.rows:
        if len(row.cells) < width or any(row.cells[width:]):
            text = f"{len(row.cells)} cells, expected {width} as in the header"
            problems.add("cells", row.number, text, _width_cure(row.cells))
    problems.check()


@dataclass
class Numbers:
    """Reads numbers of cells, with decimal points or decimal commas but not both in one table."""

    problems: Problems
    _comma: tuple[int, str, str] | None = field(default=None, init=False)
    _point: tuple[int, str, str] | None = field(default=None, init=False)

    def read(self, line: int, column: str, text: str, cure: str = "a cell that was not measured is empty") -> float:
        """Return the number in a cell, NaN where nothing was measured; an error is noted with its cure."""
        if text.lower() in MISSING:
            return float("nan")
        plain = text.replace("−", "-")
        if _DECIMAL_COMMA.fullmatch(plain):
            self._comma = self._comma or (line, column, text)
            plain = plain.replace(",", ".")
        elif "." in plain:
            self._point = self._point or (line, column, text)
        try:
            value = float(plain)
        except ValueError:
            if re.fullmatch(r"[+-]?\d{1,3}([,.' ]\d{3})+([,.]\d+)?", plain):
                cure = "write numbers without signs between thousands"
            self.problems.add(f"number: {cure}", line, f"{column} is not a number: {short(text)!r}", cure)
            return float("nan")
        if not np.isfinite(value):
            self.problems.add("finite", line, f"{column} is not finite: {short(text)!r}", "leave the cell empty")
            return float("nan")
        return value

    def check(self) -> None:
        """Raise ValueError where the table mixes decimal commas and points: one of them may mark thousands."""
        if self._comma is not None and self._point is not None:
            (line, column, comma), (other, _, point) = self._comma, self._point
            raise ValueError(
                f"line {line}: {column} is {comma!r} with a comma, but line {other} has {point!r} with a point; write "
                "all numbers with decimal points and without signs between thousands"
            )


def short(text: str) -> str:
    """Return the text, cut where it is too long to print."""
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "..."


def _separator(header: str) -> str | None:
    return next((mark for mark in "\t;," if mark in header), None)


def _cells(number: int, line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error as error:
        raise ValueError(f"line {number}: {error}; quote marks must come in pairs around a cell") from error


def _width_cure(cells: Sequence[str]) -> str:
    whole = sum(bool(re.fullmatch(r"[+-]?\d+", c)) for c in cells)
    if whole > len(cells) // 2 and len(cells) > 2:
        return "if these are decimal commas, separate the cells by semicolons or tabs"
    return "leave cells that were not measured empty, but keep their separators"
