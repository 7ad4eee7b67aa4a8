"""How an effect becomes part of a child world, and its parameters unknowns of a fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from polyworld.effects import CATALOGUE
from polyworld.estimation.unknown import Unknown
from polyworld.parameters import specification
from polyworld.world import Effect, World

RIGID = frozenset({"rigid_planar", "rigid_spatial"})
BODIES = RIGID | {"rope", "rope_planar", "cloth", "soft", "soft_planar"}


def with_parts(world: World, **parts: Any) -> World:
    """A child world with some fields replaced, checked as a whole."""
    fields: dict[str, Any] = {name: getattr(world, name) for name in World.model_fields}
    return World.model_validate(fields | parts)


def effect(
    world: World,
    kind: str,
    parameters: Mapping[str, float] | None = None,
    *,
    name: str | None = None,
    objects: tuple[str, ...] | None = None,
) -> Effect:
    """An effect to be added, called after its kind (or `name`) with a number where that name is taken.

    objects: whom it acts on; default: all, or all rigid bodies where the law acts on no others.
    """
    if objects is None and world.deformables and not CATALOGUE[kind].per_mass:
        objects = tuple(o.name for o in world.objects)
    taken = {e.name for e in world.effects}
    return Effect(name=free_name(name or kind, taken), kind=kind, parameters=dict(parameters or {}), objects=objects)


def free_name(name: str, taken: Iterable[str]) -> str:
    """The name, or the name with the first number that makes it free."""
    used = set(taken)
    if name not in used:
        return name
    return next(f"{name}_{k}" for k in range(2, len(used) + 3) if f"{name}_{k}" not in used)


def with_effects(world: World, *effects: Effect) -> World:
    """A child world with effects added."""
    return with_parts(world, effects=(*world.effects, *effects))


def of_effect(
    added: Effect,
    parameter: str,
    typical: float,
    *,
    name: str | None = None,
    lower: float | None = None,
    upper: float | None = None,
) -> Unknown:
    """A parameter of an effect as an unknown, from its value on; bounds are the law's where none are given."""
    spec = CATALOGUE[added.kind].parameters[parameter]
    return Unknown(
        name=name or parameter,
        paths=(f"effects.{added.name}.{parameter}",),
        unit=spec.unit,
        start=added.parameters.get(parameter, spec.default),
        lower=spec.lower if lower is None else max(lower, spec.lower),
        upper=spec.upper if upper is None else min(upper, spec.upper),
        typical=typical,
    )


def of_path(
    world: World,
    paths: tuple[str, ...],
    name: str,
    start: float,
    typical: float,
    *,
    lower: float | None = None,
    upper: float | None = None,
) -> Unknown:
    """Paths of a world that share one value, as an unknown; bounds are those of the parameter where none are given."""
    spec = specification(world, paths[0])
    return Unknown(
        name=name,
        paths=paths,
        unit=spec.unit,
        start=start,
        lower=spec.lower if lower is None else max(lower, spec.lower),
        upper=spec.upper if upper is None else min(upper, spec.upper),
        typical=typical,
    )


def neutral(unknowns: Iterable[Unknown], **values: float) -> dict[str, float]:
    """The unknowns' own starts by name, with some replaced."""
    return {u.name: u.start for u in unknowns} | values
