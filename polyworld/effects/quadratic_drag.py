"""Force against the velocity, proportional to its square: fast motion through air."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions, unequal
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-p[0] * wp.length(b.v) * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="quadratic_drag",
    summary="F = -k |v| v, k = rho C_d A / 2",
    parameters={"coefficient": EffectParameter("kg/m", 0.0, 1e6, (0.0, 1.0), 0.0, "drag force per squared speed")},
    force=force,
    reference="Newton, Principia II; Batchelor, An Introduction to Fluid Dynamics, 5.11",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    free = {"coefficient": strength(found.force / found.speed**2, found.strongest_drag)}
    made = [Way(free, label="one coefficient for all bodies" if found.bodies > 1 else "")]
    # Of balls of several sizes, each may have its own coefficient of drag instead.
    return [*made, Way(free, each="body")] if found.bodies == 2 and not unequal(found.ball_radii) else made


ABSENCE = Absence(
    ways,
    signature="residual against the velocity, in proportion to its square",
    plain=True,
)
