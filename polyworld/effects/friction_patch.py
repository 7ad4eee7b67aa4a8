"""A place where contacts rub more, or less, than elsewhere: a wet spot, a rug."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Vec8

EDGE = wp.float64(0.1)  # width over which the coefficient changes, of the radius
SMALLEST = wp.float64(1.0e-9)  # radius that counts as none [m]

_CENTRE = EffectParameter("m", -1e6, 1e6, (-5.0, 5.0), 0.0, "centre of the patch along this world axis")


@wp.func
def friction(p: Vec8, mu: wp.float64, x: wp.vec3d) -> wp.float64:
    distance = wp.length(x - wp.vec3d(p[0], p[1], p[2]))
    width = EDGE * wp.max(p[3], SMALLEST)
    s = wp.clamp((p[3] - distance) / width + wp.float64(0.5), wp.float64(0.0), wp.float64(1.0))
    inside = s * s * (wp.float64(3.0) - wp.float64(2.0) * s)
    return wp.max(mu + p[4] * inside, wp.float64(0.0))


LAW = EffectLaw(
    kind="friction_patch",
    summary="mu' = mu + d within a ball, over an edge of a tenth of its radius; on a floor, a disc",
    parameters={
        "x": _CENTRE,
        "y": _CENTRE,
        "z": _CENTRE,
        "radius": EffectParameter("m", 0.0, 1e6, (0.05, 2.0), 0.0, "radius of the patch"),
        "friction": EffectParameter("1", -10.0, 10.0, (-0.5, 0.5), 0.0, "added to the Coulomb coefficient inside"),
    },
    friction=friction,
    reference="Coulomb (1785), with a coefficient that depends on the place; edge s^2 (3 - 2 s)",
)
