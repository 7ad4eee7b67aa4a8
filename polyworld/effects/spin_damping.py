"""Torque against the spin, proportional to it."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(wp.vec3d(), -p[0] * b.omega)


LAW = EffectLaw(
    kind="spin_damping",
    summary="torque = -c omega",
    parameters={"coefficient": EffectParameter("kg m^2/s", 0.0, 1e6, (0.0, 0.01), 0.0, "torque per angular velocity")},
    force=force,
    reference="Landau & Lifshitz, Fluid Mechanics, 20; c = 8 pi eta R^3 for a ball in slow flow",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if not found.spin_shows:
        return []
    return [Way({"coefficient": strength(found.spin_decay)}, label="in proportion to the spin")]


ABSENCE = Absence(
    ways,
    signature="a spin that decays in free motion; bounces that kick less the later they come",
)
