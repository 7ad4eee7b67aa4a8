"""Other numbers of ropes, cloth, soft bodies and fluids than the world's."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from polyworld.data.recording import Recording
from polyworld.gap.candidate import Candidate, Variant, by_value, one_start
from polyworld.world import World
from polyworld.world.materials import Form, material_of

ROPES: frozenset[Form] = frozenset({"line"})
CLOTH: frozenset[Form] = frozenset({"sheet"})
SOFT: frozenset[Form] = frozenset({"solid"})
FLUIDS: frozenset[Form] = frozenset({"liquid"})
FACTOR = 100.0  # by which a value may be wrong either way


@dataclass(frozen=True)
class Field:
    """A field of materials of some forms. floor: an ordinary change where the value is zero."""

    field: str
    forms: frozenset[Form]
    floor: float
    label: str = ""


def _variants(world: World, fields: Sequence[Field]) -> tuple[Variant, ...]:
    """Return a variant for each field; objects of equal value share one unknown."""
    owners = [[d.name for d in world.deformables if material_of(d).form in f.forms] for f in fields]
    several = sum(map(bool, owners)) > 1
    made: list[Variant] = []
    for field, names in zip(fields, owners, strict=True):
        unknowns = by_value(world, [f"objects.{n}.{field.field}" for n in names], field.field, _sized(field.floor))
        if unknowns:
            made.append(one_start(world, unknowns, field.label if several else ""))
    return tuple(made)


def _sized(floor: float) -> Callable[[float], Mapping[str, float]]:
    def sized(value: float) -> Mapping[str, float]:
        typical, most = (0.3 * value, FACTOR * value) if value > 0.0 else (floor, FACTOR * floor)
        return {"typical": typical, "lower": value / FACTOR, "upper": most}

    return sized


def _of(*fields: Field) -> Callable[[World, Recording], tuple[Variant, ...]]:
    return lambda world, _: _variants(world, fields)


def _bending(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Return where nothing bends stiffly yet: what bends a rope's own weight back over a tenth of its length."""
    del recording
    weights = [0.0]
    g = float(np.linalg.norm(world.environment.gravity)) or 9.81
    for rope in world.of_form("line"):
        length = float(np.linalg.norm(np.diff(np.asarray(rope.points), axis=0), axis=1).sum())
        weights.append(float(rope.linear_density) * g * (0.1 * length) ** 3)
    return _variants(
        world,
        (
            Field("bending_stiffness", ROPES, max(weights) or 1e-4, "of ropes"),
            Field("bending_stiffness", CLOTH, 1e-5, "of cloth"),
        ),
    )


def _source(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    unknowns = by_value(world, [f"emitters.{e.name}.rate" for e in world.emitters], "rate", _sized(1e-5))
    return (one_start(world, unknowns),) if unknowns else ()


CANDIDATES = (
    Candidate(
        "material_damping",
        "material",
        "stress = C (strain + tau strain rate)",
        _of(
            Field("stretch_damping", ROPES | CLOTH, 0.01, "of stretching"),
            Field("bending_damping", ROPES | CLOTH, 0.01, "of bending"),
            Field("damping", SOFT, 0.01, "of soft bodies"),
        ),
    ),
    Candidate(
        "air_drag",
        "material",
        "dv/dt = -c v of ropes and soft bodies; rho C_n v_n^2 / 2 per area of cloth",
        _of(
            Field("linear_damping", ROPES, 0.1, "of ropes"),
            Field("linear_damping", SOFT, 0.1, "of soft bodies"),
            Field("drag_normal", CLOTH, 1.0, "across the sheet"),
            Field("drag_tangential", CLOTH, 0.05, "along the sheet"),
        ),
    ),
    Candidate("bending_stiffness", "material", "moment = EI curvature; D curvature per width of a sheet", _bending),
    Candidate(
        "stretch_stiffness",
        "material",
        "tension = EA strain; stress = E strain",
        _of(
            Field("stretch_stiffness", ROPES, 1e3, "of ropes"),
            Field("stretch_stiffness", CLOTH, 100.0, "of cloth"),
            Field("youngs_modulus", SOFT, 1e4, "of soft bodies"),
        ),
    ),
    Candidate("viscosity", "material", "stress = mu (grad v + grad v^T)", _of(Field("viscosity", FLUIDS, 1e-3))),
    Candidate(
        "surface_tension", "material", "pressure jump = sigma curvature", _of(Field("surface_tension", FLUIDS, 0.02))
    ),
    Candidate("source_rate", "material", "volume per time of emitters", _source),
)
