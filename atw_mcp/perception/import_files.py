"""Files made by other programs: tables by column names, JSON, and arrays, with what is wrong with one that is not."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.observation import ObservationError
from polyworld.data.recording_columns import Column, Units, name_columns, renamed
from polyworld.data.recording_header import without_units_row
from polyworld.data.table import Numbers, Problems, read_table
from polyworld.data.table_files import file_text, in_file
from polyworld.data.table_forms import Line
from polyworld.data.tracks import frame_grid

Floats = NDArray[np.float64]
Frames = NDArray[np.int64]

LARGEST_ARRAYS = 1_500_000_000  # bytes of all arrays of a file: as much as a video may have decoded


class ImportDataError(ObservationError):
    """A file that does not hold what is asked of it; the message names what is missing or wrong."""


@dataclass
class MeasuredTable:
    """Rows of a table of measurements over frames or times, whose cells are read by the quantities of columns."""

    file: Path
    columns: dict[str, Column]
    rows: tuple[Line, ...]
    _problems: Problems = field(default_factory=Problems, init=False)

    def __post_init__(self) -> None:
        self._numbers = Numbers(self._problems)

    def text(self, row: Line, column: str) -> str:
        """Return a cell, empty where there is no such column."""
        return row.cells[self.columns[column].index] if column in self.columns else ""

    def number(self, row: Line, column: str) -> float:
        """Return the number in a cell, in SI, NaN where nothing was measured; `check` raises for what is no number."""
        factor = self.columns[column].factor if column in self.columns else 1.0
        return factor * self._numbers.read(row.number, column, self.text(row, column))

    def check(self) -> None:
        """Raise ImportDataError naming the lines whose cells were not numbers."""
        try:
            self._problems.check()
            self._numbers.check()
        except ValueError as error:
            raise ImportDataError(in_file(self.file, error)) from error

    def clock(self, seconds_per_frame: float | None) -> str:
        """Return the column that orders the rows: frame where it is there and its time is known, else t."""
        return "frame" if "frame" in self.columns and (seconds_per_frame or "t" not in self.columns) else "t"

    def grid(self, times: set[float], seconds_per_frame: float | None) -> tuple[Frames, float, Floats, Floats]:
        """Return the moments at which something was measured, as the clock's column has them: their frame numbers,
        seconds per frame, the clock in frames, and the moments."""
        moments = np.array(sorted(times))
        if self.clock(seconds_per_frame) == "t":
            return (*frame_grid(moments, seconds_per_frame), moments)
        if seconds_per_frame is None:
            raise ImportDataError(f"{self.file.name}: frames but no times: give seconds_per_frame (or a column t)")
        if np.any(moments != np.round(moments)):
            raise ImportDataError(f"{self.file.name}: frame must be whole numbers, got {moments[:3].tolist()}")
        return moments.astype(np.int64), seconds_per_frame, moments, moments


def read_measured_table(
    path: str | Path, needed: tuple[str, ...], more: tuple[str, ...], meanings: Mapping[str, str]
) -> MeasuredTable:
    """Return a table in any form that `read_table` reads, with the columns needed, perhaps more, and t or frame.

    meanings: other headers, by those in the file.
    """
    file = existing_table(path)
    try:
        table = without_units_row(read_table(file_text(file)))
        line, header = table.header.number, table.header.cells
        known = {*needed, *more, "t", "frame"}
        columns, _ = name_columns(line, renamed(line, header, meanings), Units(), known)
        missing = [c for c in needed if c not in columns]
        if not {"t", "frame"} & columns.keys():
            missing.insert(0, "t or frame")
        if missing:
            there = ", ".join(columns) or "none"
            raise ValueError(f"line {line}: columns missing: {', '.join(missing)}; known columns there: {there}")
    except ValueError as error:
        raise ImportDataError(in_file(file, error)) from error
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
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise ImportDataError(f"{file.name}: not JSON ({where})") from error
    except UnicodeDecodeError as error:
        raise ImportDataError(f"{file.name}: not JSON in UTF-8 (byte {error.start})") from error
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits, lists in lists in lists
        raise ImportDataError(f"{file.name}: JSON with numbers that are too long, or nested too deeply") from error


def read_arrays(file: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz file; raises ImportDataError where it is none, or holds pickled objects.

    Sizes are added up before anything is unpacked: a small archive may hold far more than memory.
    """
    try:
        with zipfile.ZipFile(file) as packed:
            size = sum(max(item.file_size, _stated_bytes(packed, item)) for item in packed.infolist())
        if size > LARGEST_ARRAYS:
            raise ImportDataError(f"{file.name}: {size / 1e9:.3g} GB of arrays is above the limit of 1.5 GB")
        with np.load(file, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except ImportDataError:
        raise
    except (OSError, ValueError, EOFError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise ImportDataError(f"{file.name}: not an npz archive of plain arrays") from error


def _stated_bytes(packed: zipfile.ZipFile, item: zipfile.ZipInfo) -> int:
    """Bytes of an array as its header states them: that is what reading it allocates."""
    with packed.open(item) as content:
        version = np.lib.format.read_magic(content)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read(content)
    return math.prod(shape) * kind.itemsize
