"""Results kept in memory for when they are asked for again, as far as they fit into a number of bytes."""

from __future__ import annotations

import sys
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import wraps
from threading import Lock
from types import FunctionType, MethodType, ModuleType
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np

NUMBER = 32  # bytes of a Python number and the reference to it
NO_CONTENT = (FunctionType, MethodType, ModuleType, type, Lock().__class__)
K = TypeVar("K", bound=Hashable)
V = TypeVar("V")
P = ParamSpec("P")


@dataclass(frozen=True)
class KeptBounds:
    """Bytes that each cache of a kind may hold, so that a server that has seen many films holds some 1.5 GB at most.

    worlds: descriptions read from a store, 43 MB with a mesh of 156,000 triangles, a few kB without.
    models: worlds made ready for solvers, with their meshes; branches, members and frames of one world take turns.
    shapes: faces and elements of bodies by their shapes, 54 MB of a mesh of 156,000 triangles.
    views: what a page or a client reads in parts, a document or a film of a case, each 15 MB at most.
    """

    worlds: int = 200_000_000
    models: int = 400_000_000
    shapes: int = 150_000_000
    views: int = 100_000_000


BOUNDS = KeptBounds()


class Kept(Generic[K, V]):
    """Values by key, least recently used ones dropped where all take more than `most` bytes. Safe for several threads.

    The newest value is always kept, and measured when the next one comes: values grow when they are first used.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: OrderedDict[K, V] = OrderedDict()
        self._bytes: dict[K, int] = {}
        self._guard = Lock()

    def get(self, key: K, make: Callable[[], V]) -> V:
        """Return the value of a key, made where there is none; two threads may both make it, and get the first."""
        with self._guard:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        made = make()
        with self._guard:
            self._measure()
            value = self._values.setdefault(key, made)
            self._values.move_to_end(key)
            while sum(self._bytes.values()) > self._most and len(self._values) > 1:
                self._bytes.pop(self._values.popitem(last=False)[0], None)
        return value

    def clear(self) -> None:
        """Forget all values."""
        with self._guard:
            self._values.clear()
            self._bytes.clear()

    def _measure(self) -> None:
        for key, value in self._values.items():
            if key not in self._bytes:
                self._bytes[key] = bytes_of((key, value))


def kept(most: int) -> Callable[[Callable[P, V]], Callable[P, V]]:
    """Decorate a function of hashable arguments so that results of at most so many bytes are kept."""

    def decorate(function: Callable[P, V]) -> Callable[P, V]:
        results: Kept[Hashable, V] = Kept(most)

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> V:
            return results.get(_Arguments((*args, *kwargs.items())), lambda: function(*args, **kwargs))

        return call

    return decorate


class _Arguments(tuple[Any, ...]):
    """Arguments whose hash is computed once: that of a shape with many vertices takes longer than the search."""

    _hash: int | None = None

    def __hash__(self) -> int:
        if self._hash is None:
            self._hash = super().__hash__()
        return self._hash


def bytes_of(value: Any) -> int:
    """Return about how many bytes an object and all that it alone refers to take."""
    seen = set[int]()
    total, left = 0, [value]
    while left:
        item = left.pop()
        if isinstance(item, int | float | None):
            total += NUMBER
            continue
        if id(item) in seen or isinstance(item, NO_CONTENT):
            continue
        seen.add(id(item))
        total += sys.getsizeof(item)
        if isinstance(item, np.ndarray):
            total += item.nbytes if item.base is not None else 0  # else counted already
        elif isinstance(item, tuple | list) and all(isinstance(part, int | float) for part in item):
            total += NUMBER * len(item)
        elif isinstance(item, tuple | list | set | frozenset):
            left += item
        elif isinstance(item, Mapping):
            left += item.keys()
            left += item.values()
        elif not isinstance(item, str | bytes):
            left += vars(item).values() if hasattr(item, "__dict__") else ()
    return total
