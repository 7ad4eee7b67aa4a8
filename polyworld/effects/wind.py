"""Quadratic drag relative to air that moves."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, FreeParameter, Way, along, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, size, wrench

_AXIS = EffectParameter("m/s", -300.0, 300.0, (-5.0, 5.0), 0.0, "velocity of the air along this world axis")


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    through = b.v - wp.vec3d(p[1], p[2], p[3])
    return wrench(-p[0] * wp.length(through) * through, wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the drag at twice the wind's speed: faster bodies are slowed whichever way they go."""
    return 4.0 * p["coefficient"] * size(p, "velocity_") ** 2 * course.path


LAW = EffectLaw(
    kind="wind",
    summary="F = -k |v - u| (v - u), k = rho C_d A / 2",
    parameters={
        "coefficient": EffectParameter(
            "kg/m", 0.0, 1e6, (0.0, 1.0), 0.0, "drag force per squared speed through the air"
        ),
        "velocity_x": _AXIS,
        "velocity_y": _AXIS,
        "velocity_z": _AXIS,
    },
    force=force,
    reference="Batchelor, An Introduction to Fluid Dynamics, 5.11; drag depends on the velocity relative to the fluid",
    work=work,
    falling=True,
)


WINDS = (1.0, 3.0)  # speeds of the air to begin with, in typical speeds of the bodies
BREEZE = 10.0  # largest ordinary speed of the air [m/s], a fresh breeze, where bodies are slower than that


def ways(found: Conditions) -> list[Way]:
    if not found.axes:
        return []
    up = [a for a in found.axes if a not in found.across]
    if not found.across or not up:
        return [_along(found, found.axes, found.axes, "")]
    return [
        _along(found, found.across, found.across, "along the ground"),
        _along(found, found.axes, up, "of any direction"),
    ]


def _along(found: Conditions, axes: Sequence[int], begin: Sequence[int], label: str) -> Way:
    """Wind with components along `axes`; fits begin in still air and with wind along each of `begin`."""
    air = FreeParameter(found.speed, plausible=max(BREEZE, found.fastest), idle=True)
    free = {"coefficient": strength(found.force / found.speed**2, found.strongest_drag)}
    starts: list[dict[str, float]] = [{}]
    for a in begin:
        for speed in WINDS:
            starts += [{f"velocity_{'xyz'[a]}": sign * speed * found.speed} for sign in (1.0, -1.0)]
    return Way(free | along(axes, "velocity_", air), starts=starts, label=label)


ABSENCE = Absence(
    ways,
    signature="a push in one direction, stronger on what moves against it",
)
