"""Drag of a ball by its coefficient, so that bodies of several sizes share one number."""

import numpy as np
import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import AIR, Conditions, unequal
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    area = wp.float64(wp.pi) * b.radius * b.radius
    return wrench(-wp.float64(0.5) * p[1] * p[0] * area * wp.length(b.v) * b.v, wp.vec3d())


LAW = EffectLaw(
    kind="air_drag",
    summary="F = -rho C_d pi R^2 |v| v / 2",
    parameters={
        "drag_coefficient": EffectParameter(
            "1", 0.0, 100.0, (0.0, 2.0), 0.0, "C_d; 0.4 to 0.5 for a smooth ball in air at ordinary speeds"
        ),
        "air_density": EffectParameter(
            "kg/m^3", 0.0, 2e4, (0.9, 1.3), 1.2, "density of the air, or whatever the body moves through"
        ),
    },
    force=force,
    reference="Batchelor, An Introduction to Fluid Dynamics, 5.11; R is that of the ball of equal volume",
    work=passive,
    falling=True,
)


MOST_BODIES = 4  # that are given a coefficient each


def ways(found: Conditions) -> list[Way]:
    if not unequal(found.ball_radii):
        return []
    per_coefficient = 0.5 * AIR * np.pi * float(np.median(found.ball_radii)) ** 2  # [kg/m]
    typical, plausible = found.force / found.speed**2 / per_coefficient, found.strongest_drag / per_coefficient
    free = {"drag_coefficient": strength(typical, plausible)}
    made = [Way(free, label="one drag coefficient, by area")]
    return [*made, Way(free, each="body")] if found.bodies <= MOST_BODIES else made


ABSENCE = Absence(ways, effect="quadratic_drag")
