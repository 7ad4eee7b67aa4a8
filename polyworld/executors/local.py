"""Run pieces in processes of this machine.

Each worker is a process with a pipe of its own and holds one piece at a time, so that the death of a process is charged
to the piece that it ran and to no other (a `ProcessPoolExecutor` breaks as a whole, and all pieces under way with it).
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from collections import deque
from collections.abc import Callable, Generator, Mapping
from multiprocessing.connection import Connection, wait
from typing import Any

from polyworld.core import interruption
from polyworld.core.cores import available_cores
from polyworld.executors.executor import TRIES, Executor, Failure, Piece, Result
from polyworld.executors.task import pickled_function, pickled_task
from polyworld.executors.worker import serve, worker_environment

POLL = 0.1  # seconds between two looks at whether the caller was interrupted
GRACE = 5.0  # seconds that a process gets to end

_STARTING = threading.Lock()  # the environment of a new process is that of this one, changed while it starts


class _Worker:
    """A process that applies functions to pieces, one at a time."""

    def __init__(self, threads: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.key: str | None = None
        self.process = context.Process(target=serve, args=(theirs,), daemon=True)
        with _STARTING:
            before = dict(os.environ)
            os.environ.update(worker_environment(threads))
            try:
                self.process.start()
            finally:
                for name in worker_environment(threads):
                    os.environ.pop(name)
                    if name in before:
                        os.environ[name] = before[name]
        theirs.close()

    def give(self, key: str, task: bytes) -> None:
        """Hand over a piece; a process that is dead shows when its answer is read."""
        self.key = key
        try:
            self.pipe.send_bytes(task)
        except OSError:
            self.pipe.close()

    def answer(self) -> bytes | None:
        """Return the pickled outcome; None where the process died before it had sent it whole."""
        try:
            return self.pipe.recv_bytes() if self.pipe.poll() else None
        except (EOFError, OSError):
            return None

    def kill(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.join(GRACE)
        self.pipe.close()

    def end(self) -> None:
        """Let an idle process end, and wait for it."""
        try:
            self.pipe.send_bytes(b"")
        except OSError:
            pass
        else:
            self.process.join(GRACE)
        self.kill()


class LocalExecutor(Executor):
    """Run pieces in `workers` spawned processes, which are kept until `close` and share the machine's cores.

    Linear algebra has one thread a process, so that its sums do not depend on the number of workers; kernels have the
    cores that are a worker's share, which their results do not depend on. Compiled kernels lie in one cache on disk.
    A piece whose process dies is run again in a fresh one, and is a `Failure` once it has lost `TRIES` of them.
    """

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise ValueError(f"workers must be at least 1, got {workers}")
        self.workers = workers
        self._workers: list[_Worker] = []
        self._busy = False

    def _outcomes(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece]
    ) -> Generator[tuple[str, Result | Failure]]:
        if self._busy:
            raise RuntimeError("this executor still runs other pieces: take their results to the end, or close them")
        self._busy = True
        try:
            yield from self._run(function, pieces)
        finally:
            for worker in [w for w in self._workers if w.key is not None]:
                self._workers.remove(worker)
                worker.kill()
            self._busy = False

    def _run(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece]
    ) -> Generator[tuple[str, Result | Failure]]:
        work = pickled_function(function)
        queue = deque(pieces)
        lost = dict.fromkeys(pieces, 0)
        while queue or any(w.key is not None for w in self._workers):
            interruption.check()
            while queue and (worker := self._idle()) is not None:
                key = queue.popleft()
                task = pickled_task(key, work, pieces[key])
                if isinstance(task, Failure):
                    yield key, task
                else:
                    worker.give(key, task)
            done: list[tuple[str, Result | Failure]] = []
            for worker in self._ready():
                key, worker.key, answer = str(worker.key), None, worker.answer()
                if answer:
                    done.append((key, pickle.loads(answer)))
                    continue
                self._workers.remove(worker)
                worker.kill()
                lost[key] += 1
                if lost[key] < TRIES:
                    queue.appendleft(key)
                else:
                    died = f"its process died with status {worker.process.exitcode} on each of {TRIES} tries"
                    done.append((key, Failure(key, died, tries=TRIES)))
            yield from done

    def _idle(self) -> _Worker | None:
        """Return a worker without a piece, started where there are fewer than may be; None where all are busy."""
        for worker in [w for w in self._workers if w.key is None]:
            if worker.process.is_alive():
                return worker
            self._workers.remove(worker)  # killed while it waited
            worker.kill()
        if len(self._workers) < self.workers:
            self._workers.append(_Worker(max(1, available_cores() // self.workers)))
            return self._workers[-1]
        return None

    def _ready(self) -> list[_Worker]:
        """Wait a little, and return busy workers that answered or died."""
        busy = [w for w in self._workers if w.key is not None]
        if closed := [w for w in busy if w.pipe.closed]:
            return closed
        watched: list[Connection | int] = [w.pipe for w in busy]
        ready: set[Any] = set(wait(watched + [w.process.sentinel for w in busy], POLL))
        return [w for w in busy if w.pipe in ready or w.process.sentinel in ready]

    def close(self) -> None:
        """End the processes."""
        workers, self._workers = self._workers, []
        for worker in workers:
            if worker.key is None:
                worker.end()
            else:
                worker.kill()
