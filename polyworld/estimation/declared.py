"""Declare the unknowns of a study: constants tied by material, with what is ordinary as priors, and initial states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polyworld.data.initial_states import InitialState, initial_states
from polyworld.estimation.fit_settings import PriorSettings
from polyworld.estimation.stretches import Stretch
from polyworld.estimation.study import Study
from polyworld.estimation.unknown import Unknown
from polyworld.world import Effect, World, geometry
from polyworld.world.parameters import specification
from polyworld.world.representations.rigid import RigidObject

AIR = "air"
PLANE = "environment.motion_plane.friction"


def group(item: RigidObject) -> str:
    """Return what an object's constants are tied by: its material where one is stated, else itself."""
    return item.appearance.material or item.name


def with_resistance(world: World) -> World:
    """Return the world with quadratic damping at rate 0, and a coefficient of the planar surface's own."""
    effects = world.effects
    if not any(e.kind in ("quadratic_damping", "quadratic_drag") for e in effects):
        effects = (*effects, Effect(name=AIR, kind="quadratic_damping", parameters={"rate": 0.0}))
    return world.model_copy(update={"effects": effects})


def constants(study: Study, settings: PriorSettings) -> list[Unknown]:
    """Declare friction and restitution by material, the surface's friction, dampings shared by all, unstated masses.

    Friction is that against the surface, which a contact has as the geometric mean of both coefficients: the object's
    own is its square over the surface's, and a pair of bodies has the product over the surface's.
    """
    groups: dict[str, list[str]] = {}
    damped: list[str] = []
    for run in study.runs:
        for item in run.world.objects:
            groups.setdefault(group(item), []).append(item.name)
            damped.append(item.name)
    surface = _surface(study)
    found: list[Unknown] = []
    for name, objects in groups.items():
        own = tuple(dict.fromkeys(f"objects.{n}.friction" for n in objects))
        known = [v for word, v in settings.friction_of.items() if word in name.lower()]
        mean, sd = (float(np.log(known[0][0])), known[0][1]) if known else settings.ln_friction
        start = float(np.exp(mean))
        paths, powers = own, (2.0,) * len(own) if surface else ()
        found.append(
            Unknown(f"friction of {name}", paths, "1", start, 5e-3, 2.0, sd, prior=(mean, sd), scale="log", powers=powers)
        )
    if surface:
        mean, sd = settings.ln_surface
        every = tuple(dict.fromkeys(f"objects.{n}.friction" for n in damped))
        paths, powers = (*surface, *every), (1.0,) * len(surface) + (-1.0,) * len(every)
        found.append(
            Unknown("friction of the surface", paths, "1", float(np.exp(mean)), 5e-3, 7.0, sd, prior=(mean, sd),
                    scale="log", powers=powers)  # fmt: skip
        )
    for name, objects in groups.items():
        paths = tuple(dict.fromkeys(f"objects.{n}.restitution" for n in objects))
        mean, sd = settings.restitution
        found.append(Unknown(f"restitution of {name}", paths, "1", mean, 0.0, 1.0, sd, prior=(mean, sd)))
    every = tuple(dict.fromkeys(f"objects.{n}.linear_damping" for n in damped))
    sd = settings.linear_damping
    found.append(Unknown("linear_damping", every, "1/s", sd / 3.0, 0.0, 20.0 * sd, sd, prior=(0.0, sd)))
    sd = settings.quadratic_damping
    found.append(Unknown("quadratic_damping", (f"effects.{AIR}.rate",), "1/m", sd / 2.0, 0.0, 10.0 * sd, sd, prior=(0.0, sd)))
    return found


def _surface(study: Study) -> tuple[str, ...]:
    """Paths of the friction of what bodies move on: the motion plane, or fixed things."""
    first = study.runs[0].world
    if first.planar:
        return (PLANE,) if first.environment.motion_plane.supports else ()
    return tuple(dict.fromkeys(f"statics.{s.name}.friction" for run in study.runs for s in run.world.statics))


def states(stretch: Stretch, settings: PriorSettings) -> list[Unknown]:
    """Declare the initial states of a stretch: places of all tracked bodies, velocities of those that move."""
    world, tracks = stretch.world, stretch.tracks
    frame, gravity = world.time.seconds_per_frame, world.environment.gravity
    seen = initial_states(tracks, seconds_per_frame=frame, gravity=gravity)
    found: list[Unknown] = []
    for item in world.objects:
        state = seen.get(item.name)
        if state is None and stretch.link is None and stretch.begin == 0.0:
            continue  # never observed: as the world has it
        found += _of_body(world, item, state, tracks.symmetry[tracks.index(item.name)] if item.name in tracks.names else 0)
    return found


def _of_body(world: World, item: RigidObject, state: InitialState | None, symmetry: int) -> list[Unknown]:
    normal = geometry.plane_axes(world.environment.motion_plane)[2]
    axes = "".join(a for i, a in enumerate("xyz") if not (world.planar and abs(normal[i]) > 1.0 - 1e-9))
    moves = state is None or state.moves
    fields = [("position", axes, 0.01)] + ([("velocity", axes, 0.1)] if moves else [])
    if state is not None and state.orientation is not None and symmetry != 0:
        about = "xyz"[int(np.argmax(np.abs(normal)))] if world.planar else "xyz"
        fields += [("rotation", about, 0.05)] + ([("angular_velocity", about, 0.5)] if moves else [])
    found = []
    for field, components, typical in fields:
        for k in components:
            path = f"objects.{item.name}.{field}.{k}"
            spec = specification(world, path)
            start = 0.0 if field == "rotation" else float(getattr(item, field)["xyz".index(k)])
            found.append(Unknown(path.removeprefix("objects."), (path,), spec.unit, start, spec.lower, spec.upper, typical))
    return found


def bounds_in_coordinates(unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds (S,) in the coordinates in which unknowns are varied."""
    low = np.array([np.log(u.lower) if u.scale == "log" else u.lower for u in unknowns])
    high = np.array([np.log(u.upper) if u.scale == "log" else u.upper for u in unknowns])
    return low, high
