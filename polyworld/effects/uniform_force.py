"""A constant force, whatever the mass."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, Way, along, strength
from polyworld.effects.conditions import Conditions, unequal
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_AXIS = EffectParameter("N", -1e6, 1e6, (-2.0, 2.0), 0.0, "force along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the force along the way."""
    return size(p) * course.path


LAW = EffectLaw(
    kind="uniform_force",
    summary="F = (f_x, f_y, f_z)",
    parameters={"x": _AXIS, "y": _AXIS, "z": _AXIS},
    force=force,
    reference="Newton, Principia I, law 2",
    work=work,
)


def ways(found: Conditions) -> list[Way]:
    if not found.across or found.deformables or not unequal(found.masses):
        return []
    free = along(found.across, "", strength(found.force, 0.5 * found.weight))
    return [Way(free, label="one force on all bodies")]


ABSENCE = Absence(ways, effect="tilt")
