"""A process of `LocalExecutor`."""

from __future__ import annotations

import signal
from multiprocessing.connection import Connection

from polyworld.core.cores import LIMIT
from polyworld.executors.task import answered


def worker_environment(threads: int) -> dict[str, str]:
    """Return the environment variables of a worker whose kernels may use so many threads."""
    one = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return dict.fromkeys(one, "1") | {LIMIT: str(threads)}


def serve(pipe: Connection) -> None:
    """Answer pieces until an empty message comes, or the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that waits for the pieces decides
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
