"""Unknowns of deformable objects, and of the pulleys and emitters that belong to them: which, where, from where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld import geometry
from polyworld.identification.free_parameters import FitParameter
from polyworld.parameter_tables import DEFORMABLE_PARAMETERS, EMITTER_PARAMETERS, PULLEY_PARAMETERS, ParameterSpec
from polyworld.parameters import read_parameter
from polyworld.tracks import ObservedTracks
from polyworld.world import Deformable, World

# What the motion of each material shows best, fitted unless asked otherwise.
MATERIAL: dict[str, tuple[str, ...]] = {
    "rope": ("bending_stiffness", "linear_damping"),
    "cloth": ("stretch_stiffness", "bending_stiffness", "linear_damping"),
    "soft": ("youngs_modulus", "damping"),
    "fluid": ("viscosity",),
}
CHOICES = tuple(sorted({field for fields in DEFORMABLE_PARAMETERS.values() for field in fields}))

DECADES = 100.0  # a value outside the usual range is searched within this factor of itself
OPENING = 0.25  # a search begins with this share of a parameter's range as standard deviation
SHIFT_SD, VELOCITY_SD, REACH = 0.02, 0.2, 5.0  # [m], [m/s]; bounds in standard deviations


def material_parameters(
    world: World, tracks: ObservedTracks, fields: Sequence[str] | None = None, *, initial_conditions: bool = True
) -> list[FitParameter]:
    """Unknowns of the observed deformable objects, with bounds from the usual ranges.

    fields: names of `DEFORMABLE_PARAMETERS`, fitted for every object that has them; default by representation
    (`MATERIAL`), with the density of a fluid beside another fluid, friction of pulleys and rate of emitters.
    initial_conditions: also shift and velocity of soft bodies that nothing holds. Stiffnesses and other positive
    quantities that range over decades are searched on a logarithmic scale. Raises ValueError for an unknown field.
    """
    unknown = sorted(set(fields or ()) - set(CHOICES))
    if unknown:
        raise ValueError(f"unknown parameters of deformable objects {unknown}; choices: {list(CHOICES)}")
    made: list[FitParameter] = []
    observed = set(tracks.observed_names) | _beside_observed(world, tracks)
    for item in world.deformables:
        if item.name not in observed:
            continue
        table = DEFORMABLE_PARAMETERS[item.representation]
        chosen = [f for f in (fields if fields is not None else _default_fields(world, item)) if f in table]
        begin = float(getattr(item, "start_time", 0.0))
        made += [searched(world, f"objects.{item.name}.{f}", table[f], begin) for f in chosen]
        if initial_conditions and item.representation.startswith("soft") and not _held(world, item.name):
            made += _start(world, item, begin)
    if fields is None:
        made += _pulleys(world, observed)
        made += [
            searched(world, f"emitters.{e.name}.rate", EMITTER_PARAMETERS["rate"], e.start)
            for e in world.emitters
            if e.fluid in observed
        ]
    return made


def searched(world: World, path: str, spec: ParameterSpec, begin: float = 0.0) -> FitParameter:
    """One parameter searched over its usual range, from the world's value where that lies inside.

    On a logarithmic scale where the range spans more than a decade above zero.
    """
    value = read_parameter(world, path)
    lower, upper = spec.search
    if value is not None and value > 0.0 and not lower <= value <= upper:
        lower, upper = max(spec.lower, min(lower, value / DECADES)), min(spec.upper, max(upper, value * DECADES))
    name = path.removeprefix("objects.")
    if lower > 0.0 and upper / lower > 10.0:
        centre = np.sqrt(lower * upper) if value is None or value <= 0.0 else float(np.clip(value, lower, upper))
        sd = OPENING * float(np.log(upper / lower))
        return FitParameter(name, (path,), lower, upper, float(centre), sd, scale="log", enters=begin)
    sd = OPENING * (upper - lower)
    middle = 0.5 * (lower + upper) if value is None else value
    centre = float(np.clip(middle, lower + 0.5 * sd, upper - 0.5 * sd))
    return FitParameter(name, (path,), lower, upper, centre, sd, enters=begin)


def tied_bodies(world: World) -> set[str]:
    """Rigid objects that a deformable object is fastened to, or that carry a pulley: its forces show their masses."""
    rigid = {o.name for o in world.objects}
    tied = {a.to for a in world.attachments if a.to is not None} | {
        p.object for p in world.pulleys if p.object is not None
    }
    return tied & rigid


def _beside_observed(world: World, tracks: ObservedTracks) -> set[str]:
    """Deformable objects fastened to something observed: its motion shows them."""
    known = set(tracks.observed_names)
    return {a.object for a in world.attachments if a.to in known} | {
        a.to for a in world.attachments if a.to is not None and a.object in known
    }


def _default_fields(world: World, item: Deformable) -> tuple[str, ...]:
    kind = item.representation.removesuffix("_planar")
    fluids = [d for d in world.deformables if d.representation.startswith("fluid")]
    # Densities enter as ratios: that of the first fluid is their unit.
    if kind == "fluid" and len(fluids) > 1 and item is not fluids[0]:
        return (*MATERIAL[kind], "density")
    return MATERIAL[kind]


def _held(world: World, name: str) -> bool:
    return any(name in (a.object, a.to) for a in world.attachments)


def _start(world: World, item: Deformable, begin: float) -> list[FitParameter]:
    made: list[FitParameter] = []
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    for i, axis in enumerate("xyz"):
        if world.planar and abs(normal[i]) > 1.0 - 1e-9:
            continue
        for field, sd in (("shift", SHIFT_SD), ("velocity", VELOCITY_SD)):
            path = f"objects.{item.name}.{field}.{axis}"
            value = read_parameter(world, path) or 0.0
            made.append(
                FitParameter(
                    f"{item.name}.{field}.{axis}",
                    (path,),
                    value - REACH * sd,
                    value + REACH * sd,
                    value,
                    sd,
                    enters=begin,
                )
            )
    return made


def _pulleys(world: World, observed: set[str]) -> list[FitParameter]:
    made: list[FitParameter] = []
    for pulley in world.pulleys:
        if pulley.rope not in observed:
            continue
        # A wheel that cannot turn rubs on the rope; one that can has a bearing.
        field = "friction" if pulley.fixed_wheel else "bearing_friction"
        made.append(searched(world, f"pulleys.{pulley.name}.{field}", PULLEY_PARAMETERS[field]))
    return made
