"""A document as bytes: JSON with the places of its arrays, and the arrays.

Before compression: `ATWV`, the length of the JSON as a little-endian uint32, the JSON (UTF-8, padded with spaces to a
multiple of 4 bytes), the arrays, each at a multiple of 4 bytes from the first. All of it is compressed with gzip, which
browsers decompress by themselves.
"""

from __future__ import annotations

import gzip
import hashlib
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from atw_mcp.viewer.document import ViewDocument
from atw_mcp.viewer.parts import Block

MAGIC = b"ATWV"
ALIGNMENT = 4  # bytes: typed arrays of JavaScript begin at multiples of the size of their elements


class Blocks:
    """The binary section of a document under construction. Equal arrays are kept once."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        self._known: dict[tuple[str, tuple[int, ...], bytes], Block] = {}

    def floats(self, values: ArrayLike) -> Block:
        """Keep numbers as float32."""
        return self._keep(np.asarray(values), "float32")

    def integers(self, values: ArrayLike) -> Block:
        """Keep whole numbers as int32."""
        return self._keep(np.asarray(values), "int32")

    def small(self, values: ArrayLike) -> Block:
        """Keep whole numbers 0..65535, such as pixels, as uint16."""
        return self._keep(np.asarray(values), "uint16")

    def raw(self, values: ArrayLike | bytes) -> Block:
        """Keep bytes or booleans as uint8."""
        octets = np.frombuffer(values, np.uint8) if isinstance(values, bytes) else np.asarray(values)
        return self._keep(octets, "uint8")

    def _keep(self, values: NDArray[Any], dtype: Any) -> Block:
        data = np.ascontiguousarray(values, dtype=np.dtype(dtype).newbyteorder("<")).tobytes()
        key = (dtype, values.shape, hashlib.sha256(data).digest())
        if key in self._known:
            return self._known[key]
        block = self._known[key] = Block(dtype=dtype, shape=list(values.shape), offset=self._size)
        padding = -len(data) % ALIGNMENT if data else ALIGNMENT  # so that no two different arrays share an offset
        self._parts.append(data + b"\0" * padding)
        self._size += len(data) + padding
        return block

    def joined(self) -> bytes:
        """Return the whole section."""
        return b"".join(self._parts)


def packed(document: ViewDocument, blocks: Blocks) -> bytes:
    """Return a document with its arrays as bytes; equal documents give equal bytes."""
    text = document.model_dump_json().encode()
    text += b" " * (-len(text) % ALIGNMENT)
    whole = MAGIC + struct.pack("<I", len(text)) + text + blocks.joined()
    return gzip.compress(whole, compresslevel=6, mtime=0)


def unpacked(data: bytes) -> tuple[ViewDocument, dict[int, NDArray[Any]]]:
    """Return the document in bytes that `packed` wrote, and its arrays by offset; raises ValueError for other bytes."""
    whole = gzip.decompress(data)
    if whole[:4] != MAGIC:
        raise ValueError("these bytes are not a packed view document")
    (length,) = struct.unpack("<I", whole[4:8])
    document = ViewDocument.model_validate_json(whole[8 : 8 + length])
    section = memoryview(whole)[8 + length :]
    arrays: dict[int, NDArray[Any]] = {}

    def walk(value: Any) -> None:
        if isinstance(value, Block):
            count = int(np.prod(value.shape, dtype=np.int64))
            kind = np.dtype(value.dtype).newbyteorder("<")
            arrays[value.offset] = np.frombuffer(section, kind, count, value.offset).reshape(value.shape)
        elif isinstance(value, list):
            for item in value:
                walk(item)
        elif hasattr(type(value), "model_fields"):
            for name in type(value).model_fields:
                walk(getattr(value, name))

    walk(document)
    return document, arrays
