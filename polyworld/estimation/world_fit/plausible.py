"""Unknowns of a spatial world of rigid bodies, with what is ordinary of them as priors, and no motion that a support
forbids.

A short clip shows some parameters well, some hardly and some not at all. Gaussian priors that cover what ordinary
materials have keep the latter where a person would guess them, and leave the former to the data.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.support import Support, supports
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.determinable import Shown
from polyworld.estimation.world_fit.settings import OrdinarySettings
from polyworld.world import World
from polyworld.world.parameters import read_parameter, specification
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Capsule, Cylinder, Sphere


def plausible_unknowns(
    world: World, tracks: ObservedTracks, unknowns: Sequence[Unknown], settings: OrdinarySettings | None = None
) -> list[Unknown]:
    """Give the unknowns of a spatial world priors, drop motion that supports and sliders forbid, add unobserved spins.

    Added too: rolling resistance of what can roll, restitution of fixed things that bodies bounce on and friction of
    those they lie on, where collisions among bodies show another. Bodies of one shape and size, at least
    `settings.alike` of them, such as the balls of a game, share their contact parameters and have equal masses.
    """
    settings = settings or OrdinarySettings()
    shown = Shown(world, tracks)
    on = supports(world, tracks)
    found = [with_prior(world, u, settings) for u in unknowns if not _forbidden(u, on) and not _guided(world, u)]
    taken = {path for u in found for path in u.paths}
    for name, begin in shown.begins.items():
        item, state = world.object(name), shown.states[name]
        if isinstance(item.shape, Sphere | Cylinder | Capsule):
            path = f"objects.{name}.rolling_resistance"
            if path not in taken:
                found.append(_rolling(world, item, begin, settings))
        if state.moves and not _held(world, name):
            found += [_spin(world, item, on.get(name), axis, begin, settings) for axis in _spins(item, on.get(name))
                      if f"objects.{name}.angular_velocity.{axis}" not in taken]  # fmt: skip
    return [*_shared(world, found, settings.alike), *_of_statics(world, shown, on, settings)]


def _shared(world: World, unknowns: list[Unknown], alike: int) -> list[Unknown]:
    """Tie the contact parameters of bodies that are alike, and drop their masses."""
    groups: dict[str, list[str]] = {}
    for item in world.objects:
        groups.setdefault(item.shape.model_dump_json(), []).append(item.name)
    first = {name: own[0] for own in groups.values() if len(own) >= alike for name in own}
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


def _of_statics(world: World, shown: Shown, on: dict[str, Support], settings: OrdinarySettings) -> list[Unknown]:
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
        ("restitution", settings.restitution, 1.0, bounced),
        ("friction", settings.friction, settings.most_friction, lain),
    ):
        own = [name for name in since if getattr(statics[name], field) is None]
        if own:
            paths = tuple(f"statics.{name}.{field}" for name in own)
            begin = min(since[name] for name in own)
            name = f"{field} of {', '.join(own)}"
            found.append(Unknown(name, paths, "1", mean, 0.0, most, sd, prior=(mean, sd), enters=begin))
    return found


def joint_unknowns(world: World, tracks: ObservedTracks, settings: OrdinarySettings | None = None) -> list[Unknown]:
    """Dry friction and damping of hinges and sliders whose bodies are seen to move, as candidates for a fit."""
    most_joint = (settings or OrdinarySettings()).joint
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
        sizes = {"friction": most_joint * weight * lever, "damping": most_joint * 10.0 * inertia}
        for field, most in sizes.items():
            path = f"joints.{joint.name}.{field}"
            spec = specification(world, path)
            start = min(max(read_parameter(world, path) or 0.0, 0.0), most)
            found.append(Unknown(f"{joint.name}.{field}", (path,), spec.unit, start, 0.0, most, 0.1 * most))
    return found


def _forbidden(unknown: Unknown, on: dict[str, Support]) -> bool:
    """Return whether an unknown is a component of a state that a level support fixes."""
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


def _guided(world: World, unknown: Unknown) -> bool:
    """Return whether an unknown is a component of a velocity that a slider to the world takes up at once."""
    parts = unknown.paths[0].split(".")
    if parts[0] != "objects" or len(parts) != 4 or parts[2] not in ("velocity", "angular_velocity"):
        return False
    sliders = [j for j in world.joints if j.kind == "slider" and j.object == parts[1] and j.other is None]
    axes = [np.asarray(j.axis) / np.linalg.norm(j.axis) for j in sliders]
    return any(parts[2] == "angular_velocity" or abs(axis["xyz".index(parts[3])]) < 1e-9 for axis in axes)


def with_prior(world: World, unknown: Unknown, settings: OrdinarySettings | None = None) -> Unknown:
    """Return the unknown with what is ordinary of a contact parameter or a mass as its prior."""
    if unknown.prior is not None or len(unknown.paths) != 1 or not unknown.paths[0].startswith("objects."):
        return unknown
    settings = settings or OrdinarySettings()
    field = unknown.paths[0].split(".")[-1]
    if field in ("friction", "restitution"):
        mean, sd = settings.friction if field == "friction" else settings.restitution
        upper = max(settings.most_friction, unknown.upper) if field == "friction" else unknown.upper
        return replace(unknown, prior=(mean, sd), start=mean, typical=sd, upper=upper)
    if field == "mass":
        return replace(unknown, prior=(unknown.start, settings.mass * unknown.start))
    if field == "rolling_resistance":
        return _rolling(world, world.object(unknown.paths[0].split(".")[1]), unknown.enters, settings)
    return unknown


def _rolling(world: World, item: RigidObject, begin: float, settings: OrdinarySettings) -> Unknown:
    assert isinstance(item.shape, Sphere | Cylinder | Capsule)
    path, usual = f"objects.{item.name}.rolling_resistance", settings.rolling * item.shape.radius
    spec = specification(world, path)
    name = path.removeprefix("objects.")
    most = settings.most_rolling * item.shape.radius
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


def _spin(
    world: World, item: RigidObject, support: Support | None, axis: str, begin: float, settings: OrdinarySettings
) -> Unknown:
    assert isinstance(item.shape, Sphere | Cylinder | Capsule)
    path = f"objects.{item.name}.angular_velocity.{axis}"
    start = read_parameter(world, path) or 0.0
    sd = settings.surface_speed / item.shape.radius
    if support is not None:
        sd = max(settings.slip * float(np.linalg.norm(item.angular_velocity)), 0.1 * sd)
    name = path.removeprefix("objects.")
    lower, upper = start - settings.reach * sd, start + settings.reach * sd
    return Unknown(name, (path,), "rad/s", start, lower, upper, sd, prior=(start, sd), enters=begin)
