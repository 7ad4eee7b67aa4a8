"""How much memory a piece of work takes (Linux)."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

STATUS = Path("/proc/self/status")
RESET = Path("/proc/self/clear_refs")


def peak_megabytes(work: Callable[[], object]) -> float:
    """Return how far resident memory rose above its start while `work` ran [MB]; NaN where the system does not say."""
    if not STATUS.exists() or not os.access(RESET, os.W_OK):
        work()
        return float("nan")
    gc.collect()
    with suppress(OSError, AttributeError):  # glibc alone keeps what was freed, and has this to give it back
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    RESET.write_text("5")  # the peak starts again at what is resident now
    before = _field("VmRSS")
    work()
    return max(0.0, (_field("VmHWM") - before) / 1e3)


def _field(name: str) -> float:
    """A field of the process's status [kB]."""
    for line in STATUS.read_text().splitlines():
        if line.startswith(f"{name}:"):
            return float(line.split()[1])
    return float("nan")
