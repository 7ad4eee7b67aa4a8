"""A pool of threads that share the pieces of one job."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

SHARE = 16  # worlds that are worth a launch of their own: to hand one to a thread takes as long as a few rollouts


def shares(worlds: int, threads: int) -> int:
    """Return into how many pieces to cut the rollout of so many worlds.

    More than threads where there are many, so that a thread whose worlds are quick takes over from one whose are not.
    """
    if threads == 1:
        return 1
    return min(worlds, 4 * threads if worlds >= 4 * threads * SHARE else threads)


def run_in_pool(work: Callable[[int], None], pieces: int, threads: int) -> None:
    """Run `work` for 0 to pieces - 1 on so many threads, and wait for all of them; raises what a piece raised."""
    if pieces == 1 or threads == 1:
        for index in range(pieces):
            work(index)
        return
    list(_pool(threads).map(work, range(pieces)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads are kept: to start them for every rollout takes as long as a short rollout does."""
    return ThreadPoolExecutor(threads, thread_name_prefix="rollout")
