"""A cord from a fixed anchor to the centre of mass: it pulls beyond its length and never pushes."""

import warp as wp

from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench

_ANCHOR = EffectParameter("m", -1e6, 1e6, (-2.0, 2.0), 0.0, "coordinate of the anchor along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    arm = b.x - wp.vec3d(p[0], p[1], p[2])
    length = wp.length(arm)
    if length <= p[4] or length == wp.float64(0.0):
        return wp.spatial_vectord()
    along = arm / length
    tension = wp.max(p[3] * (length - p[4]) + p[5] * wp.dot(along, b.v), wp.float64(0.0))
    return wrench(-tension * along, wp.vec3d())


LAW = EffectLaw(
    kind="tether",
    summary="F = -max(0, k (r - L) + d dr/dt) away from the anchor where r > L",
    parameters={
        "anchor_x": _ANCHOR,
        "anchor_y": _ANCHOR,
        "anchor_z": _ANCHOR,
        "stiffness": EffectParameter("N/m", 0.0, 1e7, (0.0, 100.0), 0.0, "pull per stretch"),
        "rest_length": EffectParameter("m", 0.0, 1e6, (0.0, 2.0), 0.0, "distance up to which it is slack"),
        "damping": EffectParameter("kg/s", 0.0, 1e6, (0.0, 2.0), 0.0, "pull per speed of stretching, while it is taut"),
    },
    force=force,
    reference="Hooke (1678), De potentia restitutiva; a cord bears no compression",
)
