"""Torque against the spin, proportional to it."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(wp.vec3d(), -p[0] * b.omega)


LAW = EffectLaw(
    kind="spin_damping",
    summary="torque = -c omega",
    parameters={
        "coefficient": EffectParameter("kg m^2/s", 0.0, 1e6, (0.0, 0.01), 0.0, "torque per angular velocity"),
    },
    force=force,
    reference="Landau & Lifshitz, Fluid Mechanics, 20; c = 8 pi eta R^3 for a ball in slow flow",
)
