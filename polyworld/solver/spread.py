"""Pieces of one job on the threads of this process."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache


def spread(work: Callable[[int], None], pieces: int, threads: int) -> None:
    """Do `work` for 0 to pieces - 1 on so many threads, and wait for all of them; raises what a piece raised."""
    if pieces == 1 or threads == 1:
        for index in range(pieces):
            work(index)
        return
    list(_pool(threads).map(work, range(pieces)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads are kept: to start them for every rollout takes as long as a short rollout does."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rollout")
