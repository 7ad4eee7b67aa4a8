"""Arrays, launches and captures of Warp, all on the device in use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
import warp as wp

from polyworld.core import warp_settings  # noqa: F401 before anything is launched
from polyworld.core.capture_lock import CaptureLock

DEVICE = "cpu"  # arrays are read and written in place as NumPy's, which only memory of the CPU allows
Shape = int | tuple[int, ...]
LOCK = CaptureLock()


def running() -> AbstractContextManager[None]:
    """Return what to hold while Warp is called otherwise than through this module."""
    return LOCK.shared()


def array(values: Any, dtype: Any) -> Any:
    """Return an array that holds `values`."""
    with LOCK.shared():
        return wp.array(values, dtype=dtype, device=DEVICE)


def ints(values: Any) -> Any:
    """Return an array of 32-bit integers that holds `values`."""
    return array(np.asarray(values, dtype=np.int32), wp.int32)


def doubles(values: Any) -> Any:
    """Return an array of 64-bit floats that holds `values`."""
    return array(np.asarray(values, dtype=np.float64), wp.float64)


def zeros(shape: Shape, dtype: Any) -> Any:
    """Return an array of zeros."""
    with LOCK.shared():
        return wp.zeros(shape, dtype=dtype, device=DEVICE)


def full(shape: Shape, value: Any, dtype: Any) -> Any:
    """Return an array that holds `value` everywhere."""
    with LOCK.shared():
        return wp.full(shape, value, dtype=dtype, device=DEVICE)


def empty(shape: Shape, dtype: Any) -> Any:
    """Return an array whose values are not set."""
    with LOCK.shared():
        return wp.empty(shape, dtype=dtype, device=DEVICE)


def launch(kernel: Any, dim: Any, inputs: list[Any]) -> None:
    """Launch a kernel over `dim` threads."""
    with LOCK.shared():
        wp.launch(kernel, dim=dim, inputs=inputs, device=DEVICE)


def clear(values: Any) -> None:
    """Set an array to zero."""
    with LOCK.shared():
        values.zero_()


def fill(values: Any, value: Any) -> None:
    """Set an array to `value` everywhere."""
    with LOCK.shared():
        values.fill_(value)


def assign(values: Any, new: Any) -> None:
    """Copy `new` into an array."""
    with LOCK.shared():
        values.assign(new)


@contextmanager
def capture() -> Iterator[wp.ScopedCapture]:
    """Record the launches of this thread as a graph, the `graph` of what is yielded.

    Warp records whatever any thread does meanwhile, so the others wait.
    """
    with LOCK.exclusive(), wp.ScopedCapture(device=DEVICE) as captured:
        yield captured


def replay(graph: Any) -> None:
    """Run the launches that a graph has recorded."""
    with LOCK.shared():
        wp.capture_launch(graph)


def load(modules: Iterable[Any], workers: int) -> None:
    """Compile and load modules of kernels, `workers` at a time."""
    wp.force_load(device=DEVICE, modules=list(modules), max_workers=workers)
