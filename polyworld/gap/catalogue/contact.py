"""What may be missing from contacts: restitution that falls with speed, losses along the contact, grip, patches."""

from __future__ import annotations

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.catalogue.adding import RIGID, effect, neutral, of_effect, with_effects
from polyworld.gap.catalogue.force import one_effect
from polyworld.gap.conditions import conditions
from polyworld.gap.places import visited_places
from polyworld.recording import Recording
from polyworld.world import World

GRIPS = (-0.6, -0.2, 0.2, 0.6)  # tangential restitutions to begin with
PATCHES = 12
PATCH_RADII = (0.3, 0.8)  # of the spread of places


def _restitution_speed(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not (found.bounces or found.meetings):
        return ()
    return (one_effect(world, "restitution_speed", {"rate": 0.1 / found.speed}),)


def _bounce_friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not (found.bounces or found.meetings):
        return ()
    return (one_effect(world, "bounce_friction", {"share": 0.05}),)


def _spin_coupling(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if found.spin <= 0.0 or not (found.bounces or found.meetings):
        return ()  # what a grip does depends on spins, and nobody knows them
    # At -1 the law hands over to Coulomb's: values next to it are another world, so fits stay off it.
    added = effect(world, "spin_coupling", {"restitution": GRIPS[0]})
    unknown = of_effect(added, "restitution", 0.2, lower=-0.99)
    starts = tuple({"restitution": value} for value in GRIPS)
    return (Variant(with_effects(world, added), (unknown,), starts),)


def _friction_patch(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    places = visited_places(world, recording, PATCHES, touching_only=True) if found.touches else np.zeros((0, 3))
    if not world.objects or not found.slides or not len(places) or not found.axes:
        return ()
    gravity = np.abs(np.asarray(world.environment.gravity))
    # A patch on a floor is a disc: its height is the floor's, a radius below the places where bodies touch.
    flat = [a for a in found.axes if world.planar or a != int(np.argmax(gravity)) or gravity.max() == 0.0]
    height = {"xyz"[a]: float(np.median(places[:, a])) - (0.0 if world.planar else _drop(world, a)) for a in range(3)}
    added = effect(world, "friction_patch", height | {"radius": PATCH_RADII[0] * found.spread})
    friction = of_effect(added, "friction", 0.1, lower=-2.0, upper=2.0)
    widest = max(3.0 * found.spread, float(np.linalg.norm(found.upper - found.lower)))
    radius = of_effect(added, "radius", 0.3 * found.spread, lower=0.02 * found.spread, upper=widest)
    centre = [
        of_effect(
            added,
            "xyz"[a],
            0.3 * found.spread,
            lower=float(found.middle[a]) - 0.75 * found.size,
            upper=float(found.middle[a]) + 0.75 * found.size,
        )
        for a in flat
    ]
    unknowns = (friction, radius, *centre)
    starts = tuple(
        neutral(unknowns, radius=share * found.spread, **{"xyz"[a]: float(place[a]) for a in flat})
        for place in places
        for share in PATCH_RADII
    )
    idle = tuple(u.name for u in unknowns[1:])
    all_over = {u.name: float(found.middle["xyz".index(u.name)]) for u in centre} | {"radius": radius.upper}
    child = with_effects(world, added)
    return (Variant(child, unknowns, starts, strength="friction", idle=idle, everywhere=all_over),)


def _drop(world: World, axis: int) -> float:
    """How far below a resting ball's centre it touches the floor, along one axis, signed as gravity is."""
    gravity = np.asarray(world.environment.gravity)
    size = float(np.linalg.norm(gravity))
    radii = [o.shape.radius for o in world.objects if o.shape.kind == "sphere"]
    if size == 0.0 or not radii:
        return 0.0
    return float(-gravity[axis] / size * np.median(radii))


CANDIDATES = (
    Candidate(
        name="restitution_speed",
        group="contact",
        law="e(v) = e0 / (1 + k v)",
        representations=RIGID,
        signature="rebounds from high drops too weak, from low ones right",
        reference="Hunt & Crossley (1975), J. Appl. Mech. 42, 440",
        variants=_restitution_speed,
        confused_with={
            "restitution_error": "drops from different heights",
            "quadratic_drag": "the residual between impacts",
        },
    ),
    Candidate(
        name="bounce_friction",
        group="contact",
        law="v_t' = (1 - f) v_t at each impact, whatever the spin",
        representations=RIGID,
        signature="the same share of the speed along the floor is lost at every impact",
        reference="Brody (1984), Phys. Teach. 22, 494",
        variants=_bounce_friction,
        confused_with={
            "friction_error": "impacts at several angles, and the spin after them",
            "spin_coupling": "throws with different spin",
            "linear_drag": "the residual between impacts",
        },
    ),
    Candidate(
        name="spin_coupling",
        group="contact",
        law="u' = -e_t u of the point that touches, spin included",
        representations=RIGID,
        signature="kicks along the floor that follow the spin, beyond what Coulomb's law allows or short of it",
        reference="Garwin (1969), Am. J. Phys. 37, 88; Cross (2002), Am. J. Phys. 70, 1093",
        variants=_spin_coupling,
        confused_with={
            "friction_error": "steep impacts with much spin: Coulomb's kick is limited by the blow",
            "bounce_friction": "throws with different spin",
        },
    ),
    Candidate(
        name="friction_patch",
        group="contact",
        law="mu' = mu + d on what does not move, within a radius of a place",
        representations=RIGID,
        signature="deceleration that is different in one place, whatever the speed",
        reference="Coulomb (1785), with a coefficient that depends on the place",
        variants=_friction_patch,
        confused_with={
            "fan": "crossings at several speeds and headings: a jet pushes one way",
            "friction_error": "motion elsewhere",
        },
    ),
)
