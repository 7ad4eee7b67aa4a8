"""Sideways force on what moves in a rotating frame; the centrifugal force is left out."""

import warp as wp

from polyworld.effects.absence import Absence, Way, along, strength
from polyworld.effects.conditions import SHARE, Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench

_AXIS = EffectParameter("rad/s", -1e3, 1e3, (-2.0, 2.0), 0.0, "angular velocity of the frame about this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(-wp.float64(2.0) * b.mass * wp.cross(wp.vec3d(p[0], p[1], p[2]), b.v), wp.vec3d())


LAW = EffectLaw(
    kind="coriolis",
    summary="F = -2 m Omega x v, without the centrifugal force",
    parameters={"rotation_x": _AXIS, "rotation_y": _AXIS, "rotation_z": _AXIS},
    force=force,
    per_mass=True,
    reference="Landau & Lifshitz, Mechanics, 39; the centrifugal force, of second order in Omega, is left out",
    work=passive,
    falling=True,
)


FASTEST = 8.0  # at which what carries a scene ordinarily turns [rad/s]: a record of 78 turns a minute


def ways(found: Conditions) -> list[Way]:
    if len(found.axes) < 2:
        return []
    axes = [a for a in range(3) if not found.planar or a not in found.axes]
    return [Way(along(axes, "rotation_", strength(SHARE * found.acceleration / (2.0 * found.speed), FASTEST)))]


ABSENCE = Absence(
    ways,
    signature="residual across the velocity, to the same side whatever the heading",
)
