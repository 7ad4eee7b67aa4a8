"""A share of the sliding speed lost at every impact, whatever the spin: soft, dusty or grassy ground."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Vec8, passive


@wp.func
def tangential(p: Vec8) -> wp.vec3d:
    return wp.vec3d(p[0], wp.float64(-1.0), wp.float64(0.0))


LAW = EffectLaw(
    kind="bounce_friction",
    summary="an impact takes the share f of the centres' relative velocity along the contact, after Coulomb friction",
    parameters={
        "share": EffectParameter("1", 0.0, 1.0, (0.0, 0.5), 0.0, "part of the tangential velocity that is lost")
    },
    tangential=tangential,
    reference="Brody (1984), Phys. Teach. 22, 494: so a bounce with sliding does at one angle; here at all",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    return [Way({"share": strength(0.05, 0.5)})] if found.impacts else []  # grass and clay take up to about half


ABSENCE = Absence(
    ways,
    signature="the same share of the speed along the floor is lost at every impact",
)
