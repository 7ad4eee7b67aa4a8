"""A deceleration proportional to the speed, whatever the mass."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-b.mass * p[0] * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="linear_damping",
    summary="F = -m c v",
    parameters={
        "rate": EffectParameter("1/s", 0.0, 1e4, (0.0, 2.0), 0.0, "deceleration per speed"),
    },
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 25",
)
