"""Files made by other programs: tables by column names, JSON, and arrays, with what is wrong with one that is not."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.observation import ObservationError
from polyworld.data.table import Line, Numbers, Problems, file_text, in_file, read_table


class ImportDataError(ObservationError):
    """A file that does not hold what is asked of it; the message names what is missing or wrong."""


@dataclass
class MeasuredTable:
    """Rows of a table of measurements over frames or times, whose cells are read by the names of columns."""

    file: Path
    columns: dict[str, int]
    rows: tuple[Line, ...]
    _problems: Problems = field(default_factory=Problems, init=False)

    def __post_init__(self) -> None:
        self._numbers = Numbers(self._problems)

    @property
    def clock(self) -> str:
        """The column that orders the rows: frame, or t."""
        return "frame" if "frame" in self.columns else "t"

    def text(self, row: Line, column: str) -> str:
        """Return a cell, empty where there is no such column."""
        return row.cells[self.columns[column]] if column in self.columns else ""

    def number(self, row: Line, column: str) -> float:
        """Return the number in a cell, NaN where nothing was measured; `check` raises for what is no number."""
        return self._numbers.read(row.number, column, self.text(row, column))

    def check(self) -> None:
        """Raise ImportDataError naming the lines whose cells were not numbers."""
        try:
            self._problems.check()
            self._numbers.check()
        except ValueError as error:
            raise ImportDataError(in_file(self.file, error)) from error


def read_measured_table(file: Path, needed: tuple[str, ...]) -> MeasuredTable:
    """Return a table in any form that `read_table` reads, with the columns needed, and frame or t."""
    try:
        table = read_table(file_text(file))
    except ValueError as error:
        raise ImportDataError(in_file(file, error)) from error
    columns = {name: i for i, name in enumerate(table.header.cells)}
    missing = [c for c in needed if c not in columns]
    if "frame" not in columns and "t" not in columns:
        missing.insert(0, "frame or t")
    if missing:
        raise ImportDataError(f"{file.name}: columns missing: {missing}; it has {list(columns)}")
    return MeasuredTable(file, columns, table.rows)


def existing_table(path: str | Path) -> Path:
    """Return the path of a file that is there; raises ImportDataError naming what is near."""
    file = Path(path).expanduser()
    if not file.is_file():
        near = sorted(p.name for p in file.parent.iterdir())[:8] if file.parent.is_dir() else []
        raise ImportDataError(f"no file {file}; in its folder: {near or 'nothing'}")
    return file


def read_json(file: Path) -> Any:
    """Return the content of a JSON file; raises ImportDataError with the place of a syntax error."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ImportDataError(f"{file.name}: not JSON: {error}") from error


def read_arrays(file: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz file; raises ImportDataError where it is none, or holds pickled objects."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except (OSError, ValueError) as error:
        raise ImportDataError(f"{file.name}: not an npz archive of plain arrays: {error}") from error
