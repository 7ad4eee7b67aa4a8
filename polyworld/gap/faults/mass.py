"""Another mass of one body than the world's."""

from __future__ import annotations

from polyworld.data.recording import Recording
from polyworld.gap.adding import of_path, one_start
from polyworld.gap.candidate import Candidate, Variant
from polyworld.gap.conditions import conditions
from polyworld.world import World
from polyworld.world.parameters import object_mass
from polyworld.world.representations.rigid import RigidObject

RATIO = 30.0  # by which a mass may be wrong either way


def _mass(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    pairs = [*found.meetings, *((j.object, j.other) for j in world.joints if j.other is not None)]
    linked = [o for o in world.objects if any(o.name in pair for pair in pairs)]
    # Only ratios of masses show; where there are two, the second's stands for theirs.
    return tuple(_of(world, o) for o in (linked[1:] if len(linked) <= 2 else linked))


def _of(world: World, item: RigidObject) -> Variant:
    mass = object_mass(item)
    path = f"objects.{item.name}.mass"
    unknown = of_path(world, (path,), "mass", mass, 0.3 * mass, lower=mass / RATIO, upper=mass * RATIO)
    return one_start(world, (unknown,), f"of {item.name}")


CANDIDATES = (
    Candidate(
        name="mass_error",
        group="base",
        law="m' of one body, where masses share momentum",
        variants=_mass,
    ),
)
