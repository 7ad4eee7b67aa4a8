"""A local jet: a constant force that fades as a Gaussian with the distance from its centre."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, FreeParameter, Way, along, coordinates, somewhere
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_FORCE = EffectParameter("N", -1e6, 1e6, (-2.0, 2.0), 0.0, "force at the centre along this world axis")
_CENTRE = EffectParameter("m", -1e6, 1e6, (-2.0, 2.0), 0.0, "coordinate of the centre along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    apart = b.x - wp.vec3d(p[3], p[4], p[5])
    share = wp.exp(-wp.dot(apart, apart) / (wp.float64(2.0) * p[6] * p[6]))
    return wrench(share * wp.vec3d(p[0], p[1], p[2]), wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the force at the centre."""
    return size(p, "force_") * course.path


LAW = EffectLaw(
    kind="fan",
    summary="F = f exp(-|x - c|^2 / (2 w^2))",
    parameters={
        "force_x": _FORCE,
        "force_y": _FORCE,
        "force_z": _FORCE,
        "centre_x": _CENTRE,
        "centre_y": _CENTRE,
        "centre_z": _CENTRE,
        "width": EffectParameter("m", 1e-3, 1e6, (0.05, 1.0), 0.3, "standard deviation w of the Gaussian"),
    },
    force=force,
    reference="Pope, Turbulent Flows, 5.1: the mean velocity across a turbulent jet is close to a Gaussian",
    work=work,
)


PLACES = 16
WIDTHS = (0.35, 0.9)  # of the spread of places
WIDEST = 2.0  # spreads: what is wider is no local jet
JET = 10.0  # largest ordinary speed of its air [m/s]


def ways(found: Conditions) -> list[Way]:
    if not found.axes:
        return []
    force = FreeParameter(2.0 * found.force, plausible=max(found.weight, found.plate_drag * JET**2))
    width = FreeParameter(
        0.3 * found.spread, 0.05 * found.spread, WIDEST * found.spread, plausible=found.size, idle=True
    )
    free = along(found.axes, "force_", force) | somewhere(found, found.axes, "centre_", 0.75) | {"width": width}
    starts = [
        {"width": share * found.spread} | coordinates("centre_", place, found.axes)
        for place in found.visited(PLACES)
        for share in WIDTHS
    ]
    return [Way(free, coordinates("centre_", found.middle) | {"width": WIDTHS[0] * found.spread}, starts)]


ABSENCE = Absence(
    ways,
    signature="a push in one direction on what passes one place",
)
