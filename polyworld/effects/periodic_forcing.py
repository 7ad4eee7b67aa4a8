"""An acceleration that swings with time, the same everywhere: a shaken frame."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench

_AXIS = EffectParameter("m/s^2", -1e4, 1e4, (-2.0, 2.0), 0.0, "amplitude of the acceleration along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    wave = wp.sin(wp.float64(2.0 * wp.pi) * p[3] * b.t + p[4])
    return wrench(b.mass * wave * wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


LAW = EffectLaw(
    kind="periodic_forcing",
    summary="F = m A sin(2 pi f t + phi)",
    parameters={
        "amplitude_x": _AXIS,
        "amplitude_y": _AXIS,
        "amplitude_z": _AXIS,
        "frequency": EffectParameter("Hz", 0.0, 1e3, (0.2, 10.0), 1.0, "oscillations per second"),
        "phase": EffectParameter("rad", -7.0, 7.0, (-3.15, 3.15), 0.0, "phase at time 0"),
    },
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 22 and 39",
)
