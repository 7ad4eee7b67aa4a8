"""Arrays, launches and captures of Warp, all on the device in use."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import warp as wp

DEVICE = "cpu"  # arrays are read and written in place as NumPy's, which only memory of the CPU allows
Shape = int | tuple[int, ...]


def array(values: Any, dtype: Any) -> Any:
    """Return an array that holds `values`."""
    return wp.array(values, dtype=dtype, device=DEVICE)


def ints(values: Any) -> Any:
    """Return an array of 32-bit integers that holds `values`."""
    return array(np.asarray(values, dtype=np.int32), wp.int32)


def doubles(values: Any) -> Any:
    """Return an array of 64-bit floats that holds `values`."""
    return array(np.asarray(values, dtype=np.float64), wp.float64)


def zeros(shape: Shape, dtype: Any) -> Any:
    """Return an array of zeros."""
    return wp.zeros(shape, dtype=dtype, device=DEVICE)


def full(shape: Shape, value: Any, dtype: Any) -> Any:
    """Return an array that holds `value` everywhere."""
    return wp.full(shape, value, dtype=dtype, device=DEVICE)


def empty(shape: Shape, dtype: Any) -> Any:
    """Return an array whose values are not set."""
    return wp.empty(shape, dtype=dtype, device=DEVICE)


def launch(kernel: Any, dim: Any, inputs: list[Any]) -> None:
    """Launch a kernel over `dim` threads."""
    wp.launch(kernel, dim=dim, inputs=inputs, device=DEVICE)


def capture() -> wp.ScopedCapture:
    """Return a context manager that records launches as a graph, its `graph`."""
    return wp.ScopedCapture(device=DEVICE)


def load(modules: Iterable[Any], workers: int) -> None:
    """Compile and load modules of kernels, `workers` at a time."""
    wp.force_load(device=DEVICE, modules=list(modules), max_workers=workers)
