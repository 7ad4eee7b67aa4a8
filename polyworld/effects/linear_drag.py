"""Force against the velocity, proportional to it: slow motion in a viscous fluid."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions, unequal
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-p[0] * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="linear_drag",
    summary="F = -c v",
    parameters={"coefficient": EffectParameter("kg/s", 0.0, 1e6, (0.0, 2.0), 0.0, "drag force per speed")},
    force=force,
    reference="Stokes (1851); c = 6 pi eta R for a ball",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    # A body that falls through a liquid soon falls evenly: there, its weight is the drag at the speeds seen.
    free = {"coefficient": strength(found.force / found.speed, found.weight / found.speed)}
    label = "one coefficient for all bodies" if unequal(found.masses) else ""
    same = ("viscous_friction",) if found.supported else ()
    made = [Way(free, label=label, same_as=same)]
    return [*made, Way(free, each="body")] if found.bodies == 2 else made


ABSENCE = Absence(
    ways,
    signature="residual against the velocity, in proportion to it",
    plain=True,
)
