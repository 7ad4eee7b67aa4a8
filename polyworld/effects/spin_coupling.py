"""Impacts that grip and spring back along the contact, so that spin and speed are exchanged: a superball."""

import warp as wp

from polyworld.effects.absence import Absence, FreeParameter, Way
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Vec8, passive


@wp.func
def tangential(p: Vec8) -> wp.vec3d:
    return wp.vec3d(wp.float64(0.0), p[0], p[1])


LAW = EffectLaw(
    kind="spin_coupling",
    summary="u' = -e_t u of the points that touch; Coulomb's limit does not hold. e_t = -1 or grip = 0: Coulomb alone",
    parameters={
        "restitution": EffectParameter(
            "1", -1.0, 1.0, (-1.0, 1.0), -1.0, "tangential restitution e_t; -1, and only that, for Coulomb friction"
        ),
        "grip": EffectParameter(
            "1", 0.0, 1.0, (0.0, 1.0), 1.0, "share g of this law: impulse (1 - g) Coulomb's + g (1 + e_t) m_eff u"
        ),
    },
    tangential=tangential,
    reference="Garwin (1969), Am. J. Phys. 37, 88; Cross (2002), Am. J. Phys. 70, 1093",
    work=passive,
    isotropic=True,
    falling=True,
)


GRIPS = (-0.6, -0.2, 0.2, 0.6)  # tangential restitutions to begin with


def ways(found: Conditions) -> list[Way]:
    if found.spin <= 0.0 or not found.impacts:
        return []  # what a grip does depends on spins, and nobody knows them
    # At -1 the law hands over to Coulomb's: values next to it are another world, so fits stay off it.
    free = {"restitution": FreeParameter(0.2, lower=-0.99)}
    return [Way(free, {"restitution": GRIPS[0]}, [{"restitution": grip} for grip in GRIPS])]


ABSENCE = Absence(
    ways,
    signature="kicks along the floor that follow the spin, beyond what Coulomb's law allows or short of it",
)
