"""Records passed to kernels by reference."""

from __future__ import annotations

from typing import Any

from polyworld.core import buffers


def by_reference(record: Any, kind: Any, before: Any = None) -> Any:
    """Return a record as an array of one, to pass it by reference.

    Warp passes structs by value from function to function, and to copy those of a whole world would take longer than a
    step does.

    kind: the record's struct. before: an array to write it to. The array keeps the record, and so what it points to.
    """
    found: Any = buffers.empty(1, kind) if before is None else before
    buffers.write_bytes(found, record.__ctype__())
    found.record = record
    return found
