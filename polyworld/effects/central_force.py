"""Attraction by a fixed point, a power of the distance."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, FreeParameter, Way, coordinates, somewhere
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_CENTRE = EffectParameter("m", -1e6, 1e6, (-2.0, 2.0), 0.0, "coordinate of the centre along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    arm = b.x - wp.vec3d(p[0], p[1], p[2])
    r = wp.sqrt(wp.dot(arm, arm) + p[5] * p[5])
    return wrench(-p[3] * wp.pow(r, p[4] - wp.float64(1.0)) * arm, wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the force where it is largest: furthest from the centre or, as it falls, in the softened core."""
    far = course.reach + size(p, "centre_") + p["softening"]
    return abs(p["strength"]) * max(far ** p["exponent"], p["softening"] ** p["exponent"]) * course.path


LAW = EffectLaw(
    kind="central_force",
    summary="F = -s (r^2 + q^2)^((n - 1) / 2) r: s r^n towards the centre, softened within q",
    parameters={
        "centre_x": _CENTRE,
        "centre_y": _CENTRE,
        "centre_z": _CENTRE,
        "strength": EffectParameter("N", -1e6, 1e6, (-2.0, 2.0), 0.0, "pull at a distance of 1 m; negative repels"),
        "exponent": EffectParameter("1", -4.0, 4.0, (-3.0, 2.0), -2.0, "power of the distance"),
        "softening": EffectParameter(
            "m", 1e-6, 1e3, (0.005, 0.05), 0.01, "distance within which the force falls to zero, so that it is finite"
        ),
    },
    force=force,
    reference="Newton, Principia I, prop. 10 and 11; softened as by Plummer (1911), Mon. Not. R. Astron. Soc. 71, 460",
    work=work,
)


EXPONENTS = (-2.0, -1.0)  # to begin with
FALLING = -0.2  # largest exponent: forces that do not fall with the distance are springs, or uniform
ORDINARY_POWERS = 2.0  # powers beside the inverse square that are ordinary: from a line's field to a dipole's


def ways(found: Conditions) -> list[Way]:
    if not found.axes:
        return []
    apart, softening = 2.0 * found.spread, 0.02 * found.spread
    free = {
        "strength": FreeParameter(found.force * max(apart, apart**2)),
        "exponent": FreeParameter(0.5, upper=FALLING, plausible=ORDINARY_POWERS, idle=True),
    } | somewhere(found, found.axes, "centre_")
    starts = [
        {"exponent": power} | coordinates("centre_", place, found.axes)
        for place in found.flat_grid(4, margin=0.1)
        if found.distances(place).min() >= 5.0 * softening  # else it is a pole on a path
        for power in EXPONENTS
    ]
    return [Way(free, coordinates("centre_", found.middle) | {"softening": softening}, starts)]


ABSENCE = Absence(
    ways,
    signature="residual towards, or away from, one point, stronger the nearer it is",
)
