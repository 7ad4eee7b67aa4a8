"""A ball that nobody sees, fixed or free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.effects.absence import coordinates
from polyworld.effects.conditions import Conditions
from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Candidate, Variant, free_name, of_path, with_parts
from polyworld.gap.conditions import conditions, reach
from polyworld.gap.kinks import Kink, kinks
from polyworld.screening.statics import plane_normal
from polyworld.world import StaticObject, World
from polyworld.world.parameters import object_mass
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]

MOST_STARTS = 6
HEAVIEST = 20.0  # times the mass of what struck it


def _body(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or len(found.axes) < 2:
        return ()
    made: list[Variant] = []
    for kind in ("rigid_planar", "rigid_spatial"):
        struck = [k for k in kinks(world, recording) if world.object(k.name).representation == kind]
        floor = _floor(world) if kind == "rigid_spatial" else None
        low = [k for k in struck if floor is not None and _lies(world, k, floor)]
        high = [k for k in struck if kind == "rigid_spatial" and not any(k is x for x in low)]
        if kind == "rigid_planar" and struck:
            made.append(_free_body(world, found, struck, None))
        if low:
            made.append(_free_body(world, found, low, floor))
        if high:
            made.append(_fixed_body(world, found, high))
    return tuple(made)


def _floor(world: World) -> float | None:
    """Height of a level floor that gravity presses on."""
    gravity = np.asarray(world.environment.gravity)
    if not (gravity[2] < 0.0 and abs(gravity[0]) + abs(gravity[1]) < 1e-9):
        return None
    for static in world.statics:
        normal = plane_normal(static)
        if normal is not None and normal[2] > 1.0 - 1e-9:
            return float(static.position[2] + getattr(static.shape, "offset", 0.0))
    return None


def _lies(world: World, kink: Kink, floor: float) -> bool:
    """Return whether what was struck may have lain on the floor: as large as the body itself, and beside or below
    it."""
    radius = reach(world, world.object(kink.name))
    return bool(kink.place[2] - floor < 3.0 * radius and kink.direction[2] > -0.3)


def _where(world: World, kink: Kink, radius: float) -> Array:
    """Centre (3,) of a ball that the body struck, from the direction in which it was thrown back."""
    centre: Array = kink.place - kink.direction * (reach(world, world.object(kink.name)) + radius)
    return centre


def _free_body(world: World, found: Conditions, struck: Sequence[Kink], floor: float | None) -> Variant:
    """Return a ball at rest, as large as what struck it, that is free to move."""
    item = world.object(struck[0].name)
    radius, mass = reach(world, item), object_mass(item)
    places = [_where(world, k, radius) for k in struck[:MOST_STARTS]]
    axes = list(found.axes) if floor is None else [0, 1]
    for place in places:
        if floor is not None:
            place[2] = floor + radius
        elif world.planar:
            across = [a for a in range(3) if a not in axes]
            place[across] = np.asarray(item.position)[across]
    name = _free_name(world)
    kept = item.model_dump(exclude={"orientation", "velocity", "angular_velocity"})
    own = {"name": name, "shape": Sphere(radius=radius), "position": tuple(places[0]), "mass": mass}
    child = with_parts(world, objects=(*world.objects, RigidObject.model_validate(kept | own)))
    unknowns = (
        *_placed(child, f"objects.{name}.position", axes, places[0], found),
        of_path(
            child, (f"objects.{name}.mass",), "mass", mass, 0.5 * mass, lower=mass / HEAVIEST, upper=mass * HEAVIEST
        ),
    )
    starts = tuple(
        coordinates("", place, axes) | {"mass": _struck_mass(world, kink, object_mass(world.object(kink.name)))}
        for kink, place in zip(struck, places, strict=False)
    )
    return Variant(child, unknowns, starts, "free")


def _fixed_body(world: World, found: Conditions, struck: Sequence[Kink]) -> Variant:
    """Return a ball that does not move, as large as what struck it."""
    radius = reach(world, world.object(struck[0].name))
    places = [_where(world, k, radius) for k in struck[:MOST_STARTS]]
    x, y, z = (float(c) for c in places[0])
    body = StaticObject(name=_free_name(world), shape=Sphere(radius=radius), position=(x, y, z))
    child = with_parts(world, statics=(*world.statics, body))
    unknowns = _placed(child, f"statics.{body.name}.position", found.axes, places[0], found)
    return Variant(child, tuple(unknowns), tuple(coordinates("", p, found.axes) for p in places), "fixed")


def _free_name(world: World) -> str:
    return free_name("hidden_body", [*world.moving_names, *(s.name for s in world.statics)])


def _placed(child: World, head: str, axes: Sequence[int], place: Array, found: Conditions) -> list[Unknown]:
    """Return coordinates of a body as unknowns, up to the size of the region visited beyond it."""
    made = []
    for a in axes:
        low, high = float(found.lower[a]) - found.size, float(found.upper[a]) + found.size
        path = f"{head}.{'xyz'[a]}"
        made.append(of_path(child, (path,), "xyz"[a], float(place[a]), 0.1 * found.spread, lower=low, upper=high))
    return made


def _struck_mass(world: World, kink: Kink, mass: float) -> float:
    """Return the mass of a body at rest that throws another back as seen: m u (1 + e) / (m + M) = jump / M."""
    approach = float(-kink.before @ kink.direction)
    restitution = world.object(kink.name).restitution
    share = float(np.linalg.norm(kink.jump)) / max((1.0 + restitution) * approach, 1e-9)
    return float(np.clip(mass * share / max(1.0 - share, 1e-3), mass / HEAVIEST, mass * HEAVIEST))


CANDIDATES = (
    Candidate(
        "hidden_body", "structure", "a ball, as large as what strikes it, at rest until it is struck", _body, local=True
    ),
)
