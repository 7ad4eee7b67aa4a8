"""Fit numbers of deformable objects: objects of equal value share one unknown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from polyworld.estimation.candidate import Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.adding import of_path, one_start
from polyworld.parameters import parameter_paths, read_parameter
from polyworld.recording import Recording
from polyworld.world import World

ROPES = frozenset({"rope", "rope_planar"})
SOFT = frozenset({"soft", "soft_planar"})
FLUIDS = frozenset({"fluid", "fluid_planar"})
CLOTH = frozenset({"cloth"})
FACTOR = 100.0  # by which a value may be wrong either way


@dataclass(frozen=True)
class Field:
    """A field of some representations. floor: an ordinary change where the value is zero."""

    field: str
    representations: frozenset[str]
    floor: float
    label: str = ""


def field_variants(world: World, kinds: Sequence[Field]) -> tuple[Variant, ...]:
    """A variant for each field."""
    made: list[Variant] = []
    fields = [k for k in kinds if any(d.representation in k.representations for d in world.deformables)]
    for kind in fields:
        owners = [d.name for d in world.deformables if d.representation in kind.representations]
        unknowns = shared_values(world, [f"objects.{n}.{kind.field}" for n in owners], kind.field, kind.floor)
        if unknowns:
            made.append(one_start(world, unknowns, kind.label if len(fields) > 1 else ""))
    return tuple(made)


def shared_values(world: World, paths: Sequence[str], name: str, floor: float) -> list[Unknown]:
    """Unknowns for paths of a world, one for all that have the same value now. floor: as of a `Field`."""
    known = parameter_paths(world)
    groups: dict[float, list[str]] = {}
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
            0.3 * value if value > 0.0 else floor,
            lower=value / FACTOR,
            upper=FACTOR * (value if value > 0.0 else floor),
        )
        for value, listed in groups.items()
    ]


def of_fields(*kinds: Field) -> Callable[[World, Recording], tuple[Variant, ...]]:
    """The variants of some fields, as a candidate takes them."""

    def variants(world: World, recording: Recording) -> tuple[Variant, ...]:
        del recording
        return field_variants(world, kinds)

    return variants
