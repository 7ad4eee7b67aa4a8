"""Sideways force on a spinning body that moves through a fluid."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(p[0] * wp.cross(b.omega, b.v), wp.vec3d())


LAW = EffectLaw(
    kind="magnus_lift",
    summary="F = s (omega x v)",
    parameters={
        "coefficient": EffectParameter("kg", -1e6, 1e6, (-0.1, 0.1), 0.0, "lift per spin and speed"),
    },
    force=force,
    reference="Rubinow & Keller (1961), J. Fluid Mech. 11, 447; s = pi rho R^3 for slow flow past a ball",
)
