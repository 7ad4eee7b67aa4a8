"""Buoyancy and added mass of a body in a fluid, as they change its fall.

The law is a force, so added mass takes no part in impacts. In a fluid it would (Batchelor 6.4: impulses act on the
fluid too): an impact with the same restitution gives the same rebound, but friction then turns a ball faster by the
factor 1 + C r, and sticks at another speed. For a ball in air that is less than a part in a hundred.
"""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.effects.absence import Absence, FreeParameter, Way
from polyworld.effects.conditions import SHARE, Conditions
from polyworld.effects.law import Course, EffectLaw, EffectParameter, Motion, Parameters, Vec8, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    r = p[0]
    lost = r * (wp.float64(1.0) + p[1]) / (wp.float64(1.0) + p[1] * r)  # of the weight
    return wrench(-b.mass * lost * b.gravity, wp.vec3d())


def work(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return that of the weight which is lost, along the way."""
    r = p["density_ratio"]
    lost = r * (1.0 + p["added_mass_coefficient"]) / (1.0 + p["added_mass_coefficient"] * r)
    return course.mass * course.gravity * lost * course.path


LAW = EffectLaw(
    kind="buoyancy",
    summary="F = m (a - g), a = g (1 - r) / (1 + C r), r = rho_fluid / rho_body",
    parameters={
        "density_ratio": EffectParameter("1", 0.0, 1e3, (0.0, 0.9), 0.0, "density of the fluid over that of the body"),
        "added_mass_coefficient": EffectParameter(
            "1", 0.0, 10.0, (0.0, 1.0), 0.5, "added mass over displaced mass; 1/2 for a ball"
        ),
    },
    force=force,
    per_mass=True,
    reference="Batchelor, An Introduction to Fluid Dynamics, 6.8; exact while gravity is the only other force",
    work=work,
    isotropic=True,
)


def ways(found: Conditions) -> list[Way]:
    if not found.bodies or not any(abs(found.gravity[a]) > 1e-9 for a in found.axes):
        return []
    ratio = FreeParameter(SHARE / 1.5, upper=0.99, plausible=1.0)  # what falls is denser than the fluid
    same = ("gravity_error", "observer_clock") + (() if found.touches else ("observer_scale",))
    return [Way({"density_ratio": ratio}, same_as=same)]


ABSENCE = Absence(
    ways,
    signature="all that falls falls too slowly, by the same factor at all speeds",
)
