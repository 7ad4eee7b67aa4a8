"""Ropes that start stretched: their strain energy throws what they hold as soon as the simulation begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polyworld.model.rope import threading
from polyworld.world import World
from polyworld.world.representations.rope import Rope

LEAST = 0.01  # strain from which on it is hardly meant: strings and cables are tightened by less


@dataclass(frozen=True)
class InitialStretch:
    """A rope longer along its way at the start than without tension: strain, tension [N] and length of the way [m]."""

    rope: str
    strain: float
    tension: float
    way: float

    def in_words(self) -> str:
        """Return the stretch as a clause, with what to do."""
        return (
            f"rope {self.rope!r} starts stretched by {100.0 * self.strain:.2g} %, with a tension of "
            f"{self.tension:.3g} N: give it length {self.way:.4g} (or none, for a start without tension), or shorten "
            "its way"
        )


def initial_stretches(world: World) -> tuple[InitialStretch, ...]:
    """Find the ropes that start stretched by more than LEAST, in their order in the world."""
    found = []
    for rope in world.of_form("line"):
        if isinstance(rope, Rope) and rope.length is not None:
            thread = threading(world, rope)
            strain = thread.stretch - 1.0
            if not thread.pulleys:
                strain = float(np.linalg.norm(np.diff(thread.nodes, axis=0), axis=1).sum()) / rope.length - 1.0
            if strain > LEAST:
                tension = rope.stretch_stiffness * strain
                found.append(InitialStretch(rope.name, strain, tension, rope.length * (1.0 + strain)))
    return tuple(found)
