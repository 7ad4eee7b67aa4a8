"""Canonical JSON, content ids, and arrays as bytes."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[Any]]


def to_json(value: Any) -> str:
    """JSON with sorted keys and no spaces; NaN and infinity are refused with ValueError."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def content_id(prefix: str, value: Any) -> str:
    """`prefix-` and the first 16 hex digits of the SHA-256 of the value's canonical JSON."""
    return f"{prefix}-{hashlib.sha256(to_json(value).encode()).hexdigest()[:16]}"


def pack_arrays(arrays: Arrays | None) -> bytes | None:
    """Arrays as a compressed npz; equal arrays give equal bytes."""
    if not arrays:
        return None
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **{name: arrays[name] for name in sorted(arrays)})
    return buffer.getvalue()


def unpack_arrays(blob: bytes | None) -> dict[str, NDArray[Any]]:
    """The inverse of `pack_arrays`."""
    if blob is None:
        return {}
    with np.load(io.BytesIO(blob), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
