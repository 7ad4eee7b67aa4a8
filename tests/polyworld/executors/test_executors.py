"""Bags of pieces give the same results wherever they run, and no piece costs another its result."""

from __future__ import annotations

import argparse
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from polyworld.core.interruption import Interrupted, Interruption
from polyworld.executors import (
    TRIES,
    Executor,
    FailedPiecesError,
    Failure,
    LocalExecutor,
    SerialExecutor,
    add_executor_argument,
    executor_from,
    results,
)
from tests.polyworld.executors.pieces import Marked, die_at_first, half, noise, threads, unpicklable, wait_for

KEYS = tuple(f"case {k}" for k in range(7))


@pytest.fixture(scope="module")
def two() -> Iterator[Executor]:
    with LocalExecutor(2) as executor:
        yield executor


def test_results_do_not_depend_on_the_order_or_on_where_pieces_run(two: Executor) -> None:
    here = results(SerialExecutor().run(noise, {k: k for k in KEYS}))
    there = results(two.run(noise, {k: k for k in reversed(KEYS)}))
    assert {k: pickle.dumps(v) for k, v in here.items()} == {k: pickle.dumps(v) for k, v in there.items()}
    assert len({v.tobytes() for v in here.values()}) == len(KEYS)


def test_map_keeps_the_order_of_pieces(two: Executor) -> None:
    assert [key for key, _ in two.map(noise, {k: k for k in KEYS})] == list(KEYS)


def test_a_piece_that_raises_is_reported_and_the_rest_goes_on(two: Executor) -> None:
    found = dict(two.run(half, {str(k): k for k in range(4)}))
    assert (found["0"], found["2"]) == (0.0, 1.0)
    failure = found["3"]
    assert isinstance(failure, Failure)
    assert failure.error == "ValueError: 3 is odd"
    assert "in half" in failure.traceback
    with pytest.raises(FailedPiecesError, match=r"'1' failed: ValueError: 1 is odd \(1 more failed\)"):
        results(two.map(half, {str(k): k for k in range(4)}))


def test_what_cannot_be_pickled_is_reported(two: Executor) -> None:
    found = dict(two.run(unpicklable, {"result": 1}))
    assert "the result cannot be pickled" in str(found["result"])
    found = dict(two.run(half, {"piece": lambda: 1, "fine": 2}))  # type: ignore[dict-item]
    assert "the piece cannot be pickled" in str(found["piece"])
    assert found["fine"] == 1.0
    with pytest.raises(TypeError, match="top of a module"):
        next(two.run(lambda value: value, {"a": 1}))


def test_a_killed_worker_loses_and_repeats_nothing(two: Executor, tmp_path: Path) -> None:
    pieces = {str(k): Marked(tmp_path / str(k), deaths=int(k == 1)) for k in range(4)}
    pieces["always"] = Marked(tmp_path / "always", deaths=TRIES)
    found = dict(two.run(die_at_first, pieces))
    failure = found.pop("always")
    assert found == {"0": 1, "1": 2, "2": 1, "3": 1}
    assert isinstance(failure, Failure)
    assert failure.tries == len((tmp_path / "always").read_text()) == TRIES
    assert "status -9" in failure.error


def test_progress_counts_pieces_and_estimates_the_time_left() -> None:
    seen: list[tuple[int, int, float | None]] = []
    results(SerialExecutor().run(noise, {k: k for k in KEYS}, progress=lambda *now: seen.append(now)))
    assert [(done, total) for done, total, _ in seen] == [(k, len(KEYS)) for k in range(len(KEYS) + 1)]
    assert seen[0][2] is None
    assert seen[-1][2] == 0.0
    assert all(left is not None and left > 0.0 for _, _, left in seen[1:-1])


def ended(file: Path) -> bool:
    """Whether the process that wrote a file is gone."""
    try:
        os.kill(int(file.read_text()), 0)
    except ProcessLookupError:
        return True
    return False


def test_an_interruption_ends_the_pieces_that_run(two: Executor, tmp_path: Path) -> None:
    interruption, file = Interruption(), tmp_path / "running"

    def interrupt() -> None:
        while not file.exists():
            time.sleep(0.01)
        interruption.request()

    thread = threading.Thread(target=interrupt)
    thread.start()
    with interruption.active(), pytest.raises(Interrupted):
        list(two.run(wait_for, {"long": file}))
    thread.join()
    assert ended(file)
    assert results(two.run(half, {"after": 2})) == {"after": 1.0}


@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGKILL])
def test_a_worker_ends_amid_a_piece_when_its_parent_is_killed(tmp_path: Path, by: signal.Signals) -> None:
    started = tmp_path / "started"
    text = (
        "import pathlib, sys\n"
        "from polyworld.executors import LocalExecutor\n"
        "from tests.polyworld.executors.pieces import wait_for\n"
        "if __name__ == '__main__':\n"
        "    list(LocalExecutor(1).run(wait_for, {'a': pathlib.Path(sys.argv[1])}))\n"
    )
    script = tmp_path / "waits.py"
    script.write_text(text)
    root = {"PYTHONPATH": str(Path(__file__).parents[3])}
    command = [sys.executable, str(script), str(started)]
    with subprocess.Popen(command, env=os.environ | root, stdout=subprocess.PIPE) as parent:
        while not started.exists():
            assert parent.poll() is None
            time.sleep(0.01)
        parent.send_signal(by)
        parent.communicate(timeout=20)  # which ends when nobody holds the parent's output any more, its worker included


def test_leaving_early_frees_the_executor_and_a_second_bag_beside_is_refused(two: Executor) -> None:
    outcomes = two.run(half, {str(k): 2 * k for k in range(20)})
    next(outcomes)
    with pytest.raises(RuntimeError, match="still runs other pieces"):
        next(two.run(half, {"a": 2}))
    outcomes.close()
    assert results(two.run(half, {"a": 2})) == {"a": 1.0}


def test_processes_share_the_cores_and_leave_the_environment(two: Executor) -> None:
    before = dict(os.environ)
    (found,) = results(two.run(threads, {"a": 0})).values()
    assert found[0] == "1"
    assert int(found[1] or 0) == max(1, len(os.sched_getaffinity(0)) // 2)
    assert dict(os.environ) == before


def test_executors_are_named_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_executor_argument(parser)
    assert parser.parse_args([]).executor == "local"
    assert executor_from("local", 3).workers == 3
    assert executor_from("local:4", 3).workers == 4
    assert isinstance(executor_from("serial"), SerialExecutor)
    for wrong in ("local:0", "local:x", "local:", "cloud", "serial:2", "dask:host:8786"):
        with pytest.raises(ValueError, match=wrong):
            executor_from(wrong)
    with pytest.raises(SystemExit):
        parser.parse_args(["--executor", "dask:host:8786"])
    assert "dask:tcp://HOST:PORT" in capsys.readouterr().err
