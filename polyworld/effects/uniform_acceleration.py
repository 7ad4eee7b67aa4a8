"""The same acceleration everywhere and always: a tilted table, an accelerating frame, a gravity error."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, Way, along, strength
from polyworld.effects.conditions import SHARE, Conditions, unequal
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_AXIS = EffectParameter("m/s^2", -1e4, 1e4, (-2.0, 2.0), 0.0, "acceleration along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(b.mass * wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the acceleration along the way."""
    return course.mass * size(p) * course.path


LAW = EffectLaw(
    kind="uniform_acceleration",
    summary="F = m (a_x, a_y, a_z)",
    parameters={"x": _AXIS, "y": _AXIS, "z": _AXIS},
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 39",
    work=work,
)


def ways(found: Conditions) -> list[Way]:
    if not found.across:
        return []
    steep = 0.5 * float(np.linalg.norm(found.gravity)) or None  # a slope of 30 degrees
    differ = unequal(found.masses) and not found.deformables  # else a force on all bodies would be the same
    label = "one acceleration of all bodies" if differ else ""
    return [Way(along(found.across, "", strength(SHARE * found.acceleration, steep)), label=label)]


ABSENCE = Absence(
    ways,
    effect="tilt",
    signature="residual in one direction that grows as the square of the time, the same in all runs",
    plain=True,
)
