"""A place where what does not move rubs more, or less, than elsewhere: a wet spot, a rug.

Objects that meet there rub on each other as they do everywhere.
"""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Vec8

ALONG = wp.float64(1.0e-12)  # way [m] that counts as none

_CENTRE = EffectParameter("m", -1e6, 1e6, (-5.0, 5.0), 0.0, "centre of the patch along this world axis")


@wp.func
def part_inside(centre: wp.vec3d, radius: wp.float64, x: wp.vec3d, way: wp.vec3d) -> wp.float64:
    """Part of a straight way, with its middle at x, that lies within a ball."""
    half = wp.float64(0.5)
    beside = x - centre
    below = wp.length_sq(beside) - radius * radius
    square = wp.length_sq(way)
    if square < ALONG * ALONG:
        return wp.where(below < wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
    b = wp.dot(way, beside)
    root = b * b - square * below
    if root <= wp.float64(0.0):
        return wp.float64(0.0)
    root = wp.sqrt(root)
    return wp.clamp((root - b) / square, -half, half) - wp.clamp((-root - b) / square, -half, half)


@wp.func
def friction(p: Vec8, mu: wp.float64, x: wp.vec3d, way: wp.vec3d) -> wp.float64:
    inside = part_inside(wp.vec3d(p[0], p[1], p[2]), p[3], x, way)
    return mu + (wp.max(mu + p[4], wp.float64(0.0)) - mu) * inside


LAW = EffectLaw(
    kind="friction_patch",
    summary="mu' = mu + d on statics within a ball; on a floor, a disc",
    parameters={
        "x": _CENTRE,
        "y": _CENTRE,
        "z": _CENTRE,
        "radius": EffectParameter("m", 0.0, 1e6, (0.05, 2.0), 0.0, "radius of the patch"),
        "friction": EffectParameter("1", -10.0, 10.0, (-0.5, 0.5), 0.0, "added to the Coulomb coefficient inside"),
    },
    friction=friction,
    reference="Coulomb (1785), with a coefficient that depends on the place",
)
