"""A cord from a fixed anchor to the centre of mass: it pulls beyond its length and never pushes."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, FreeParameter, Way, coordinates, somewhere
from polyworld.effects.conditions import FAR, Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

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


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the largest stretch that there is within reach."""
    return p["stiffness"] * (course.reach + size(p, "anchor_")) * course.path


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
    work=work,
)


LENGTHS = (0.3, 0.5, 0.75)  # quantiles of the distance to the anchor that a length begins with


def ways(found: Conditions) -> list[Way]:
    if not found.axes:
        return []
    length = FreeParameter(0.3 * found.spread, upper=2.0 * FAR * found.size, plausible=2.0 * found.size, idle=True)
    free = {"stiffness": FreeParameter(2.0 * found.force / found.spread), "rest_length": length}
    starts = [
        {"rest_length": float(begin)} | coordinates("anchor_", place, found.axes)
        for place in found.flat_grid(3, margin=-0.25)
        for begin in np.quantile(found.distances(place), LENGTHS)
    ]
    anchor = somewhere(found, found.axes, "anchor_")
    return [Way(free | anchor, coordinates("anchor_", found.middle), starts)]


ABSENCE = Absence(
    ways,
    signature="residual that sets in at a distance from a point, towards it",
)
