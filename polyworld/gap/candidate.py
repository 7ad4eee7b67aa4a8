"""Describe an effect that may be missing, and make child worlds and unknowns by which it is put into a world."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Literal

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter, specification

Group = Literal["force", "contact", "structure", "joint", "material", "base", "observer"]


@dataclass(frozen=True)
class Variant:
    """One way to put an effect into a world: the child world and what has to be fitted in it.

    world: the child, with the effect where it does nothing (at the unknowns' starts it moves as its parent does, or
    nearly so). unknowns: fitted together with the base parameters. starts: where fits begin, as values by name of
    unknown; several for an effect with a place or a frequency, and at least one. label: whom it acts on and by what
    rule, for readers; empty where there is but one way. same_as: other effects that this design cannot distinguish by
    construction (a uniform force on one body and a tilt), reported with every verdict. idle: unknowns that do nothing
    while the effect is off (its place, its rhythm), where it is off at all of its starts: the score test leaves them
    out, and takes the motion at all starts to be the parent's.
    """

    world: World
    unknowns: tuple[Unknown, ...]
    starts: tuple[Mapping[str, float], ...]
    label: str = ""
    same_as: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: its law and how it shows.

    name: standard name, as verdicts state it. law: formula. variants: (world, recording) -> the ways to add it; none
    where it cannot apply. plain: a law that is expected of ordinary scenes: fitted and reported beside any richer
    answer. local: whether it acts at one place or in one run, so that it may be taken for an outlying run.
    """

    name: str
    group: Group
    law: str
    variants: Callable[[World, Recording], tuple[Variant, ...]]
    plain: bool = False
    local: bool = False


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
