"""A spring with a damper, from a fixed anchor to the centre of mass."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, FreeParameter, Way, coordinates, somewhere
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_ANCHOR = EffectParameter("m", -1e6, 1e6, (-2.0, 2.0), 0.0, "coordinate of the anchor along this world axis")
NOWHERE = wp.constant(wp.float64(1.0e-12))  # distance from the anchor [m]


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    arm = b.x - wp.vec3d(p[0], p[1], p[2])
    length = wp.length(arm)
    along = wp.vec3d()  # at the anchor no direction is preferred: a spring with a rest length pushes nowhere
    if length > NOWHERE:
        along = arm / length
    tension = p[3] * (length - p[4]) + p[5] * wp.dot(along, b.v)
    return wrench(-tension * along, wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the largest stretch, or compression, that there is within reach."""
    return p["stiffness"] * (course.reach + size(p, "anchor_") + p["rest_length"]) * course.path


LAW = EffectLaw(
    kind="spring",
    summary="F = -(k (r - L) + d dr/dt) away from the anchor",
    parameters={
        "anchor_x": _ANCHOR,
        "anchor_y": _ANCHOR,
        "anchor_z": _ANCHOR,
        "stiffness": EffectParameter("N/m", 0.0, 1e7, (0.0, 20.0), 0.0, "pull per stretch"),
        "rest_length": EffectParameter("m", 0.0, 1e6, (0.0, 2.0), 0.0, "distance at which it neither pulls nor pushes"),
        "damping": EffectParameter("kg/s", 0.0, 1e6, (0.0, 2.0), 0.0, "pull per speed of stretching"),
    },
    force=force,
    reference="Hooke (1678), De potentia restitutiva; Landau & Lifshitz, Mechanics, 21 and 25",
    work=work,
)


def ways(found: Conditions) -> list[Way]:
    if not found.axes:
        return []
    free = {"stiffness": FreeParameter(found.force / found.spread)} | somewhere(found, found.axes, "anchor_")
    # The pull of a spring without rest length is linear in stiffness and anchor: few places suffice.
    corners = [2] * len(found.axes)
    places = [*found.grid(corners), found.middle, *found.grid(corners, margin=1.0)]
    starts = [coordinates("anchor_", place, found.axes) for place in places]
    return [Way(free, coordinates("anchor_", found.middle), starts)]


ABSENCE = Absence(
    ways,
    signature="residual towards one point, in proportion to the distance from it",
)
