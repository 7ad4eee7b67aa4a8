"""Force against the velocity, proportional to it: slow motion in a viscous fluid."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-p[0] * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="linear_drag",
    summary="F = -c v",
    parameters={
        "coefficient": EffectParameter("kg/s", 0.0, 1e6, (0.0, 2.0), 0.0, "drag force per speed"),
    },
    force=force,
    reference="Stokes (1851); c = 6 pi eta R for a ball",
)
