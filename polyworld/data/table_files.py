"""The text of a table's file: plain text, or the first sheet of a workbook; other kinds are refused with the cure."""

from __future__ import annotations

import zipfile
from pathlib import Path

LARGEST_BOOK = 200_000_000  # bytes of a workbook unpacked: a small archive may hold far more than memory
# How files begin that are no text -> what they are, and how to make a table of them.
_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"MATLAB", "a MATLAB file; in MATLAB, export it as CSV: writematrix or writetable"),
    (b"\x89HDF", "an HDF5 file (MATLAB writes such too); export the table as CSV"),
    (b"\xd0\xcf\x11\xe0", "a workbook of an old kind (.xls); save it as .xlsx, or export the sheet as CSV"),
    (b"\x93NUMPY", "an array of NumPy; export it as CSV: numpy.savetxt with a header and delimiter ','"),
    (b"PK", "an archive (such as .npz) and no table; export the table as CSV"),
    (b"\x1f\x8b", "a compressed file; unpack it first"),
    (b"%PDF", "a PDF; export the table as CSV"),
)


def file_text(path: Path) -> str:
    """Return the text of a file in UTF-8 or, if it says so, UTF-16, or of the first sheet of a workbook with cells
    separated by tabs; raises ValueError."""
    content = path.read_bytes()
    if content.startswith(b"PK") and b"xl/workbook" in content:
        return _sheet_text(path)
    for mark, what in _OTHERS:
        if content.startswith(mark):
            raise ValueError(f"this is {what}")
    utf16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        return content.decode("utf-16" if utf16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in content[:1000]:
            raise ValueError("this is no text; export the table as CSV") from error
        line = content[: error.start].count(b"\n") + 1
        raise ValueError(
            f"line {line} is not in UTF-8 (byte {error.start}); export the table as CSV in UTF-8"
        ) from error


def in_file(path: Path, error: ValueError) -> str:
    """Return an error's message with the file's name before every line."""
    return "\n".join(f"{path.name}: {line}" for line in str(error).splitlines())


def _sheet_text(path: Path) -> str:
    try:
        import openpyxl  # type: ignore[import-untyped,import-not-found,unused-ignore]
    except ImportError as error:
        raise ValueError("workbooks need openpyxl (pip install 'atw-mcp[workbooks]'); or export it as CSV") from error
    with zipfile.ZipFile(path) as packed:
        size = sum(item.file_size for item in packed.infolist())
    if size > LARGEST_BOOK:
        raise ValueError(f"a workbook of {size / 1e6:.4g} MB unpacked is above the limit of 200 MB; export it as CSV")
    with path.open("rb") as file:  # by content: a workbook may be called .xls
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        sheets = [list(s.iter_rows(values_only=True)) for s in book.worksheets]
        filled = [rows for rows in sheets if any(c is not None for row in rows for c in row)]
        if len(filled) != 1:
            raise ValueError(f"a workbook with one filled sheet is read, this has {len(filled)}; export one as CSV")
        rows = [["" if c is None else str(c) for c in row] for row in filled[0]]
        book.close()
    return "\n".join("\t".join(" ".join(cell.split()) for cell in row) for row in rows)
