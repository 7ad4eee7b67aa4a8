"""A process of `LocalExecutor`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import Connection, wait

from polyworld.core.cores import LIMIT
from polyworld.executors.task import answered


def worker_environment(threads: int) -> dict[str, str]:
    """Return the environment variables of a worker whose kernels may use so many threads."""
    one = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return dict.fromkeys(one, "1") | {LIMIT: str(threads)}


def serve(pipe: Connection) -> None:
    """Answer pieces until an empty message comes, the other end is closed, or the process that waits for them ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that waits for the pieces decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            task = pipe.recv_bytes()
        except (EOFError, OSError):
            return
        if not task:
            return
        try:
            pipe.send_bytes(answered(task))
        except OSError:
            return  # nobody waits any more


def _end_with_parent() -> None:
    """End this process, also amid a piece, where its parent was killed and could not do so."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
