"""Quadratic drag relative to air that moves."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench

_AXIS = EffectParameter("m/s", -300.0, 300.0, (-5.0, 5.0), 0.0, "velocity of the air along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    through = b.v - wp.vec3d(p[1], p[2], p[3])
    return wrench(-p[0] * wp.length(through) * through, wp.vec3d())


LAW = EffectLaw(
    kind="wind",
    summary="F = -k |v - u| (v - u), k = rho C_d A / 2",
    parameters={
        "coefficient": EffectParameter(
            "kg/m", 0.0, 1e6, (0.0, 1.0), 0.0, "drag force per squared speed through the air"
        ),
        "velocity_x": _AXIS,
        "velocity_y": _AXIS,
        "velocity_z": _AXIS,
    },
    force=force,
    reference="Batchelor, An Introduction to Fluid Dynamics, 5.11; drag depends on the velocity relative to the fluid",
)
