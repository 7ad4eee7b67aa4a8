"""A Dask scheduler's workers give the bytes that local processes give, and what is missing is named."""

from __future__ import annotations

import importlib
import pickle
import socket
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from polyworld.core.interruption import Interrupted, Interruption
from polyworld.executors import TRIES, DaskExecutor, Failure, LocalExecutor, SerialExecutor, executor_from, results
from tests.polyworld.executors.pieces import Marked, die_at_first, half, noise, threads, wait_for

KEYS = tuple(f"case {k}" for k in range(5))


@pytest.fixture(scope="module")
def in_process() -> Iterator[DaskExecutor]:
    """Give an executor on a scheduler whose two workers are threads of this process."""
    distributed = pytest.importorskip("distributed", reason="needs the extra: pip install 'atw-mcp[distributed]'")
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0")
    with cluster, executor_from(f"dask:{cluster.scheduler_address}") as executor:
        assert isinstance(executor, DaskExecutor)
        yield executor


def test_a_scheduler_gives_the_bytes_that_this_process_gives(in_process: DaskExecutor) -> None:
    assert in_process.workers == 2
    here = results(SerialExecutor().map(noise, {k: k for k in KEYS}))
    there = results(in_process.map(noise, {k: k for k in KEYS}))
    assert pickle.dumps(here) == pickle.dumps(there)
    again = results(in_process.run(noise, {KEYS[2]: KEYS[2]}))
    assert again[KEYS[2]].tobytes() == here[KEYS[2]].tobytes()


def test_functions_and_classes_of_the_script_that_was_started_serve(in_process: DaskExecutor) -> None:
    class Local:  # as what stands in __main__, no worker can import it
        pass

    (found,) = results(in_process.run(lambda _: Local(), {"a": 0})).values()
    assert isinstance(found, Local)


def test_an_interruption_drops_what_has_not_started(in_process: DaskExecutor) -> None:
    interruption = Interruption()
    outcomes = in_process.run(noise, {str(k): str(k) for k in range(50)}, progress=lambda *_: interruption.request())
    with interruption.active(), pytest.raises(Interrupted):
        list(outcomes)


def test_an_address_without_a_scheduler_is_named() -> None:
    pytest.importorskip("distributed", reason="needs the extra: pip install 'atw-mcp[distributed]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(ConnectionError, match=rf"no Dask scheduler answered at {address} within 0.2 s"):
        DaskExecutor(address, timeout=0.2)


def test_a_scheduler_without_workers_is_named() -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra: pip install 'atw-mcp[distributed]'")
    cluster = distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0")
    with cluster, pytest.raises(ConnectionError, match=r"no workers after 0.1 s: start some with `dask worker"):
        DaskExecutor(cluster.scheduler_address, timeout=0.1)


def test_the_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> ModuleType:
        if name == "distributed":
            raise ModuleNotFoundError("No module named 'distributed'")
        return importlib.import_module(name)

    monkeypatch.setattr("polyworld.executors.dask.import_module", missing)
    with pytest.raises(RuntimeError, match=r"pip install 'atw-mcp\[distributed\]'"):
        executor_from("dask")


@pytest.mark.benchmark
def test_a_cluster_of_this_machine_is_as_local_processes(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs the extra: pip install 'atw-mcp[distributed]'")
    pieces = {str(k): Marked(tmp_path / str(k), deaths=int(k == 1)) for k in range(4)}
    pieces["always"] = Marked(tmp_path / "always", deaths=TRIES)
    with executor_from("dask", 2) as cluster:
        with LocalExecutor(2) as local:
            keys = {k: k for k in KEYS}
            assert pickle.dumps(results(cluster.map(noise, keys))) == pickle.dumps(results(local.map(noise, keys)))
            assert results(cluster.run(threads, {"a": 0})) == results(local.run(threads, {"a": 0}))
        found = dict(cluster.run(die_at_first, pieces))
        failure = found.pop("always")
        assert found == {"0": 1, "1": 2, "2": 1, "3": 1}
        assert isinstance(failure, Failure)
        assert failure.tries == len((tmp_path / "always").read_text()) == TRIES
        outcomes = cluster.run(wait_for, {"long": tmp_path / "a", "longer": tmp_path / "b"})
        interruption = Interruption()
        interruption.request()
        with interruption.active(), pytest.raises(Interrupted):
            next(outcomes)
        assert results(cluster.run(half, {"after": 2})) == {"after": 1.0}
