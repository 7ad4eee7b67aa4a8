"""The same acceleration everywhere and always: a tilted table, an accelerating frame, a gravity error."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench

_AXIS = EffectParameter("m/s^2", -1e4, 1e4, (-2.0, 2.0), 0.0, "acceleration along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(b.mass * wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


LAW = EffectLaw(
    kind="uniform_acceleration",
    summary="F = m (a_x, a_y, a_z)",
    parameters={"x": _AXIS, "y": _AXIS, "z": _AXIS},
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 39",
)
