"""Every number of a world that can be read, fitted or intervened on, by path, with unit and bounds.

A path is text with dots, for example `objects.red.friction`, `objects.red.velocity.x`,
`environment.gravity.z`, `statics.wall.position.x`, `effects.air.coefficient`, `time.seconds_per_frame`.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from polyworld.expressions.effect import law_of
from polyworld.world import Deformable, StaticObject, World, geometry
from polyworld.world.joints import carry_springs
from polyworld.world.materials import PLANAR, material, material_of
from polyworld.world.parameter_tables import (
    ANCHOR_PARAMETERS,
    EMITTER_PARAMETERS,
    GRAVITY,
    JOINT_PARAMETERS,
    MOTOR_PARAMETERS,
    OBJECT_PARAMETERS,
    OBSERVER_PARAMETERS,
    ORIGIN,
    PULLEY_PARAMETERS,
    SECONDS_PER_FRAME,
    STATE_PARAMETERS,
    STATIC_PARAMETERS,
    STATIC_POSE,
    ParameterSpec,
)
from polyworld.world.representations.rigid import RigidObject


def parameter_paths(world: World) -> dict[str, ParameterSpec]:
    """Every path of a world with its specification."""
    paths: dict[str, ParameterSpec] = {}
    for item in world.objects:
        for field, spec in {**OBJECT_PARAMETERS, **STATE_PARAMETERS}.items():
            paths[f"objects.{item.name}.{field}"] = spec
    for soft in world.deformables:
        entry = material_of(soft)
        for field, spec in {**entry.parameters, **entry.state}.items():
            paths[f"objects.{soft.name}.{field}"] = spec
    for static in world.statics:
        for field, spec in {**STATIC_PARAMETERS, **STATIC_POSE}.items():
            paths[f"statics.{static.name}.{field}"] = spec
    for pulley in world.pulleys:
        for field, spec in PULLEY_PARAMETERS.items():
            paths[f"pulleys.{pulley.name}.{field}"] = spec
    for emitter in world.emitters:
        planar = world.deformable(emitter.fluid).representation.endswith(PLANAR)
        for field, spec in EMITTER_PARAMETERS.items():
            paths[f"emitters.{emitter.name}.{field}"] = replace(spec, unit="m^2/s") if planar else spec
    for joint in world.joints:
        for field, spec in JOINT_PARAMETERS.items():
            if getattr(joint, field, None) is not None:
                paths[f"joints.{joint.name}.{field}"] = spec
        motor = getattr(joint, "motor", None)
        for field, spec in MOTOR_PARAMETERS.items() if motor is not None else ():
            if getattr(motor, field) is not None:  # one of constant effort aims at no speed
                paths[f"joints.{joint.name}.motor.{field}"] = spec
    for joint in world.joints:
        for field, spec in ANCHOR_PARAMETERS.items():
            if hasattr(joint, field[:-2]):
                paths[f"joints.{joint.name}.{field}"] = spec
    for axis in "xyz":
        paths[f"environment.gravity.{axis}"] = GRAVITY
    paths["environment.motion_plane.friction"] = OBJECT_PARAMETERS["friction"]
    for effect in world.effects:
        for name, parameter in law_of(effect).parameters.items():
            paths[f"effects.{effect.name}.{name}"] = ParameterSpec(
                parameter.unit, parameter.lower, parameter.upper, parameter.search, parameter.description
            )
    paths["time.seconds_per_frame"] = SECONDS_PER_FRAME
    paths["time.origin"] = ORIGIN
    if world.observer is not None:
        paths |= {f"observer.{field}": spec for field, spec in OBSERVER_PARAMETERS.items()}
    return paths


def specification(world: World, path: str) -> ParameterSpec:
    """Unit and bounds of one path; raises KeyError naming the closest choices."""
    paths = parameter_paths(world)
    if path in paths:
        return paths[path]
    head = path.rsplit(".", 1)[0]
    near = [p for p in paths if p.startswith((path + ".", head + "."))]
    if not near and path.count("."):  # what the named part has
        near = [p for p in paths if p.startswith(".".join(path.split(".")[:2]) + ".")]
    heads = sorted(
        {".".join(p.split(".")[:2]) + ".*" for p in paths if p.count(".") >= 2}
        | {"time.seconds_per_frame", "time.origin"}
    )
    close = difflib.get_close_matches(path, paths, n=1, cutoff=0.8)
    if path == f"{head}.density" and f"{head}.mass" in paths:  # a density sets a body's mass once, when it is built
        close = [f"{head}.mass"]
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise KeyError(f"unknown parameter {path!r}{hint}; choices: {near or heads}")


def check_differs_per_world(world: World, path: str) -> None:
    """Raise ValueError for a parameter that all worlds of a batch share, so that it cannot be fitted."""
    parts = path.split(".")
    if parts[0] == "observer":
        raise ValueError(
            f"{path} belongs to the observer and moves nothing, so it cannot be fitted to motion: "
            "look for the observer's faults in the gap"
        )
    if world.coupled and parts[0] == "statics" and len(parts) == 4:
        raise ValueError(
            f"{path} is the same in all worlds that a fit tries where there are deformable objects, so it cannot be "
            "fitted: set it with set_parameter; of a static friction and restitution can be fitted"
        )


def read_parameter(world: World, path: str) -> float | None:
    """Value of a path; None for a static or plane coefficient that is left to the touching object."""
    specification(world, path)
    parts = path.split(".")
    if parts[0] == "objects":
        if world.is_rigid(parts[1]):
            return _read_object(world, world.object(parts[1]), parts[2:])
        return _read_deformable(world.deformable(parts[1]), parts[2:])
    if parts[0] in ("pulleys", "emitters", "joints"):
        part: Any = next(x for x in getattr(world, parts[0]) if x.name == parts[1])
        for field in parts[2:]:
            part = part["xyz".index(field)] if isinstance(part, tuple) else getattr(part, field)
        return float(part)
    if parts[0] == "statics":
        return _static_value(world, parts[1], parts[2:])
    if parts[0] == "environment" and parts[1] == "gravity":
        return world.environment.gravity["xyz".index(parts[2])]
    if parts[0] == "environment":
        return world.environment.motion_plane.friction
    if parts[0] == "effects":
        effect = next(e for e in world.effects if e.name == parts[1])
        return effect.parameters.get(parts[2], law_of(effect).parameters[parts[2]].default)
    if world.observer is not None and parts[0] == "observer":
        return world.observer.values[path]
    return world.time.origin if parts[1] == "origin" else world.time.seconds_per_frame


def with_parameters(world: World, values: Mapping[str, float]) -> World:
    """A child world with some values changed; raises ValueError for a value outside its bounds."""
    data: dict[str, Any] = world.model_dump()
    turns: dict[str, list[float]] = {}
    shifts: dict[str, list[float]] = {}
    soft = {d.name for d in world.deformables}
    for path, value in values.items():
        spec = specification(world, path)
        if not (np.isfinite(value) and spec.lower <= value <= spec.upper):
            raise ValueError(f"{path} = {value} is outside its bounds {spec.lower} to {spec.upper} {spec.unit}")
        parts = path.split(".")
        if parts[0] == "objects" and parts[1] in soft:
            item = next(d for d in data["deformables"] if d["name"] == parts[1])
            if parts[2] == "shift":
                shifts.setdefault(parts[1], [0.0, 0.0, 0.0])["xyz".index(parts[3])] = float(value)
            elif len(parts) == 4:
                item[parts[2]] = _replace(item[parts[2]], "xyz".index(parts[3]), float(value))
            else:
                item[parts[2]] = float(value)
        elif parts[0] == "joints" and parts[2] in ("anchor", "other_anchor"):
            part = next(d for d in data["joints"] if d["name"] == parts[1])
            part[parts[2]] = _replace(part[parts[2]], "xyz".index(parts[3]), float(value))
        elif parts[0] in ("pulleys", "emitters", "joints"):
            part = next(d for d in data[parts[0]] if d["name"] == parts[1])
            (part["motor"] if parts[2] == "motor" else part)[parts[-1]] = float(value)
        elif parts[0] in ("objects", "statics"):
            item = next(d for d in data[parts[0]] if d["name"] == parts[1])
            if parts[2] == "rotation":
                turns.setdefault(parts[1], [0.0, 0.0, 0.0])["xyz".index(parts[3])] = float(value)
            elif len(parts) == 4:
                item[parts[2]] = _replace(item[parts[2]], "xyz".index(parts[3]), float(value))
            else:
                item[parts[2]] = float(value)
        elif parts[0] == "environment" and parts[1] == "gravity":
            gravity = data["environment"]["gravity"]
            data["environment"]["gravity"] = _replace(gravity, "xyz".index(parts[2]), float(value))
        elif parts[0] == "environment":
            data["environment"]["motion_plane"]["friction"] = float(value)
        elif parts[0] == "effects":
            effect = next(d for d in data["effects"] if d["name"] == parts[1])
            effect["parameters"] = {**effect["parameters"], parts[2]: float(value)}
        elif parts[0] == "observer" and len(parts) == 3:
            vector = data["observer"][parts[1]]
            data["observer"][parts[1]] = _replace(vector, "xyz".index(parts[2]), float(value))
        elif parts[0] == "observer":
            data["observer"][parts[1]] = float(value)
        elif path == "time.origin":
            data["time"]["origin"] = float(value)
        else:
            ratio = float(value) / world.time.seconds_per_frame
            data["time"]["seconds_per_frame"] = float(value)
            for item in (*data["objects"], *data["deformables"]):  # an object joins at a frame: keep the frame
                if "start_time" in item:
                    item["start_time"] *= ratio
    for name, shift in shifts.items():
        shift_deformable(next(d for d in data["deformables"] if d["name"] == name), shift)
    for name, vector in turns.items():
        item = next(d for d in (*data["objects"], *data["statics"]) if d["name"] == name)
        turned = geometry.quaternion_product(
            geometry.rotation_quaternion(np.asarray(vector)), np.asarray(item["orientation"])
        )
        item["orientation"] = tuple(float(x) for x in turned)
    carry_springs(world, data)
    return World.model_validate(data)


def shift_deformable(item: dict[str, Any], shift: Sequence[float]) -> None:
    """Displace the start of a deformable object, given as its JSON-like description, by a vector [m]."""
    material(item["representation"]).moved(item, lambda point: _sum(point, shift), None)


def object_mass(item: RigidObject) -> float:
    """Mass [kg]: as given, else density times volume."""
    if item.mass is not None:
        return item.mass
    return item.density * geometry.mass_properties(item.shape).volume


def torsional_radius(world: World, item: RigidObject) -> float:
    """Radius of the spinning-friction patch [m]: as given, else the default its representation implies."""
    if item.torsional_radius is not None:
        return item.torsional_radius
    if item.representation == "rigid_spatial":
        return 0.0
    axes = geometry.plane_axes(world.environment.motion_plane)
    rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
    outline, _ = geometry.planar_outline(item.shape, rotation, axes)
    return geometry.footprint_radius(item.shape, outline)


def _read_object(world: World, item: RigidObject, field: list[str]) -> float:
    if field[0] == "mass":
        return object_mass(item)
    if field[0] == "torsional_radius":
        return torsional_radius(world, item)
    if field[0] == "rotation":  # measured from the orientation the world already has
        return 0.0
    value = getattr(item, field[0])
    return float(value["xyz".index(field[1])] if len(field) == 2 else value)


def _read_deformable(item: Deformable, field: list[str]) -> float | None:
    if field[0] == "shift":  # measured from where the world already starts it
        return 0.0
    value = getattr(item, field[0])
    if value is None:
        return None
    return float(value["xyz".index(field[1])] if len(field) == 2 else value)


def _static_value(world: World, name: str, field: list[str]) -> float | None:
    static: StaticObject = next(s for s in world.statics if s.name == name)
    if field[0] == "rotation":  # measured from the orientation the world already has
        return 0.0
    if field[0] == "position":
        return static.position["xyz".index(field[1])]
    value: float | None = getattr(static, field[0])
    return value


def _sum(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (float(x + y) for x, y in zip(a, b, strict=True))
    return x, y, z


def _replace(vector: tuple[float, ...], index: int, value: float) -> tuple[float, ...]:
    changed = list(vector)
    changed[index] = value
    return tuple(changed)
