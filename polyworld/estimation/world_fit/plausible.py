"""Unknowns of a spatial world of rigid bodies, with what is ordinary of them as priors, and no motion that a support
forbids.

A short clip shows some parameters well, some hardly and some not at all. Gaussian priors that cover what ordinary
materials have keep the latter where a person would guess them, and leave the former to the data.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.determinable import Shown
from polyworld.estimation.world_fit.support import Support, supports
from polyworld.parameters import read_parameter, specification
from polyworld.representations.rigid import RigidObject
from polyworld.shapes import Capsule, Cylinder, Sphere
from polyworld.tracks import ObservedTracks
from polyworld.world import World

# Mean and standard deviation: dry contacts of wood, plastic, rubber, metal and felt mostly lie within two of them.
FRICTION, RESTITUTION = (0.35, 0.2), (0.5, 0.25)
MOST_FRICTION = 2.0
ROLLING = 0.015  # of the radius: mean and standard deviation of the lever arm of rolling resistance
MOST_ROLLING = 0.3  # of the radius
MASS = 0.6  # standard deviation as a share of the mass at the density that is assumed
SURFACE_SPEED = 0.5  # [m/s] at the surface by a spin that is not observed
SLIP = 0.5  # of the rolling spin: standard deviation of that of a body that may slide instead
REACH = 6.0  # standard deviations within which a spin is searched
ALIKE = 3  # bodies of one shape and size from which on they are taken for pieces of one set
JOINT = 0.3  # of the acceleration of gravity by dry friction, and [1/s] by damping, that a joint may cause


def plausible_unknowns(world: World, tracks: ObservedTracks, unknowns: Sequence[Unknown]) -> list[Unknown]:
    """Give the unknowns of a spatial world priors, drop the motion that supports forbid, and add unobserved spins.

    Added too: rolling resistance of what can roll, restitution of fixed things that bodies bounce on and friction of
    those they lie on, where collisions among bodies show another. Bodies of one shape and size, at least `ALIKE` of
    them, such as the balls of a game, share their contact parameters and have equal masses.
    """
    shown = Shown(world, tracks)
    on = supports(world, tracks)
    found = [with_prior(world, u) for u in unknowns if not _forbidden(u, on)]
    taken = {path for u in found for path in u.paths}
    for name, begin in shown.begins.items():
        item, state = world.object(name), shown.states[name]
        if isinstance(item.shape, Sphere | Cylinder | Capsule):
            path = f"objects.{name}.rolling_resistance"
            if path not in taken:
                found.append(_rolling(world, item, begin))
        if state.moves and not _held(world, name):
            found += [_spin(world, item, on.get(name), axis, begin) for axis in _spins(item, on.get(name))
                      if f"objects.{name}.angular_velocity.{axis}" not in taken]  # fmt: skip
    return [*_shared(world, found), *_of_statics(world, shown, on)]


def _shared(world: World, unknowns: list[Unknown]) -> list[Unknown]:
    """Tie the contact parameters of bodies that are alike, and drop their masses."""
    groups: dict[str, list[str]] = {}
    for item in world.objects:
        groups.setdefault(item.shape.model_dump_json(), []).append(item.name)
    first = {name: own[0] for own in groups.values() if len(own) >= ALIKE for name in own}
    found: dict[tuple[str, str], Unknown] = {}
    for u in unknowns:
        parts = u.paths[0].split(".")
        contact = parts[0] == "objects" and len(parts) == 3 and len(u.paths) == 1
        if not contact or parts[1] not in first:
            found[u.name, ""] = u
        elif parts[2] != "mass":
            key = (first[parts[1]], parts[2])
            if key not in found:
                own = groups[world.object(parts[1]).shape.model_dump_json()]
                paths = tuple(f"objects.{name}.{parts[2]}" for name in own)
                found[key] = replace(u, name=f"{parts[2]} of {', '.join(own)}", paths=paths)
            found[key] = replace(found[key], enters=min(found[key].enters, u.enters))
    return list(found.values())


def _of_statics(world: World, shown: Shown, on: dict[str, Support]) -> list[Unknown]:
    """Restitution of what bodies bounce on and friction of what they lie on, where they also meet one another.

    A coefficient belongs to a pair of surfaces: ball on ball is another pair than ball on cloth.
    """
    statics = {s.name: s for s in world.statics}
    bounced: dict[str, float] = {}
    meetings: list[float] = []
    for pair, time in shown.contacts.items():
        fixed = [name for name in pair if name in statics]
        if not fixed:
            meetings.append(time)
            continue
        body = next(name for name in pair if name != fixed[0])
        if body not in on or on[body].static != fixed[0]:
            bounced.setdefault(fixed[0], time)
    if not meetings:
        return []
    lain = dict.fromkeys((support.static for name, support in on.items() if name in shown.begins), min(meetings))
    found = []
    for field, (mean, sd), most, since in (
        ("restitution", RESTITUTION, 1.0, bounced),
        ("friction", FRICTION, MOST_FRICTION, lain),
    ):
        own = [name for name in since if getattr(statics[name], field) is None]
        if own:
            paths = tuple(f"statics.{name}.{field}" for name in own)
            begin = min(since[name] for name in own)
            name = f"{field} of {', '.join(own)}"
            found.append(Unknown(name, paths, "1", mean, 0.0, most, sd, prior=(mean, sd), enters=begin))
    return found


def joint_unknowns(world: World, tracks: ObservedTracks) -> list[Unknown]:
    """Dry friction and damping of hinges and sliders whose bodies are seen to move, as candidates for a fit."""
    shown = Shown(world, tracks)
    found = []
    for joint in world.joints:
        if joint.kind not in ("hinge", "slider") or joint.object not in shown.begins:
            continue
        item = world.object(joint.object)
        mass = read_parameter(world, f"objects.{item.name}.mass") or 1.0
        arm = float(np.linalg.norm(np.asarray(joint.anchor) - np.asarray(item.position)))
        inertia, lever = (mass * arm**2, arm) if joint.kind == "hinge" else (mass, 1.0)
        weight = mass * float(np.linalg.norm(world.environment.gravity))
        sizes = {"friction": JOINT * weight * lever, "damping": JOINT * 10.0 * inertia}
        for field, most in sizes.items():
            path = f"joints.{joint.name}.{field}"
            spec = specification(world, path)
            start = min(max(read_parameter(world, path) or 0.0, 0.0), most)
            found.append(Unknown(f"{joint.name}.{field}", (path,), spec.unit, start, 0.0, most, 0.1 * most))
    return found


def _forbidden(unknown: Unknown, on: dict[str, Support]) -> bool:
    """Whether an unknown is a component of a state that a level support fixes."""
    parts = unknown.paths[0].split(".")
    if parts[0] != "objects" or len(parts) != 4:
        return False
    support = on.get(parts[1])
    if support is None or not support.level:
        return False
    if parts[2] in ("position", "velocity"):
        return parts[3] == "z"
    if parts[2] == "rotation":
        return parts[3] in "xy"
    return not support.rolls and parts[3] in "xy"


def with_prior(world: World, unknown: Unknown) -> Unknown:
    """The unknown with what is ordinary of a contact parameter or a mass as its prior."""
    if unknown.prior is not None or len(unknown.paths) != 1 or not unknown.paths[0].startswith("objects."):
        return unknown
    field = unknown.paths[0].split(".")[-1]
    if field == "friction":
        upper = max(MOST_FRICTION, unknown.upper)
        return replace(unknown, prior=FRICTION, start=FRICTION[0], typical=FRICTION[1], upper=upper)
    if field == "restitution":
        return replace(unknown, prior=RESTITUTION, start=RESTITUTION[0], typical=RESTITUTION[1])
    if field == "mass":
        return replace(unknown, prior=(unknown.start, MASS * unknown.start))
    if field == "rolling_resistance":
        return _rolling(world, world.object(unknown.paths[0].split(".")[1]), unknown.enters)
    return unknown


def _rolling(world: World, item: RigidObject, begin: float) -> Unknown:
    assert isinstance(item.shape, Sphere | Cylinder | Capsule)
    path, usual = f"objects.{item.name}.rolling_resistance", ROLLING * item.shape.radius
    spec = specification(world, path)
    name = path.removeprefix("objects.")
    most = MOST_ROLLING * item.shape.radius
    return Unknown(name, (path,), spec.unit, usual, 0.0, most, usual, prior=(usual, usual), enters=begin)


def _held(world: World, name: str) -> bool:
    return any(name in (joint.object, joint.other) for joint in world.joints)


def _spins(item: RigidObject, support: Support | None) -> Collection[str]:
    """World axes about which an unobserved spin may act on what follows."""
    if not isinstance(item.shape, Sphere | Cylinder | Capsule):
        return ()
    if support is None:
        return "xyz"
    if not support.rolls:
        return ()
    return "xy" if support.level else "xyz"


def _spin(world: World, item: RigidObject, support: Support | None, axis: str, begin: float) -> Unknown:
    assert isinstance(item.shape, Sphere | Cylinder | Capsule)
    path = f"objects.{item.name}.angular_velocity.{axis}"
    start = read_parameter(world, path) or 0.0
    sd = SURFACE_SPEED / item.shape.radius
    if support is not None:
        sd = max(SLIP * float(np.linalg.norm(item.angular_velocity)), 0.1 * sd)
    name = path.removeprefix("objects.")
    lower, upper = start - REACH * sd, start + REACH * sd
    return Unknown(name, (path,), "rad/s", start, lower, upper, sd, prior=(start, sd), enters=begin)
