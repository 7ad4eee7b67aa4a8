"""What is asked of an engine: scenes prepared once, run many times, and the motion of the last run."""

from __future__ import annotations

from typing import Protocol

from tests.benchmarks.peers.scenes import Motion, Scene


class UnsupportedError(Exception):
    """A scene that an engine does not take, and why."""


class Prepared(Protocol):
    """A scene in many worlds, ready to run: models, buffers and graphs are made."""

    def run(self) -> None:
        """Run all worlds from their initial state, with samples of all states kept at every interval."""

    def motion(self) -> Motion:
        """Return the motion of the first world in the last run."""


class Engine(Protocol):
    """An engine with its settings."""

    name: str

    def prepare(self, scene: Scene, worlds: int, interval: float, threads: int) -> Prepared:
        """Return a scene in so many worlds, sampled every `interval` [s]; UnsupportedError where it takes none."""
