"""Rebounds that get weaker with the speed of approach, as bodies lose more in harder impacts."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Vec8, passive


@wp.func
def restitution(p: Vec8, e: wp.float64, speed: wp.float64) -> wp.float64:
    return e / (wp.float64(1.0) + p[0] * speed)


LAW = EffectLaw(
    kind="restitution_speed",
    summary="e(v) = e0 / (1 + k v)",
    parameters={
        "rate": EffectParameter("s/m", 0.0, 1e3, (0.0, 0.5), 0.0, "relative loss of restitution per approach speed")
    },
    restitution=restitution,
    reference="Hunt & Crossley (1975), J. Appl. Mech. 42, 440, to first order in the speed: e = 1 - k v where e0 is 1",
    work=passive,
    isotropic=True,
    falling=True,
)


def ways(found: Conditions) -> list[Way]:
    if not found.impacts:
        return []
    return [Way({"rate": strength(0.1 / found.speed, 1.0 / found.fastest)})]  # the fastest impact loses half


ABSENCE = Absence(
    ways,
    signature="rebounds from high drops too weak, from low ones right",
)
