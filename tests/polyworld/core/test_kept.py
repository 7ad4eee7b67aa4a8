"""Caches hold so many bytes and no more, of what was used last."""

from __future__ import annotations

import tracemalloc
from threading import Barrier, Thread

import numpy as np
from numpy.typing import NDArray

from polyworld.core.kept import Kept, bytes_of, kept

MEGABYTE = 1_000_000


def test_a_cache_stays_within_its_bytes_as_the_allocator_counts_them() -> None:
    cache: Kept[int, NDArray[np.uint8]] = Kept(20 * MEGABYTE)
    tracemalloc.start()
    for number in range(200):
        cache.get(number, lambda: np.zeros(MEGABYTE, np.uint8))
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 15 * MEGABYTE < held < 23 * MEGABYTE


def test_what_was_used_last_is_kept() -> None:
    made: list[str] = []

    @kept(3 * MEGABYTE)
    def zeros(name: str) -> NDArray[np.uint8]:
        made.append(name)
        return np.zeros(MEGABYTE, np.uint8)

    for name in ("a", "b", "a", "c", "a", "d", "a", "b"):
        assert zeros(name) is zeros(name)
    assert made == ["a", "b", "c", "d", "b"]


def test_a_value_that_grew_is_measured_again_when_the_next_one_comes() -> None:
    cache: Kept[int, list[NDArray[np.uint8]]] = Kept(3 * MEGABYTE)
    first = cache.get(1, list)
    first.append(np.zeros(5 * MEGABYTE, np.uint8))
    cache.get(2, list)
    assert cache.get(1, list) is not first


def test_bytes_are_those_that_the_allocator_gives() -> None:
    rng = np.random.default_rng(0)
    tracemalloc.start()
    value = {
        "points": tuple(tuple(row) for row in rng.normal(size=(50_000, 3)).tolist()),
        "part": [rng.normal(size=300_000)[1:], "x" * 400_000],
    }
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 0.8 * taken < bytes_of(value) < 1.3 * taken


def test_threads_that_ask_at_once_get_the_same_value() -> None:
    cache: Kept[int, object] = Kept(MEGABYTE)
    together = Barrier(8)
    got: list[object] = []

    def ask() -> None:
        together.wait()
        got.append(cache.get(1, object))

    threads = [Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({id(value) for value in got}) == 1
