"""Locks between processes, so that of those that share a cache of kernels one compiles and the others read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path


@contextmanager
def one_process_at_a_time(folder: Path, names: Iterable[str]) -> Iterator[None]:
    """Hold a lock file of each name in a folder; without locks where the system or the folder allows none."""
    if find_spec("fcntl") is None:  # Windows: each process compiles for itself
        yield
        return
    fcntl = import_module("fcntl")
    with ExitStack() as held:
        for name in sorted(set(names)):  # in one order everywhere, so that no two wait for each other
            try:
                file = held.enter_context((folder / f"{name}.lock").open("a"))
                fcntl.flock(file, fcntl.LOCK_EX)
            except OSError:
                break
        yield
