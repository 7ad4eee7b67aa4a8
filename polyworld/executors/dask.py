"""Run pieces on the workers of a Dask scheduler (the `distributed` extra)."""

from __future__ import annotations

import os
import pickle
import queue
import time
import uuid
import warnings
from collections.abc import Callable, Generator, Mapping
from importlib import import_module
from itertools import islice
from pkgutil import resolve_name
from typing import Any

from polyworld.core import interruption
from polyworld.core.cores import LIMIT, available_cores
from polyworld.executors.executor import TRIES, Executor, Failure, Piece, Result
from polyworld.executors.local import POLL
from polyworld.executors.task import answered, describe, pickled_function, pickled_task
from polyworld.executors.worker import worker_environment

EXTRA = "pip install 'atw-mcp[distributed]'"
REFRESH = 1.0  # seconds between two counts of the workers
TIMEOUT = 10.0  # seconds that a scheduler gets to answer, and to have a first worker


class DaskExecutor(Executor):
    """Run pieces on the workers of a scheduler, or of a local cluster of `workers` processes that this starts.

    As many pieces are on their way as the workers have threads, so that a worker that dies takes none with it but those
    it runs. These run again elsewhere, until they have lost as many workers as the scheduler's `allowed-failures` (a
    cluster started here: `TRIES`). A result is fetched as soon as it is there, and only one that a worker takes along
    before is computed twice. Pieces under way on a scheduler of others run to their end where the caller leaves early.
    """

    def __init__(self, address: str | None = None, workers: int | None = None, timeout: float = TIMEOUT) -> None:
        distributed = _distributed()
        self._cluster: Any = None
        if address is None:
            self._cluster = _local_cluster(distributed, workers or available_cores())
        try:
            self._client = distributed.Client(self._cluster or address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            raise ConnectionError(
                f"no Dask scheduler answered at {address} within {timeout:g} s ({describe(error)}): "
                "start one with `dask scheduler`, or give the address that it prints"
            ) from error
        self.address: str = self._client.scheduler.address
        try:
            self._client.wait_for_workers(1, timeout=timeout)
            self._check_workers()
        except TimeoutError as error:
            self.close()
            raise ConnectionError(
                f"the Dask scheduler at {address} has no workers after {timeout:g} s: "
                f"start some with `dask worker {address} --nworkers auto --nthreads 1`"
            ) from error
        except BaseException:
            self.close()
            raise

    @property
    def workers(self) -> int:  # type: ignore[override]
        """How many pieces run at once: threads of the workers that are connected now."""
        threads: dict[str, int] = self._client.nthreads()
        return max(1, sum(threads.values()))

    def _check_workers(self) -> None:
        """Check that the workers can import this package, and warn of those that run pieces in threads."""
        asked = self._client.run(resolve_name, f"{__name__}:TIMEOUT", on_error="return")
        for worker, answer in asked.items():
            if isinstance(answer, BaseException):
                raise RuntimeError(
                    f"the Dask worker {worker} cannot run pieces ({describe(answer)}): install this atw-mcp there"
                )
        most = max(self._client.nthreads().values())
        if most > 1:
            warnings.warn(
                f"workers of {self.address} run up to {most} pieces in threads of one process, which wait for each "
                "other: `dask worker --nworkers auto --nthreads 1` starts a process a core",
                stacklevel=3,
            )

    def _outcomes(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece]
    ) -> Generator[tuple[str, Result | Failure]]:
        dumps = import_module("cloudpickle").dumps  # also takes functions of the script that was started
        name = f"{getattr(function, '__name__', 'piece')}-{uuid.uuid4().hex[:8]}"
        work, waiting = pickled_function(function, dumps), iter(tuple(pieces))
        running: dict[Any, str] = {}
        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        number, slots, counted = 0, 0, -REFRESH
        try:
            while True:
                if time.monotonic() - counted > REFRESH:  # workers come and go
                    slots, counted = self.workers, time.monotonic()
                for key in islice(waiting, max(0, slots - len(running))):
                    task = pickled_task(key, work, pieces[key], dumps)
                    if isinstance(task, Failure):
                        yield key, task
                        continue
                    number += 1
                    future = self._client.submit(run_piece, task, key=f"{name}-{number}", pure=False)
                    running[future] = key
                    future.add_done_callback(done.put)
                if not running:
                    return
                interruption.check()
                try:
                    future = done.get(timeout=POLL)
                except queue.Empty:
                    continue
                key = running.pop(future)
                outcome = self._outcome(key, future)
                future.release()
                yield key, outcome
        finally:
            if running:
                self._drop(list(running))

    def _outcome(self, key: str, future: Any) -> Any:
        """Return the result of a future that is done, or its failure."""
        try:
            return pickle.loads(future.result())
        except _distributed().KilledWorker as error:
            tries = error.allowed_failures + 1
            return Failure(key, f"its worker died on each of {tries} tries, last {error.last_worker}", tries=tries)
        except Exception as error:
            if future.status == "error":  # Dask could not run it
                return Failure(key, describe(error))
            raise ConnectionError(f"lost the Dask scheduler at {self.address}: {describe(error)}") from error

    def _drop(self, futures: list[Any]) -> None:
        self._client.cancel(futures)
        if self._cluster is not None:  # Dask cannot end a piece that runs but by its process
            self._client.restart(wait_for_workers=False)

    def close(self) -> None:
        """Leave the scheduler, and end a cluster that was started here."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def run_piece(task: bytes) -> bytes:
    """Answer a piece in a thread of a Dask worker; its kernels have that thread, unless the worker's environment says
    otherwise."""
    os.environ.setdefault(LIMIT, "1")
    return answered(task, import_module("cloudpickle").dumps)


def _distributed() -> Any:
    try:
        return import_module("distributed")
    except ImportError as error:
        raise RuntimeError(f"Dask is not installed ({error}): {EXTRA}") from error


def _local_cluster(distributed: Any, workers: int) -> Any:
    """Start a cluster of this machine whose workers are as those of `LocalExecutor`."""
    with import_module("dask").config.set({"distributed.scheduler.allowed-failures": TRIES - 1}):
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,  # none
            dashboard_address=":0",
            env=worker_environment(max(1, available_cores() // workers)),
        )
