"""Simulated collisions against annotated ones."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from polyworld.solver.rollout import rollout
from polyworld.world import World
from tests.scenes.clevrer_data import SECONDS_PER_FRAME, Collision

# A collision counts as found when the same pair meets within this many frames of the annotated one.
TOLERANCE = 3
# Touches of a pair that follow each other this closely are one collision, as in the annotations.
APART = 10


@dataclass(frozen=True)
class EventScore:
    """Counts of simulated, annotated and matched collisions."""

    simulated: int
    annotated: int
    matched: int

    def __add__(self, other: EventScore) -> EventScore:
        return EventScore(
            self.simulated + other.simulated, self.annotated + other.annotated, self.matched + other.matched
        )

    @property
    def precision(self) -> float:
        """Share of the simulated collisions that were annotated; NaN when there were none."""
        return self.matched / self.simulated if self.simulated else float("nan")

    @property
    def recall(self) -> float:
        """Share of the annotated collisions that were simulated; NaN when there are none."""
        return self.matched / self.annotated if self.annotated else float("nan")


def simulated_collisions(world: World, last_frame: int) -> list[Collision]:
    """Collisions of pairs of objects up to a frame, repeated touches within `APART` frames counted once."""
    result = rollout(world, last_frame * SECONDS_PER_FRAME)
    bodies = {o.name for o in world.objects}
    touches = [
        (event.time / world.time.seconds_per_frame, event.participants, event.kind == "contact_begin")
        for event in result.events
        if event.kind in ("contact_begin", "contact_end") and set(event.participants) <= bodies
    ]
    return collisions_of_touches(touches)


def collisions_of_touches(touches: Iterable[tuple[float, Sequence[str], bool]]) -> list[Collision]:
    """Collisions of touches (frame, pair, whether one may begin there), repetitions within `APART` counted once."""
    latest: dict[tuple[str, str], float] = {}
    found: list[Collision] = []
    for frame, pair, begin in sorted(touches, key=lambda touch: touch[0]):
        first, second = sorted(pair)
        begins = begin and frame - latest.get((first, second), -1e9) > APART
        latest[(first, second)] = frame
        if begins:
            found.append(Collision((first, second), round(frame)))
    return found


def score_collisions(simulated: list[Collision], annotated: list[Collision]) -> EventScore:
    """Match each annotated collision to at most one simulated one of its pair, nearest in time first."""
    free = list(simulated)
    matched = 0
    for truth in annotated:
        near = [c for c in free if c.pair == truth.pair and abs(c.frame - truth.frame) <= TOLERANCE]
        if near:
            free.remove(min(near, key=lambda c: abs(c.frame - truth.frame)))
            matched += 1
    return EventScore(len(simulated), len(annotated), matched)
