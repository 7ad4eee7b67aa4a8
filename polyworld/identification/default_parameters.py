"""A sensible list of unknowns for a world and its tracks, with bounds and beginnings taken from the tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld import geometry
from polyworld.expressions.effect import law_of
from polyworld.identification.contacts import possible_contacts
from polyworld.identification.free_parameters import FitParameter
from polyworld.identification.material_parameters import material_parameters, tied_bodies
from polyworld.identification.resistance import begun_from_slowing
from polyworld.initial_states import InitialState, initial_states
from polyworld.parameter_tables import OBJECT_PARAMETERS, SECONDS_PER_FRAME
from polyworld.parameters import read_parameter, specification
from polyworld.tracks import ObservedTracks
from polyworld.world import World

PHYSICAL = tuple(OBJECT_PARAMETERS)

# Bounds of initial states reach this many standard deviations, and at least these distances, around the
# track's own estimate: a polynomial over the first samples is biased where drag or a collision bends it.
REACH = 5.0
LEAST_POSITION, LEAST_VELOCITY, LEAST_ANGLE, LEAST_SPIN = 0.01, 0.05, 0.05, 0.3
# A search begins with this share of a parameter's range as standard deviation.
OPENING = 0.25


def default_parameters(
    world: World,
    tracks: ObservedTracks,
    *,
    shared: Sequence[str] = ("linear_damping", "angular_damping"),
    each: Sequence[str] = ("friction", "restitution", "mass"),
    initial_conditions: bool = True,
    effects: bool = True,
    time_base: bool = False,
    materials: Sequence[str] | None = None,
) -> list[FitParameter]:
    """Unknowns of a fit of `world` to `tracks`, only those that the tracks can show.

    shared: object parameters that get one value for all objects; each: one value per object. Both name fields
    of `polyworld.parameters.OBJECT_PARAMETERS`. Of the objects that may touch each other the mass of the
    first is kept, since motion tells only ratios, and is the unit of the others. initial_conditions: position,
    velocity, rotation and spin of every object that moves at first, position and rotation of those that are
    moved later. effects: coefficients of the world's enabled effects. time_base: seconds_per_frame, when it
    is not given. materials: parameters of deformable objects, see `material_parameters`.

    Left out: objects without a track or which neither move nor are reached by anything; contact parameters of
    objects that nothing reaches. These keep what the world has, except that a shared value is everybody's.
    Raises ValueError for unknown fields or fields in both lists.
    """
    _check_fields(shared, each)
    axes = geometry.plane_axes(world.environment.motion_plane)
    states = initial_states(tracks, seconds_per_frame=world.time.seconds_per_frame)
    contacts = possible_contacts(world, tracks)
    bodies = {o.name for o in world.objects}
    touched = {n: min(c.time for c in contacts if n in c.participants) for c in contacts for n in c.participants}
    tied = tied_bodies(world) & set(states)
    met = {n for c in contacts for n in c.participants if set(c.participants) <= bodies} | tied
    # When an object's own motion begins to show: at once if it moves, else when something reaches it.
    begins = {
        o.name: o.start_time if states[o.name].moves or o.name in tied else touched[o.name]
        for o in world.objects
        if o.name in states and (states[o.name].moves or o.name in touched or o.name in tied)
    }
    parameters: list[FitParameter] = []
    if initial_conditions:
        for name, begin in begins.items():
            parameters += _initial_conditions(world, states[name], begin, axes, tracks)
    for field in (*shared, *each):
        felt = {**touched, **dict.fromkeys(tied, 0.0)} if field == "mass" else touched
        concerned = {n: _enters(field, n, begins, felt) for n in begins}
        concerned = {n: t for n, t in concerned.items() if np.isfinite(t) and _has(world, n, field)}
        if field == "mass":
            ordered = [o.name for o in world.objects if o.name in met and o.name in concerned]
            concerned = {n: concerned[n] for n in ordered[1:]}
        if not concerned:
            continue
        if field in shared:
            # The objects that the tracks say nothing about get the value too: a better guess than their default.
            others = [o.name for o in world.objects if o.name not in concerned and _has(world, o.name, field)]
            begin = min(concerned.values())
            parameters.append(_physical(world, field, field, list(concerned), begin, states, others=others))
        else:
            parameters += [_physical(world, f"{n}.{field}", field, [n], t, states) for n, t in concerned.items()]
    if effects:
        parameters += _effects(world, begins)
    if time_base:
        spf = world.time.seconds_per_frame
        lower, upper = max(SECONDS_PER_FRAME.lower, 0.3 * spf), 3.0 * spf
        parameters.append(
            FitParameter("seconds_per_frame", ("time.seconds_per_frame",), lower, upper, spf, 0.3, scale="log")
        )
    begun = begun_from_slowing(world, tracks, states, parameters)
    return begun + material_parameters(world, tracks, materials, initial_conditions=initial_conditions)


def _check_fields(shared: Sequence[str], each: Sequence[str]) -> None:
    unknown = sorted({*shared, *each} - set(PHYSICAL))
    if unknown:
        raise ValueError(f"unknown object parameters {unknown}; choices: {list(PHYSICAL)}")
    both = sorted(set(shared) & set(each))
    if both:
        raise ValueError(f"{both} cannot be both shared by all objects and fitted for each")
    if "mass" in shared:
        raise ValueError("a mass shared by all objects cannot be told from motion: fit it for each object")


def _enters(field: str, name: str, begins: dict[str, float], touched: dict[str, float]) -> float:
    if field in ("restitution", "mass"):
        return touched.get(name, np.inf)
    return begins[name]


def _has(world: World, name: str, field: str) -> bool:
    kind = world.object(name).shape.kind
    if field == "torsional_radius":
        return kind != "sphere"  # a ball rests on a point
    return field != "rolling_resistance" or kind in ("sphere", "cylinder", "capsule")


def _initial_conditions(
    world: World, state: InitialState, begin: float, axes: np.ndarray, tracks: ObservedTracks
) -> list[FitParameter]:
    name = state.name
    directions = _in_plane(axes) if world.planar else "xyz"
    made: list[FitParameter] = []

    def add(field: str, axis: str, deviation: float, least: float) -> None:
        path = f"objects.{name}.{field}.{axis}"
        value = read_parameter(world, path)
        centre = 0.0 if value is None else value
        sd = deviation if np.isfinite(deviation) and deviation > 0.0 else least
        reach = max(REACH * sd, least)
        spec = specification(world, path)
        made.append(
            FitParameter(
                f"{name}.{field}.{axis}",
                (path,),
                max(spec.lower, centre - reach),
                min(spec.upper, centre + reach),
                centre,
                min(max(sd, 0.1 * least), reach / 2),
                enters=begin,
            )
        )

    for axis in directions:
        add("position", axis, state.position_sd, LEAST_POSITION)
    if state.moves:
        for axis in directions:
            add("velocity", axis, state.velocity_sd, LEAST_VELOCITY)
    turning = _across(axes) if world.planar else "xyz"
    compared = tracks.symmetry[tracks.index(name)] != 0 or not world.planar
    if state.orientation is not None and compared:
        for axis in turning:
            add("rotation", axis, state.orientation_sd, LEAST_ANGLE)
        if state.moves:
            for axis in turning:
                add("angular_velocity", axis, state.angular_velocity_sd, LEAST_SPIN)
    return made


def _physical(
    world: World,
    name: str,
    field: str,
    objects: list[str],
    begin: float,
    states: dict[str, InitialState],
    *,
    others: Sequence[str] = (),
) -> FitParameter:
    spec = OBJECT_PARAMETERS[field]
    paths = tuple(f"objects.{n}.{field}" for n in (*objects, *others))
    lower, upper = spec.search
    value = read_parameter(world, paths[0])
    centre = float(np.clip(0.0 if value is None else value, lower, upper))
    if field == "mass":
        # A ratio: as likely half as double. Bounded by what rigid collisions in one video can tell apart.
        centre = max(float(value or 1.0), spec.lower)
        return FitParameter(name, paths, centre / 5.0, centre * 5.0, centre, 0.3, scale="log", enters=begin)
    if field in ("friction", "linear_damping") and not world.deformables:
        lower, upper, centre = _from_deceleration(world, field, objects, states, lower, upper, centre)
    sd = OPENING * (upper - lower)
    # A beginning on a bound would put half of the first samples on it.
    centre = float(np.clip(centre, lower + 0.5 * sd, upper - 0.5 * sd))
    return FitParameter(name, paths, lower, upper, centre, sd, enters=begin)


def _from_deceleration(
    world: World,
    field: str,
    objects: list[str],
    states: dict[str, InitialState],
    lower: float,
    upper: float,
    centre: float,
) -> tuple[float, float, float]:
    # What slows an object down bounds each of the laws that may do it; each alone explains at most all of it.
    moving = [states[n] for n in objects if np.linalg.norm(states[n].velocity) > 0.0]
    gravity = float(np.linalg.norm(world.environment.gravity))
    if not moving or not world.planar or (field == "friction" and gravity == 0.0):
        return lower, upper, centre
    if field == "friction":
        most = max(s.deceleration for s in moving) / gravity
    else:
        most = max(s.deceleration / float(np.linalg.norm(s.velocity)) for s in moving)
    upper = float(np.clip(2.0 * most + 0.02 * upper, 0.02 * upper, upper))
    return lower, upper, float(np.clip(0.5 * most, lower, upper))


def _effects(world: World, begins: dict[str, float]) -> list[FitParameter]:
    made: list[FitParameter] = []
    for effect in world.effects:
        acting = [t for n, t in begins.items() if effect.objects is None or n in effect.objects]
        if not effect.enabled or not acting:
            continue
        for key, spec in law_of(effect).parameters.items():
            lower, upper = spec.search
            centre = float(np.clip(effect.parameters.get(key, spec.default), lower, upper))
            path = f"effects.{effect.name}.{key}"
            made.append(
                FitParameter(
                    f"{effect.name}.{key}", (path,), lower, upper, centre, OPENING * (upper - lower), enters=min(acting)
                )
            )
    return made


def _in_plane(axes: np.ndarray) -> str:
    # World axes that lie in the motion plane; an oblique plane needs all three components to be varied.
    inside = "".join(a for i, a in enumerate("xyz") if abs(axes[2, i]) < 1e-9)
    return inside if len(inside) == 2 else "xyz"


def _across(axes: np.ndarray) -> str:
    return "xyz"[int(np.argmax(np.abs(axes[2])))]
