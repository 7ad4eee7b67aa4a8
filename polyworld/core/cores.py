"""Cores that this process may use."""

from __future__ import annotations

import os

LIMIT = "POLYWORLD_THREADS"
"""Environment variable: at most so many, where several processes share the machine."""


def available_cores() -> int:
    """Return the number of cores this process may use, at most the limit that its environment sets."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = os.environ.get(LIMIT, "")
    return max(1, min(cores, int(limit))) if limit.isdecimal() else cores
