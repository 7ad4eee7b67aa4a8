"""Other coefficients of contacts than the world's: restitution, Coulomb friction, rolling resistance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from polyworld.data.recording import Recording
from polyworld.gap.candidate import Candidate, Variant, by_value, of_path, one_start
from polyworld.gap.conditions import conditions
from polyworld.world import World
from polyworld.world.parameters import read_parameter

MOST_GROUPS = 4  # different values among bodies that are fitted independently; more would be a refit, not an effect
OTHERS = (0.4, 2.5)  # times a friction that fits begin at, too
ORDINARY_RESTITUTION = 0.5  # by which it may be off: lead from ivory
ORDINARY_FRICTION = 1.0  # likewise: rubber from ice
ORDINARY_ROLLING = 0.3  # likewise, of the radius: a wheel in sand from one on a rail
ROUND = ("sphere", "cylinder", "capsule")


def _surface(world: World, field: str, sized: Callable[[float], Mapping[str, float]]) -> list[Variant]:
    """Return ways in which a coefficient of contacts may be wrong: that of the bodies, or that of one of the
    statics."""
    of_bodies = by_value(world, [f"objects.{o.name}.{field}" for o in world.objects], field, sized)
    made: list[Variant] = []
    if 0 < len(of_bodies) <= MOST_GROUPS:
        several = len(world.statics) > 1 or len(of_bodies) > 1
        made.append(one_start(world, of_bodies, "of the bodies" if several else ""))
    if len(world.statics) < 2 and len(of_bodies) < 2:
        return made  # one body's coefficient and one floor's act through their product alone
    for static in world.statics:
        path = f"statics.{static.name}.{field}"
        value = read_parameter(world, path)
        if value is None and len(of_bodies) > 1:
            continue  # it takes each body's own: no one value of its own leaves the motion as it is
        start = of_bodies[0].start if value is None else value
        made.append(one_start(world, (of_path(world, (path,), field, start, **sized(start)),), f"of {static.name}"))
    return made


def _restitution(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not found.impacts:
        return ()
    return tuple(_surface(world, "restitution", lambda _: {"typical": 0.1, "plausible": ORDINARY_RESTITUTION}))


def _size_of_friction(value: float) -> Mapping[str, float]:
    return {"typical": max(0.3 * value, 0.05), "plausible": ORDINARY_FRICTION}


def _friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    plane = world.environment.motion_plane.friction
    made: list[Variant] = []
    if found.supported and plane is not None:
        path = ("environment.motion_plane.friction",)
        unknown = of_path(world, path, "friction", plane, **_size_of_friction(plane))
        made.append(one_start(world, (unknown,), "of the plane"))
    if found.impacts or found.slides:
        made += _surface(world, "friction", _size_of_friction)
    return tuple(_other_frictions(v) for v in made)


def _other_frictions(variant: Variant) -> Variant:
    """Return the variant that also starts at much less and much more: where an impact or a roll grips, the slope by
    friction is zero."""
    more = tuple(
        {u.name: float(np.clip(times * u.start, u.lower, u.upper)) for u in variant.unknowns} for times in OTHERS
    )
    return replace(variant, starts=(*variant.starts, *more))


def _rolling(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    bodies = [o.name for o in world.objects if o.shape.kind in ROUND and o.representation == "rigid_spatial"]
    if not bodies or not found.slides:
        return ()

    def sized(value: float) -> Mapping[str, float]:
        return {"typical": max(0.3 * value, 0.01 * found.radius), "plausible": ORDINARY_ROLLING * found.radius}

    unknowns = by_value(world, [f"objects.{n}.rolling_resistance" for n in bodies], "rolling_resistance", sized)
    return (one_start(world, unknowns),) if len(unknowns) <= MOST_GROUPS else ()


CANDIDATES = (
    Candidate(
        name="restitution_error",
        group="base",
        law="v_n' = -e' v_n at impacts, another e' than the world's",
        variants=_restitution,
        plain=True,
    ),
    Candidate(
        name="friction_error",
        group="base",
        law="|F_t| <= mu' F_n, another mu' than the world's",
        variants=_friction,
        plain=True,
    ),
    Candidate(
        name="rolling_resistance",
        group="base",
        law="M = b F_n against rolling",
        variants=_rolling,
        plain=True,
    ),
)
