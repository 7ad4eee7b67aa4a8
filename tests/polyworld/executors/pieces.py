"""Tiny pure functions that the tests of executors run."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polyworld.executors import piece_seed


def noise(key: str) -> np.ndarray:
    """Return numbers that depend on the key alone."""
    return np.random.default_rng(piece_seed(3, key)).normal(size=5)


def half(value: int) -> float:
    """Fail for odd values."""
    if value % 2:
        raise ValueError(f"{value} is odd")
    return value / 2


@dataclass(frozen=True)
class Marked:
    """A piece that writes down, in a file of its own, every time it is started; `deaths`: as often its process dies."""

    file: Path
    deaths: int = 0


def die_at_first(piece: Marked) -> int:
    """Return the number of times that the piece was started."""
    with piece.file.open("a") as file:
        file.write("x")
    started = len(piece.file.read_text())
    if started <= piece.deaths:
        os.kill(os.getpid(), signal.SIGKILL)
    return started


def unpicklable(_: int) -> object:
    """Return what cannot be sent back."""
    return threading.Lock()


def wait_for(file: Path) -> int:
    """Write own process's identifier, and wait to be ended."""
    file.with_suffix(".part").write_text(str(os.getpid()))
    file.with_suffix(".part").replace(file)
    signal.pause()
    return 0


def threads(_: int) -> list[str | None]:
    """Return the limits of threads in the process."""
    return [os.environ.get(n) for n in ("OMP_NUM_THREADS", "POLYWORLD_THREADS")]
