"""The interface of all executors, and the one that runs pieces in the calling process."""

from __future__ import annotations

import hashlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from types import TracebackType
from typing import Self, TypeVar

import numpy as np

Piece = TypeVar("Piece")
Result = TypeVar("Result")
Progress = Callable[[int, int, float | None], None]
"""Called with pieces done, pieces in all and the estimated seconds left (None before the first is done)."""

TRIES = 3
"""Workers that a piece may lose before it is given up: a chance loss (memory that others took, a machine switched off)
hits the same piece three times in a row with the cube of its small probability; a piece that ends its process does so
every time."""


@dataclass(frozen=True)
class Failure:
    """A piece without a result. error: in one line; traceback: empty where its worker died; tries: how often it ran."""

    key: str
    error: str
    traceback: str = ""
    tries: int = 1


class FailedPiecesError(RuntimeError):
    """Pieces failed of whose results all were needed; `failures` holds them."""

    def __init__(self, failures: Iterable[Failure]) -> None:
        self.failures = tuple(failures)
        first = self.failures[0]
        others = f" ({len(self.failures) - 1} more failed)" if len(self.failures) > 1 else ""
        super().__init__(f"piece {first.key!r} failed: {first.error}{others}\n{first.traceback}".rstrip())


class Executor(ABC):
    """Apply a pure function to independent pieces, each with a key that is its own.

    The function and the pieces are pickled: the function stands at the top of a module (or is a `functools.partial` of
    one that does) and depends on its argument alone. A piece that raises becomes a `Failure`, and the rest go on. An
    executor runs one bag at a time. Leaving the iterator early, or an interruption of the calling thread
    (`polyworld.core.interruption`), drops the pieces that have not started and ends those that run. A piece is looked
    up in its mapping when a worker is free for it, so that a lazy mapping holds few in memory.
    """

    workers: int
    """How many pieces run at once."""

    def run(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece], *, progress: Progress | None = None
    ) -> Generator[tuple[str, Result | Failure]]:
        """Yield each key with its result or failure, as they complete."""
        begin = time.monotonic()
        if progress is not None:
            progress(0, len(pieces), None)
        with closing(self._outcomes(function, pieces)) as outcomes:
            for done, outcome in enumerate(outcomes, start=1):
                if progress is not None:
                    left = (time.monotonic() - begin) / done * (len(pieces) - done)
                    progress(done, len(pieces), left)
                yield outcome

    def map(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece], *, progress: Progress | None = None
    ) -> Generator[tuple[str, Result | Failure]]:
        """Yield each key with its result or failure in the order of the pieces, each as soon as all before are done."""
        waiting: dict[str, Result | Failure] = {}
        order = iter(tuple(pieces))
        following = next(order, None)
        with closing(self.run(function, pieces, progress=progress)) as outcomes:
            for key, outcome in outcomes:
                waiting[key] = outcome
                while following is not None and following in waiting:
                    yield following, waiting.pop(following)
                    following = next(order, None)

    @abstractmethod
    def _outcomes(
        self, function: Callable[[Piece], Result], pieces: Mapping[str, Piece]
    ) -> Generator[tuple[str, Result | Failure]]:
        """Yield outcomes as they complete; closing it ends what runs."""

    @abstractmethod
    def close(self) -> None:
        """End the workers."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def results(outcomes: Iterator[tuple[str, Result | Failure]]) -> dict[str, Result]:
    """Return the results by key, in the order of the outcomes; raises `FailedPiecesError` once all have been run."""
    found: dict[str, Result] = {}
    failures: list[Failure] = []
    for key, outcome in outcomes:
        if isinstance(outcome, Failure):
            failures.append(outcome)
        else:
            found[key] = outcome
    if failures:
        raise FailedPiecesError(failures)
    return found


def piece_seed(seed: int, key: str) -> np.random.SeedSequence:
    """Return the seed of a piece: a function of the run's seed and the piece's key, not of the order of pieces."""
    words = np.frombuffer(hashlib.sha256(key.encode()).digest(), dtype="<u4")
    return np.random.SeedSequence(seed, spawn_key=tuple(int(w) for w in words))
