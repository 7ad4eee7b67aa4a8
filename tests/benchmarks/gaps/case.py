"""Recorded motion with the effects that its base world lacks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.unknown import Unknown
from polyworld.world import World

NEEDED = 80.0  # noncentrality from which on an effect with three unknowns is seen with a probability of 0.95
Array = NDArray[np.float64]
Names = frozenset[str]
NOTHING = (Names(),)


@dataclass(frozen=True)
class Case:
    """A recording with its key.

    truths: sets of effects, each of which is a right answer; `NOTHING` where the world lacks none. outside: no law of
    the catalogue explains the motion, so that "unexplained" is right, too. alike: names that no data of this design
    distinguish, with the one that stands for them. level: noise over the range of motion. noncentrality: of the
    weakest effect. numbers, places: true parameters and places by effect. contaminated: runs that follow no law.
    """

    name: str
    world: World
    recording: Recording
    truths: tuple[Names, ...]
    outside: bool = False
    level: float | None = None
    held_out: Recording | None = None
    base: tuple[Unknown, ...] = ()
    candidates: tuple[str, ...] | None = None
    alike: Mapping[str, str] = field(default_factory=dict)
    noncentrality: float = np.inf
    numbers: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    places: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    contaminated: Names = field(default_factory=Names)

    @property
    def detectable(self) -> bool:
        """Whether the weakest effect stands out of the noise."""
        return self.noncentrality >= NEEDED

    def answer(self, names: Iterable[str]) -> Names:
        """Return a set of effects, those that are alike taken as one."""
        return Names(self.alike.get(n, n) for n in names)

    @property
    def answers(self) -> tuple[Names, ...]:
        """All right answers."""
        return tuple(self.answer(t) for t in self.truths)


def noncentrality(size: float, rows: int, correlation: float = 0.0) -> float:
    """Return the noncentrality of displacements of rms length `size` [noise], initial states refitted, at `rows`
    instants whose noise is correlated from one to the next: of slow motion (1 - phi) / (1 + phi) of them count."""
    return float(size**2 * rows * (1.0 - correlation) / (1.0 + correlation))


def one_body(name: str, times: Array, places: Array, spins: Array | None = None) -> Run:
    """Return a run of one body `ball`: times (T,), places (T, 3) and spins (T, 3), NaN where not measured."""
    turns = np.full((len(times), 1, 4), np.nan)
    measured = np.full((len(times), 3), np.nan) if spins is None else spins
    return Run(name, ("ball",), times, places[:, None], turns, angular_velocities=measured[:, None])


def ball(radius: float, mass: float, rate: float, restitution: float | None) -> World:
    """Return a world of one ball that knows no friction, with a level floor through the origin where it bounces."""
    body = {"name": "ball", "shape": {"kind": "sphere", "radius": radius}, "mass": mass, "position": [0, 0, 1]}
    bounce = {"restitution": restitution or 0.0}
    floors = [] if restitution is None else [{"name": "floor", "shape": {"kind": "plane"}} | bounce]
    fields = {"objects": [body | bounce | {"friction": 0.0}], "statics": floors}
    return World.model_validate(fields | {"time": {"seconds_per_frame": 1 / rate}})
