"""Processes that share a cache of kernels compile each module once."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from polyworld.core.compile_lock import one_process_at_a_time


def test_the_second_waits_for_the_first_where_names_overlap(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    order: list[str] = []
    within, leave = threading.Event(), threading.Event()

    def first() -> None:
        with one_process_at_a_time(tmp_path, ["b", "a"]):
            within.set()
            leave.wait(10.0)
            order.append("first")

    def second() -> None:
        with one_process_at_a_time(tmp_path, ["b", "c"]):
            order.append("second")

    threads = [threading.Thread(target=first), threading.Thread(target=second)]
    threads[0].start()
    assert within.wait(10.0)
    threads[1].start()
    with one_process_at_a_time(tmp_path, ["d"]):
        order.append("another name")
    leave.set()
    for thread in threads:
        thread.join(10.0)
    assert order == ["another name", "first", "second"]


def test_a_folder_that_cannot_be_written_is_no_obstacle(tmp_path: Path) -> None:
    with one_process_at_a_time(tmp_path / "missing", ["a"]):
        pass
