"""A deceleration proportional to the squared speed, whatever the mass: drag between bodies of equal ballistics."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions, unequal
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-b.mass * p[0] * wp.length(b.v) * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="quadratic_damping",
    summary="F = -m c |v| v",
    parameters={"rate": EffectParameter("1/m", 0.0, 1e6, (0.0, 0.2), 0.0, "deceleration per squared speed")},
    force=force,
    per_mass=True,
    reference="Newton, Principia II, prop. 5: resistance as the squared speed; here per mass, as damping is",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if not found.bodies or not unequal(found.masses):
        return []
    free = {"rate": strength(found.force / found.speed**2 / found.mass, found.strongest_drag / found.mass)}
    return [Way(free, label="one coefficient per mass")]


ABSENCE = Absence(ways, effect="quadratic_drag")
