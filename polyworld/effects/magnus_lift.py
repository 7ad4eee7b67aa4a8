"""Sideways force on a spinning body that moves through a fluid."""

import numpy as np
import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import AIR, Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(p[0] * wp.cross(b.omega, b.v), wp.vec3d())


LAW = EffectLaw(
    kind="magnus_lift",
    summary="F = s (omega x v)",
    parameters={"coefficient": EffectParameter("kg", -1e6, 1e6, (-0.1, 0.1), 0.0, "lift per spin and speed")},
    force=force,
    reference="Rubinow & Keller (1961), J. Fluid Mech. 11, 447; s = pi rho R^3 for slow flow past a ball",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if found.spin <= 0.0:
        return []
    per_coefficient = found.speed * max(found.spin, 1.0)
    # Twice that of slow flow past a ball in air; in liquids, as much lift as weight.
    most = max(2.0 * np.pi * AIR * found.radius**3, found.weight / per_coefficient)
    return [Way({"coefficient": strength(found.force / per_coefficient, most)})]


ABSENCE = Absence(
    ways,
    signature="residual across both spin and velocity",
    plain=True,
)
