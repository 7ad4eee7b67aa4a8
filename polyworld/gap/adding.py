"""Make child worlds, and unknowns of their parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf
from typing import Any

from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Variant
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter, specification


def with_parts(world: World, **parts: Any) -> World:
    """Return a child world with some fields replaced, checked as a whole."""
    fields: dict[str, Any] = {name: getattr(world, name) for name in World.model_fields}
    return World.model_validate(fields | parts)


def free_name(name: str, taken: Iterable[str]) -> str:
    """Return the name, or the name with the first number that makes it free."""
    used = set(taken)
    if name not in used:
        return name
    return next(f"{name}_{k}" for k in range(2, len(used) + 3) if f"{name}_{k}" not in used)


def of_path(
    world: World,
    paths: tuple[str, ...],
    name: str,
    start: float,
    typical: float,
    *,
    lower: float = -inf,
    upper: float = inf,
    plausible: float | None = None,
) -> Unknown:
    """Return an unknown whose value paths of a world share; bounds lie within those of the parameter."""
    spec = specification(world, paths[0])
    lower, upper = max(lower, spec.lower), min(upper, spec.upper)
    return Unknown(name, paths, spec.unit, start, lower, upper, typical, plausible=plausible)


def by_value(
    world: World, paths: Iterable[str], name: str, sized: Callable[[float], Mapping[str, float]]
) -> list[Unknown]:
    """Return unknowns for paths of a world, one for all that have the same value now; paths without a value are left
    out.

    sized: value -> typical size, bounds and plausible departure, as `of_path` takes them.
    """
    known, groups = parameter_paths(world), dict[float, list[str]]()
    for path in paths:
        value = read_parameter(world, path) if path in known else None
        if value is not None:
            groups.setdefault(value, []).append(path)
    return [
        of_path(
            world,
            tuple(listed),
            name if len(groups) == 1 else f"{name}_{listed[0].split('.')[1]}",
            value,
            **sized(value),
        )
        for value, listed in groups.items()
    ]


def neutral(unknowns: Iterable[Unknown], **values: float) -> dict[str, float]:
    """Return the unknowns' own starts by name, with some replaced."""
    return {u.name: u.start for u in unknowns} | values


def one_start(
    world: World,
    unknowns: Sequence[Unknown],
    label: str = "",
    *,
    same_as: tuple[str, ...] = (),
) -> Variant:
    """Return a variant that is fitted from its neutral values."""
    return Variant(world, tuple(unknowns), (neutral(unknowns),), label, same_as)
