"""A place where what does not move rubs more, or less, than elsewhere: a wet spot, a rug.

Objects that meet there rub on each other as they do everywhere.
"""

import numpy as np
import warp as wp

from polyworld.effects.absence import Absence, FreeParameter, Way, coordinates, somewhere
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Vec8, passive

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
    work=passive,
    falling=True,
)


PLACES = 12
RADII = (0.15, 0.3, 0.8)  # of the spread of places
ROUGHEST = 1.0  # change of the coefficient that is ordinary: that of rubber on dry ground


def ways(found: Conditions) -> list[Way]:
    places = found.visited(PLACES, touching_only=True) if found.slides else np.zeros((0, 3))
    if not len(places) or not found.axes:
        return []
    size = float(np.linalg.norm(found.gravity))
    # A patch on a floor is a disc: its height is the floor's, a radius below the places where bodies touch.
    flat = found.axes if found.planar else found.across
    below = found.gravity / size * found.drop if size > 0.0 and not found.planar else np.zeros(3)
    widest = max(3.0 * found.spread, float(np.linalg.norm(found.upper - found.lower)))
    radius = FreeParameter(0.3 * found.spread, 0.02 * found.spread, widest, plausible=found.size, idle=True)
    free = {"friction": FreeParameter(0.1, -2.0, 2.0, plausible=ROUGHEST), "radius": radius}
    starts = [{"radius": share * found.spread} | coordinates("", place, flat) for place in places for share in RADII]
    values = coordinates("", np.median(places, axis=0) + below) | {"radius": RADII[1] * found.spread}
    return [Way(free | somewhere(found, flat, "", 0.75), values, starts)]


ABSENCE = Absence(
    ways,
    signature="deceleration that is different in one place, whatever the speed",
)
