"""Sideways force on a body that spins as nobody saw."""

import warp as wp

from polyworld.effects.absence import Absence, Way, along, strength
from polyworld.effects.conditions import SHARE, Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, passive, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    return wrench(b.mass * wp.cross(wp.vec3d(p[0], p[1], p[2]), b.v), wp.vec3d())


RATE = "lift per mass and speed: the spin times the lift's coefficient over the mass; fitted for each run by itself"

LAW = EffectLaw(
    kind="unseen_spin_lift",
    summary="F = m (b x v), b = s omega / m",
    parameters={
        f"rate_{axis}": EffectParameter("1/s", -1e4, 1e4, (-2.0, 2.0), 0.0, f"{RATE}, along {axis}") for axis in "xyz"
    },
    force=force,
    reference="Rubinow & Keller (1961), J. Fluid Mech. 11, 447, for a spin that stays as it is",
    work=passive,
    falling=True,
)


MOST_FLIGHTS = 16  # each has three numbers of its own


def ways(found: Conditions) -> list[Way]:
    flights = sum(map(len, found.unturned.values()))
    # Contacts change spins, and known spins are those of Magnus lift.
    if found.planar or found.touches or found.spin > 0.0 or not 0 < flights <= MOST_FLIGHTS:
        return []
    rate = strength(SHARE * found.acceleration / found.speed, found.acceleration / found.speed)
    # In a single flight, axes that turn do what a spin of its own does.
    same = ("coriolis",) if flights == 1 else ()
    label = "by spins that nobody measured, of each run its own"
    return [Way(along((0, 1, 2), "rate_", rate), each="run", label=label, same_as=same)]


ABSENCE = Absence(ways, effect="magnus_lift")
