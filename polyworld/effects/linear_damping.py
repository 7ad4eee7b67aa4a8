"""A deceleration proportional to the speed, whatever the mass."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions, unequal
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-b.mass * p[0] * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="linear_damping",
    summary="F = -m c v",
    parameters={"rate": EffectParameter("1/s", 0.0, 1e4, (0.0, 2.0), 0.0, "deceleration per speed")},
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 25",
    work=passive,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if not unequal(found.masses):
        return []
    free = {"rate": strength(found.force / found.speed / found.mass, found.weight / found.speed / found.mass)}
    same = ("viscous_friction",) if found.supported else ()
    return [Way(free, label="one coefficient per mass", same_as=same)]


ABSENCE = Absence(ways, effect="linear_drag")
