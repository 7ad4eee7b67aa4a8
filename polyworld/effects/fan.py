"""A local jet: a constant force that fades as a Gaussian with the distance from its centre."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench

_FORCE = EffectParameter("N", -1e6, 1e6, (-2.0, 2.0), 0.0, "force at the centre along this world axis")
_CENTRE = EffectParameter("m", -1e6, 1e6, (-2.0, 2.0), 0.0, "coordinate of the centre along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    apart = b.x - wp.vec3d(p[3], p[4], p[5])
    share = wp.exp(-wp.dot(apart, apart) / (wp.float64(2.0) * p[6] * p[6]))
    return wrench(share * wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


LAW = EffectLaw(
    kind="fan",
    summary="F = f exp(-|x - c|^2 / (2 w^2))",
    parameters={
        "force_x": _FORCE,
        "force_y": _FORCE,
        "force_z": _FORCE,
        "centre_x": _CENTRE,
        "centre_y": _CENTRE,
        "centre_z": _CENTRE,
        "width": EffectParameter("m", 1e-3, 1e6, (0.05, 1.0), 0.3, "standard deviation w of the Gaussian"),
    },
    force=force,
    reference="Pope, Turbulent Flows, 5.1: the mean velocity across a turbulent jet is close to a Gaussian",
)
