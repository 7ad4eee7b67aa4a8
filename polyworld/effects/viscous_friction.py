"""Force against the velocity, proportional to it, while the body is in contact: lubricated sliding."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-p[0] * b.contact * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="viscous_friction",
    summary="F = -c v while in contact",
    parameters={"coefficient": EffectParameter("kg/s", 0.0, 1e6, (0.0, 2.0), 0.0, "friction force per speed")},
    force=force,
    reference="Olsson, Astrom, Canudas de Wit, Gafvert & Lischinsky (1998), Eur. J. Control 4, 176",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if not found.slides:
        return []
    same = ("linear_drag",) if found.supported else ()
    # A film that resists with more than the weight would carry the body along.
    free = {"coefficient": strength(found.force / found.speed, found.weight / found.speed)}
    return [Way(free, same_as=same)]


ABSENCE = Absence(
    ways,
    signature="deceleration in contact that grows with the speed; none in flight",
    plain=True,
)
