"""The result of reading another simulator's file returns."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.world import World


@dataclass(frozen=True)
class Imported:
    """A world read from a file, and a sentence for everything of the file that it does not hold, or holds otherwise."""

    world: World
    left_out: tuple[str, ...]
