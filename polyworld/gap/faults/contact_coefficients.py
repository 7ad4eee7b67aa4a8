"""Other coefficients of contacts than the world's: restitution, Coulomb friction, rolling resistance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.adding import of_path, one_start
from polyworld.gap.conditions import conditions
from polyworld.parameters import read_parameter
from polyworld.recording import Recording
from polyworld.representations.rigid import RigidObject
from polyworld.world import World

if TYPE_CHECKING:
    from polyworld.estimation.trial import FitContext, FittedHypothesis

MOST_GROUPS = 4  # different values among bodies that are fitted apart; more would be a refit, not an effect
OTHERS = (0.4, 2.5)  # times a friction that fits begin at, too
ORDINARY_RESTITUTION = 0.5  # by which it may be off: lead from ivory
ORDINARY_FRICTION = 1.0  # likewise: rubber from ice
ORDINARY_ROLLING = 0.3  # likewise, of the radius: a wheel in sand from one on a rail
ROUND = ("sphere", "cylinder", "capsule")


def _by_value(
    world: World, field: str, bodies: Sequence[RigidObject], typical: Callable[[float], float], plausible: float
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
            plausible=plausible,
        )
        for value, names in groups.items()
    ]


def _surface(world: World, field: str, typical: Callable[[float], float], plausible: float) -> list[Variant]:
    """Ways in which a coefficient of contacts may be wrong: that of the bodies, or that of one of the statics."""
    of_bodies = _by_value(world, field, world.objects, typical, plausible)
    made: list[Variant] = []
    if 0 < len(of_bodies) <= MOST_GROUPS:
        several = len(world.statics) > 1 or len(of_bodies) > 1
        made.append(one_start(world, of_bodies, "of the bodies" if several else ""))
    own = {float(getattr(o, field)) for o in world.objects}
    if len(world.statics) < 2 and len(own) < 2:
        return made  # one body's coefficient and one floor's act through their product alone
    for static in world.statics:
        value = read_parameter(world, f"statics.{static.name}.{field}")
        if value is None and len(own) > 1:
            continue  # it takes each body's own: no one value of its own leaves the motion as it is
        start = next(iter(own)) if value is None else value
        path = f"statics.{static.name}.{field}"
        unknown = of_path(world, (path,), field, start, typical(start), plausible=plausible)
        made.append(one_start(world, (unknown,), f"of {static.name}"))
    return made


def _restitution(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not found.impacts:
        return ()
    return tuple(_surface(world, "restitution", lambda _: 0.1, ORDINARY_RESTITUTION))


def _friction_size(value: float) -> float:
    return max(0.3 * value, 0.05)


def _friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    plane = world.environment.motion_plane.friction
    made: list[Variant] = []
    if found.supported and plane is not None:
        path = ("environment.motion_plane.friction",)
        unknown = of_path(world, path, "friction", plane, _friction_size(plane), plausible=ORDINARY_FRICTION)
        made.append(one_start(world, (unknown,), "of the plane"))
    if found.impacts or found.slides:
        made += _surface(world, "friction", _friction_size, ORDINARY_FRICTION)
    return tuple(made)


def _other_frictions(_bench: FitContext, _trial: FittedHypothesis, variant: Variant) -> tuple[Mapping[str, float], ...]:
    """Start at much less and much more: where an impact or a roll grips, the slope by friction is zero."""
    return tuple(
        {u.name: float(np.clip(times * u.start, u.lower, u.upper)) for u in variant.unknowns} for times in OTHERS
    )


def _rolling(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    bodies = [o for o in world.objects if o.shape.kind in ROUND and o.representation == "rigid_spatial"]
    if not bodies or not found.slides:
        return ()
    unknowns = _by_value(
        world,
        "rolling_resistance",
        bodies,
        lambda value: max(0.3 * value, 0.01 * found.radius),
        ORDINARY_ROLLING * found.radius,
    )
    return (one_start(world, unknowns),) if len(unknowns) <= MOST_GROUPS else ()


CANDIDATES = (
    Candidate(
        name="restitution_error",
        group="base",
        law="v_n' = -e' v_n at impacts, another e' than the world's",
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
        signature="a rolling body that slows down evenly although it does not slip",
        reference="Coulomb (1785); Johnson, Contact Mechanics, 9.1",
        variants=_rolling,
        confused_with={
            "friction_error": "the spin, or the motion before and after rolling sets in",
            "viscous_friction": "rolling at several speeds",
            "linear_drag": "rolling at several speeds: this deceleration is even",
        },
    ),
)
