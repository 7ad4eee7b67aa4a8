"""Errors of the base world's own numbers: gravity, restitution, friction, rolling resistance, mass."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import BODIES, RIGID, neutral, of_path
from polyworld.gap.conditions import conditions
from polyworld.parameters import object_mass, read_parameter
from polyworld.recording import Recording
from polyworld.representations.rigid import RigidObject
from polyworld.world import World

if TYPE_CHECKING:
    from polyworld.estimation.trial import FitContext, FittedHypothesis

MOST_GROUPS = 4  # different values among bodies that are fitted apart; more would be a refit, not an effect
OTHERS = (0.4, 2.5)  # times a friction that fits begin at, too
ROUND = ("sphere", "cylinder", "capsule")


def _one(world: World, unknowns: Sequence[Unknown], label: str = "", same_as: tuple[str, ...] = ()) -> Variant:
    strength = unknowns[0].name if len(unknowns) == 1 else None
    return Variant(world, tuple(unknowns), (neutral(unknowns),), label, strength, same_as)


def _gravity(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    gravity = np.asarray(world.environment.gravity)
    size = float(np.linalg.norm(gravity))
    moved = [a for a in range(3) if abs(gravity[a]) > 1e-6 * size and a in found.axes] if size > 0.0 else []
    if not moved:
        return ()  # none, or only across a motion plane, where it acts through friction alone
    unknowns = [
        of_path(
            world,
            (f"environment.gravity.{'xyz'[a]}",),
            "gravity" if len(moved) == 1 else f"gravity_{'xyz'[a]}",
            float(gravity[a]),
            0.05 * size,
            lower=float(gravity[a]) - 2.0 * size,
            upper=float(gravity[a]) + 2.0 * size,
        )
        for a in moved
    ]
    same = ("buoyancy", "observer_clock") + (() if found.touches else ("observer_scale",))
    return (_one(world, unknowns, same_as=same),)


def _by_value(
    world: World, field: str, bodies: Sequence[RigidObject], typical: Callable[[float], float]
) -> list[Unknown]:
    """Unknowns for a field of bodies: one for all that have the same value now."""
    groups: dict[float, list[str]] = {}
    for item in bodies:
        groups.setdefault(float(getattr(item, field)), []).append(item.name)
    return [
        of_path(
            world,
            tuple(f"objects.{n}.{field}" for n in names),
            field if len(groups) == 1 else f"{field}_{names[0]}",
            value,
            typical(value),
        )
        for value, names in groups.items()
    ]


def _surface(world: World, field: str, typical: Callable[[float], float]) -> list[Variant]:
    """Ways in which a coefficient of contacts may be wrong: that of the bodies, or that of one of the statics."""
    of_bodies = _by_value(world, field, world.objects, typical)
    made: list[Variant] = []
    if 0 < len(of_bodies) <= MOST_GROUPS:
        made.append(_one(world, of_bodies, "of the bodies" if len(world.statics) > 1 or len(of_bodies) > 1 else ""))
    own = {float(getattr(o, field)) for o in world.objects}
    if len(world.statics) < 2 and len(own) < 2:
        return made  # one body's coefficient and one floor's act through their product alone
    for static in world.statics:
        value = read_parameter(world, f"statics.{static.name}.{field}")
        if value is None and len(own) > 1:
            continue  # it takes each body's own: no one value of its own leaves the motion as it is
        start = next(iter(own)) if value is None else value
        unknown = of_path(world, (f"statics.{static.name}.{field}",), field, start, typical(start))
        made.append(_one(world, (unknown,), f"of {static.name}"))
    return made


def _restitution(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not (found.bounces or found.meetings):
        return ()
    return tuple(_surface(world, "restitution", lambda value: 0.1))  # noqa: ARG005


def _friction_size(value: float) -> float:
    return max(0.3 * value, 0.05)


def _friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    plane = world.environment.motion_plane.friction
    made: list[Variant] = []
    if found.supported and plane is not None:
        path = ("environment.motion_plane.friction",)
        made.append(_one(world, (of_path(world, path, "friction", plane, _friction_size(plane)),), "of the plane"))
    if found.bounces or found.meetings or found.slides:
        made += _surface(world, "friction", _friction_size)
    return tuple(made)


def _other_frictions(_bench: FitContext, _trial: FittedHypothesis, variant: Variant) -> tuple[Mapping[str, float], ...]:
    """Where an impact or a roll grips, more friction changes nothing, and no slope tells what much less of it does."""
    return tuple(
        {u.name: float(np.clip(times * u.start, u.lower, u.upper)) for u in variant.unknowns} for times in OTHERS
    )


def _rolling(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    bodies = [o for o in world.objects if o.shape.kind in ROUND and o.representation == "rigid_spatial"]
    if not bodies or not found.slides:
        return ()
    unknowns = _by_value(world, "rolling_resistance", bodies, lambda value: max(0.3 * value, 0.01 * found.radius))
    return (_one(world, unknowns),) if len(unknowns) <= MOST_GROUPS else ()


def _mass(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    pairs = [*found.meetings, *((j.object, j.other) for j in world.joints if j.other is not None)]
    linked = [o for o in world.objects if any(o.name in pair for pair in pairs)]
    if len(linked) < 2:
        return ()
    # Only ratios of masses show; where there are two, the second's stands for theirs.
    chosen = linked[1:] if len(linked) == 2 else linked
    return tuple(
        _one(
            world,
            (
                of_path(
                    world,
                    (f"objects.{o.name}.mass",),
                    "mass",
                    object_mass(o),
                    0.3 * object_mass(o),
                    lower=object_mass(o) / 30.0,
                    upper=object_mass(o) * 30.0,
                ),
            ),
            f"of {o.name}",
        )
        for o in chosen
    )


CANDIDATES = (
    Candidate(
        name="gravity_error",
        group="base",
        law="a = g', another gravity than the world's",
        representations=BODIES | {"fluid", "fluid_planar"},
        signature="residual along gravity that grows as the square of the time in free motion, alike at all speeds",
        reference="Galilei (1638), Discorsi, third day",
        variants=_gravity,
        confused_with={
            "buoyancy": "only bodies of different density fall differently",
            "observer_scale": "lengths that are known: a body's radius where it rests, distances of walls",
            "observer_clock": "a motion whose time is known otherwise: a motor, a spring, a second clock",
            "quadratic_drag": "the residual depends on the speed; a slower or faster throw",
        },
    ),
    Candidate(
        name="restitution_error",
        group="base",
        law="v_n' = -e' v_n at impacts, another e' than the world's",
        representations=RIGID,
        signature="residual that begins at an impact and grows linearly; the same share of every rebound",
        reference="Newton, Principia, axioms, scholium to corollary 6",
        variants=_restitution,
        confused_with={
            "restitution_speed": "drops from different heights",
            "linear_drag": "the residual between impacts",
        },
    ),
    Candidate(
        name="friction_error",
        group="base",
        law="|F_t| <= mu' F_n, another mu' than the world's",
        representations=RIGID,
        signature="deceleration while sliding that does not depend on the speed, or a kick along an oblique impact",
        reference="Coulomb (1785), Theorie des machines simples",
        variants=_friction,
        further=_other_frictions,
        confused_with={
            "rolling_resistance": "the spin: a rolling body keeps its speed but for rolling resistance",
            "viscous_friction": "sliding at several speeds",
            "bounce_friction": "impacts at several angles, and the spin after them",
            "gravity_error": "motion that gravity drives, not only presses",
        },
    ),
    Candidate(
        name="rolling_resistance",
        group="base",
        law="M = b F_n against rolling",
        representations=frozenset({"rigid_spatial"}),
        signature="a rolling body that slows down evenly although it does not slip",
        reference="Coulomb (1785); Johnson, Contact Mechanics, 9.1",
        variants=_rolling,
        confused_with={
            "friction_error": "the spin, or the motion before and after rolling sets in",
            "viscous_friction": "rolling at several speeds",
            "linear_drag": "rolling at several speeds: this deceleration is even",
        },
    ),
    Candidate(
        name="mass_error",
        group="base",
        law="m' of one body, where masses share momentum",
        representations=RIGID,
        signature="both bodies' velocities are wrong after they meet, in opposite directions",
        reference="Newton, Principia I, law 3 and corollary 3",
        variants=_mass,
        confused_with={"restitution_error": "the momentum of the pair: the masses change it, restitution does not"},
    ),
)
