"""A sensible list of unknowns for a world and its tracks, with bounds and starts taken from the tracks."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from polyworld.data.initial_states import InitialState
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.determinable import Shown
from polyworld.estimation.world_fit.slowing import started_from_slowing
from polyworld.expressions.effect import law_of
from polyworld.world import Deformable, World, geometry
from polyworld.world.materials import kinds, material, material_of
from polyworld.world.parameter_tables import OBJECT_PARAMETERS
from polyworld.world.parameters import read_parameter, specification

# Bounds of initial states reach this many standard deviations, and at least these distances, around the
# track's own estimate: a polynomial over the first samples is biased where drag or a collision bends it.
REACH = 5.0
LEAST_POSITION, LEAST_VELOCITY, LEAST_ANGLE, LEAST_SPIN = 0.01, 0.05, 0.05, 0.3
SHIFT_SD, VELOCITY_SD = 0.02, 0.2  # [m], [m/s] of a soft body
OPENING = 0.25  # a search begins with this share of a parameter's range as standard deviation
DECADES, DOUBLE = 100.0, 2.0  # a value outside the usual range is searched within this factor of itself
MASS_RATIO, MASS_SD = 5.0, 0.3  # of what rigid collisions in one video can distinguish; as likely half as double
CLOCK_RATIO, CLOCK_SD = 3.0, 0.3


def default_unknowns(
    world: World,
    tracks: ObservedTracks,
    *,
    shared: Sequence[str] = ("linear_damping", "angular_damping"),
    each: Sequence[str] = ("friction", "restitution", "mass"),
    initial_conditions: bool = True,
    effects: bool = True,
    time_base: bool = False,
    materials: Sequence[str] | None = None,
) -> list[Unknown]:
    """List the unknowns of a fit of `world` to `tracks`, only those that the tracks can show.

    shared: object parameters that get one value for all objects; each: one value per object. Both name fields
    of `polyworld.world.parameters.OBJECT_PARAMETERS`. Of the objects that may touch each other the mass of the
    first is kept, since motion shows only ratios, and is the unit of the others. initial_conditions: position,
    velocity, rotation and spin of every object that moves at first, position and rotation of those that are
    moved later, shift and velocity of soft bodies that nothing holds. effects: coefficients of the world's enabled
    effects. time_base: seconds_per_frame, when it is not given. materials: fields of the
    materials' parameters, fitted for every observed deformable object that has them; default: those that their entries
    in the registry name, with the density of a fluid beside another fluid, friction of pulleys and rate of emitters.

    Left out: objects without a track or which neither move nor are reached by anything; contact parameters of
    objects that nothing reaches. These keep what the world has, except that a shared value is everybody's.
    Raises ValueError for unknown fields or fields in both lists.
    """
    _check_fields(shared, each, materials)
    shown = Shown(world, tracks)
    found: list[Unknown] = []
    if initial_conditions:
        for name, begin in shown.begins.items():
            found += _initial_state(world, tracks, shown.states[name], begin)
    for field in (*shared, *each):
        found += _physical(shown, field, field in shared)
    for effect in world.effects if effects else ():
        acting = [t for n, t in shown.begins.items() if effect.objects is None or n in effect.objects]
        if effect.enabled and acting:
            paths = [f"effects.{effect.name}.{key}" for key in law_of(effect).parameters]
            found += [_searched(world, (path,), min(acting)) for path in paths]
    if time_base:
        found.append(_within(world, "time.seconds_per_frame", CLOCK_RATIO, CLOCK_SD))
    found = started_from_slowing(world, tracks, shown.states, found)
    for item in world.deformables:
        if item.name not in shown.observed:
            continue
        table, begin = material_of(item).parameters, float(getattr(item, "start_time", 0.0))
        chosen = _material(world, item) if materials is None else materials
        found += [_searched(world, (f"objects.{item.name}.{f}",), begin) for f in chosen if f in table]
        held = any(item.name in (a.object, a.to) for a in world.attachments)
        if initial_conditions and material_of(item).turns and not held:
            for axis in _axes(world):
                found.append(_state(world, item.name, f"shift.{axis}", SHIFT_SD, 0.0, begin))
                found.append(_state(world, item.name, f"velocity.{axis}", VELOCITY_SD, 0.0, begin))
    if materials is None:
        for pulley in world.pulleys:
            if pulley.rope in shown.observed:  # a wheel that cannot turn rubs on the rope; one that can has a bearing
                field = "friction" if pulley.fixed_wheel else "bearing_friction"
                found.append(_searched(world, (f"pulleys.{pulley.name}.{field}",)))
        for emitter in world.emitters:
            if emitter.fluid in shown.observed:
                found.append(_searched(world, (f"emitters.{emitter.name}.rate",), emitter.start))
    return found


def unknown_of(world: World, path: str) -> Unknown:
    """Return the unknown of one physical parameter over the range that a fit searches by default."""
    if path.endswith(".mass") and path.startswith("objects."):
        return _within(world, path, MASS_RATIO, MASS_SD)
    return _searched(world, (path,))


def states_at_rest(shown: Shown, fitted: Collection[str]) -> list[Unknown]:
    """List position and heading of tracked objects that no fit varies because they do not move, each with a prior.

    The prior is the world's own value, with the scatter of the track over the square root of its samples. Along
    gravity an object rests on something: that component stays, and so does what a joint or a rope holds. fitted: paths
    that a fit varies.
    """
    world = shown.world
    found: list[Unknown] = []
    held = {name for joint in world.joints for name in (joint.object, joint.other)} | shown.tied
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    up = int(np.argmax(np.abs(normal if world.planar else np.asarray(world.environment.gravity))))
    for item in world.objects:
        state = shown.states.get(item.name)
        if state is None or state.moves or item.name in held:
            continue
        if any(p.startswith(f"objects.{item.name}.position.") for p in fitted):
            continue
        column = shown.tracks.index(item.name)
        seen = shown.tracks.confidence[:, column] > 0.0
        stated = float(np.median(shown.tracks.coordinate_sigma[seen, column]))
        scatter = state.noise if np.isfinite(state.noise) else 0.0
        sd = max(stated, scatter) / np.sqrt(state.samples)
        found += [_known(world, f"objects.{item.name}.position.{'xyz'[k]}", sd) for k in range(3) if k != up]
        if state.orientation is not None and shown.tracks.symmetry[column] != 0 and np.isfinite(state.orientation_sd):
            found.append(_known(world, f"objects.{item.name}.rotation.{'xyz'[up]}", state.orientation_sd))
    return found


def _known(world: World, path: str, sd: float) -> Unknown:
    """Return an unknown with a Gaussian prior about the world's value."""
    spec, value = specification(world, path), read_parameter(world, path) or 0.0
    sd = max(sd, 1e-9)
    name = path.removeprefix("objects.")
    lower, upper = max(spec.lower, value - REACH * sd), min(spec.upper, value + REACH * sd)
    return Unknown(name, (path,), spec.unit, value, lower, upper, sd, prior=(value, sd))


def _check_fields(shared: Sequence[str], each: Sequence[str], materials: Sequence[str] | None) -> None:
    of_materials = {field for kind in kinds() for field in material(kind).parameters}
    for kind, given, choices in (
        ("object parameters", {*shared, *each}, OBJECT_PARAMETERS),
        ("parameters of deformable objects", set(materials or ()), sorted(of_materials)),
    ):
        unknown = sorted(given - set(choices))
        if unknown:
            raise ValueError(f"unknown {kind} {unknown}; choices: {list(choices)}")
    both = sorted(set(shared) & set(each))
    if both:
        raise ValueError(f"{both} cannot be both shared by all objects and fitted for each")
    if "mass" in shared:
        raise ValueError("masses shared by all objects do not show in motion: fit it for each object")


def _physical(shown: Shown, field: str, shared: bool) -> list[Unknown]:
    """Return unknowns of one object parameter, one for all objects that show it or one for each."""
    world = shown.world
    having = [o.name for o in world.objects if _has(o.shape.kind, field)]
    since = {n: t for n, t in shown.begins.items() if n in having}  # when each value begins to show
    if field in ("restitution", "mass"):
        felt = shown.touched | (dict.fromkeys(shown.tied, 0.0) if field == "mass" else {})
        since = {n: felt[n] for n in since if n in felt}
    if field == "mass":
        ordered = [n for n in having if n in since and n in shown.met]
        paths = {n: f"objects.{n}.mass" for n in ordered[1:]}
        return [_within(world, path, MASS_RATIO, MASS_SD, since[n]) for n, path in paths.items()]
    if not shared:
        return [_searched(world, (f"objects.{n}.{field}",), t) for n, t in since.items()]
    if not since:
        return []
    # The objects that the tracks say nothing about get the value too: a better guess than their default.
    names = (*since, *(n for n in having if n not in since))
    return [_searched(world, tuple(f"objects.{n}.{field}" for n in names), min(since.values()), name=field)]


def _has(kind: str, field: str) -> bool:
    if field == "torsional_radius":
        return kind != "sphere"  # a ball rests on a point
    return field != "rolling_resistance" or kind in ("sphere", "cylinder", "capsule")


def _searched(world: World, paths: tuple[str, ...], begin: float = 0.0, *, name: str | None = None) -> Unknown:
    """Return an unknown searched over its usual range, from the world's value where that lies inside.

    On a logarithmic scale where the range spans more than a decade above zero.
    """
    spec, value = specification(world, paths[0]), read_parameter(world, paths[0])
    lower, upper = spec.search
    name = name or paths[0].removeprefix("objects.").removeprefix("effects.")
    logarithmic = lower > 0.0 and upper / lower > 10.0
    if value is not None and value > 0.0 and not lower <= value <= upper:
        factor = DECADES if logarithmic else DOUBLE
        lower, upper = max(spec.lower, min(lower, value / factor)), min(spec.upper, max(upper, value * factor))
    if logarithmic:
        start = float(np.sqrt(lower * upper)) if value is None or value <= 0.0 else value
        sd = OPENING * float(np.log(upper / lower))
        return Unknown(name, paths, spec.unit, start, lower, upper, sd, scale="log", enters=begin)
    sd = OPENING * (upper - lower)
    middle = 0.5 * (lower + upper) if value is None else value
    # A start on a bound would put half of the first samples on it.
    start = float(np.clip(middle, lower + 0.5 * sd, upper - 0.5 * sd))
    return Unknown(name, paths, spec.unit, start, lower, upper, sd, enters=begin)


def _within(world: World, path: str, factor: float, sd: float, begin: float = 0.0) -> Unknown:
    """Return an unknown searched within a factor of the world's value, with a standard deviation of its logarithm."""
    spec, value = specification(world, path), read_parameter(world, path) or 1.0
    name = path.removeprefix("objects.").removeprefix("time.")
    lower, upper = max(spec.lower, value / factor), min(spec.upper, value * factor)
    return Unknown(name, (path,), spec.unit, value, lower, upper, sd, scale="log", enters=begin)


def _initial_state(world: World, tracks: ObservedTracks, state: InitialState, begin: float) -> list[Unknown]:
    fields = [("position", state.position_sd, LEAST_POSITION)]
    fields += [("velocity", state.velocity_sd, LEAST_VELOCITY)] if state.moves else []
    found = [
        _state(world, state.name, f"{f}.{axis}", sd, least, begin) for f, sd, least in fields for axis in _axes(world)
    ]
    if state.orientation is None or (world.planar and tracks.symmetry[tracks.index(state.name)] == 0):
        return found
    turns = [("rotation", state.orientation_sd, LEAST_ANGLE)]
    turns += [("angular_velocity", state.angular_velocity_sd, LEAST_SPIN)] if state.moves else []
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    about = "xyz"[int(np.argmax(np.abs(normal)))] if world.planar else "xyz"
    return found + [
        _state(world, state.name, f"{f}.{axis}", sd, least, begin) for f, sd, least in turns for axis in about
    ]


def _axes(world: World) -> str:
    """World axes along which objects move: an oblique motion plane needs all three to be varied."""
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    return "".join(a for i, a in enumerate("xyz") if not (world.planar and abs(normal[i]) > 1.0 - 1e-9))


def _state(world: World, name: str, field: str, deviation: float, least: float, begin: float) -> Unknown:
    """Return a component of an initial state, searched around the world's value."""
    path = f"objects.{name}.{field}"
    spec, start = specification(world, path), read_parameter(world, path) or 0.0
    sd = deviation if np.isfinite(deviation) and deviation > 0.0 else least
    reach = max(REACH * sd, least)
    sd = min(max(sd, 0.1 * least), reach / 2)
    lower, upper = max(spec.lower, start - reach), min(spec.upper, start + reach)
    return Unknown(f"{name}.{field}", (path,), spec.unit, start, lower, upper, sd, enters=begin)


def _material(world: World, item: Deformable) -> tuple[str, ...]:
    """Return parameters of a deformable object fitted by default."""
    material = material_of(item)
    # Densities enter as ratios: that of the first fluid is their unit.
    beside = material.form == "liquid" and item.name != world.of_form("liquid")[0].name
    return (*material.fitted, "density") if beside else material.fitted
