"""A deceleration proportional to the squared speed, whatever the mass: drag between bodies of equal ballistics."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Vec8, wrench


@wp.func
def force(
    p: Vec8, mass: wp.float64, radius: wp.float64, x: wp.vec3d, v: wp.vec3d, omega: wp.vec3d, t: wp.float64
) -> wp.spatial_vectord:
    return wrench(-mass * p[0] * wp.length(v) * v, wp.vec3d())


LAW = EffectLaw(
    kind="quadratic_damping",
    summary="F = -m c |v| v",
    parameters={
        "rate": EffectParameter("1/m", 0.0, 1e6, (0.0, 0.2), 0.0, "deceleration per squared speed"),
    },
    force=force,
    reference="Newton, Principia II, prop. 5: resistance as the squared speed; here per mass, as damping is",
)
