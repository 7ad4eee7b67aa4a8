"""Parameters of deformable objects, pulleys and emitters as arrays, shared or one value a world."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.coupled.nodes import Fields
from polyworld.world import World
from polyworld.world.materials import material_of
from polyworld.world.parameter_tables import EMITTER_PARAMETERS, PULLEY_PARAMETERS
from polyworld.world.parameters import read_parameter, specification

Array = NDArray[np.float64]


def split_overrides(world: World, overrides: Mapping[str, Array] | None) -> tuple[dict[str, Array], dict[str, Array]]:
    """Overrides of rigid objects and the surroundings, and those of deformables, pulleys and emitters."""
    names = {d.name for d in world.deformables}
    rigid: dict[str, Array] = {}
    soft: dict[str, Array] = {}
    for path, values in (overrides or {}).items():
        parts = path.split(".")
        is_soft = parts[0] in ("pulleys", "emitters") or (parts[0] == "objects" and parts[1] in names)
        (soft if is_soft else rigid)[path] = np.asarray(values, dtype=float)
    return rigid, soft


def deformable_fields(world: World, overrides: Mapping[str, Array]) -> Fields:
    """Values (1,) or (W,) by name and parameter; `shift.x`, `velocity.x`, ... are parameters too.

    NaN stands for a parameter that the world leaves open (shear_stiffness, yield_stress). Raises KeyError for an
    unknown path, ValueError for values that are not finite or out of bounds.
    """
    fields: Fields = {}
    for item in world.deformables:
        names = (*material_of(item).parameters, *material_of(item).state)
        fields[item.name] = {p: _value(world, f"objects.{item.name}.{p}") for p in names}
    for pulley in world.pulleys:
        fields[pulley.name] = {p: _value(world, f"pulleys.{pulley.name}.{p}") for p in PULLEY_PARAMETERS}
    for emitter in world.emitters:
        fields[emitter.name] = {p: _value(world, f"emitters.{emitter.name}.{p}") for p in EMITTER_PARAMETERS}
    for path, values in overrides.items():
        spec = specification(world, path)
        if not (np.all(np.isfinite(values)) and values.min() >= spec.lower and values.max() <= spec.upper):
            raise ValueError(f"{path}: values must lie in {spec.lower} to {spec.upper} {spec.unit}")
        _, name, parameter = path.split(".", 2)
        fields[name][parameter] = values
    return fields


def _value(world: World, path: str) -> Array:
    value = read_parameter(world, path)
    return np.array([np.nan if value is None else value])
