"""Torque against the spin, as its square."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(wp.vec3d(), -p[0] * wp.length(b.omega) * b.omega)


LAW = EffectLaw(
    kind="spin_drag",
    summary="torque = -k |omega| omega",
    parameters={
        "coefficient": EffectParameter("kg m^2", 0.0, 1e6, (0.0, 0.001), 0.0, "torque per squared angular velocity")
    },
    force=force,
    reference="Sawatzki (1970), Acta Mech. 9, 159: a ball that turns fast, k = C_M rho R^5 / 2",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if not found.spin_shows:
        return []
    return [Way({"coefficient": strength(found.spin_decay / found.spin)}, label="as the square of the spin")]


ABSENCE = Absence(ways, effect="spin_damping")
