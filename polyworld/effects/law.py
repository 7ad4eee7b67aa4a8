"""The one interface through which every effect is reached."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp

MAX_PARAMETERS = 8


class Vec8(wp.types.vector(length=MAX_PARAMETERS, dtype=wp.float64)):
    """Parameter values of one effect, in the order of `EffectLaw.parameters`; the rest is zero."""


@wp.func
def wrench(force: wp.vec3d, torque: wp.vec3d) -> wp.spatial_vectord:
    """Force and torque as one vector of six; Warp makes no spatial vector of two double vectors."""
    return wp.spatial_vectord(force[0], force[1], force[2], torque[0], torque[1], torque[2])


@dataclass(frozen=True)
class EffectParameter:
    """A number of a law: unit, admissible range, the range a fit searches, default, and what it means."""

    unit: str
    lower: float
    upper: float
    search: tuple[float, float]
    default: float
    description: str


@dataclass(frozen=True)
class EffectLaw:
    """A law of force on a rigid body.

    `force` is a Warp function (p: Vec8, mass, radius, x: vec3d, v: vec3d, omega: vec3d, t) -> spatial_vectord
    returning force [N] and torque [N m] about the centre of mass, both in world axes. radius [m] is that of
    the ball with the body's volume. `reference` is where the law is written down.
    """

    kind: str
    summary: str
    parameters: dict[str, EffectParameter]
    force: Any
    reference: str
