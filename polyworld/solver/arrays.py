"""A rigid world as plain arrays: shared fields have one row, fields that differ per world have W rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.effects import MAX_PARAMETERS
from polyworld.expressions.effect import effect_programs, law_of
from polyworld.parameters import (
    check_differs_per_world,
    object_mass,
    parameter_paths,
    specification,
    torsional_radius,
)
from polyworld.representations.joint import Joint, Spring
from polyworld.solver.spatial.joint_layout import NEVER
from polyworld.world import World

Array = NDArray[np.float64]

OWN = -1.0  # marks a static or plane coefficient that is left to the touching object


@dataclass
class RigidArrays:
    """Initial state and parameters of n objects, s statics and e effects; R is 1 or W for each field alone.

    mass, friction, restitution, rolling_resistance, torsional_radius, linear_damping, angular_damping (R, n);
    position, velocity, angular_velocity (R, n, 3); orientation (R, n, 4); static_position (R, s, 3),
    static_orientation (R, s, 4); static_friction,
    static_restitution (R, s) and plane_friction (R, 1), `OWN` where left to the touching object;
    gravity (R, 3); effect_parameters (R, e, 8); time_scale (R, 1): seconds_per_frame over the world's own;
    time_origin (R, 1) [s].
    joint_friction, joint_damping, joint_stiffness, and motor_target_speed, motor_limit, motor_delay of the joints'
    motors (R, joints): 0 where a joint has none. joint_anchor, joint_other_anchor (R, joints, 3) [m]: the points of
    the joint's object and of the other, world axes, at the start; of springs, which have two, in the pose described.
    joint_lower, joint_upper (R, joints): stops, far away where a joint has none.
    effect_kind (e,), effect_acts (e, n), effect_programs (rows, 4) of `polyworld.expressions.effect`: not varied.
    """

    mass: Array
    friction: Array
    restitution: Array
    rolling_resistance: Array
    torsional_radius: Array
    linear_damping: Array
    angular_damping: Array
    position: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array
    static_position: Array
    static_orientation: Array
    static_friction: Array
    static_restitution: Array
    plane_friction: Array
    gravity: Array
    effect_parameters: Array
    time_scale: Array
    time_origin: Array
    joint_friction: Array
    joint_damping: Array
    joint_stiffness: Array
    joint_anchor: Array
    joint_other_anchor: Array
    joint_lower: Array
    joint_upper: Array
    motor_target_speed: Array
    motor_limit: Array
    motor_delay: Array
    effect_kind: NDArray[np.int32]
    effect_acts: NDArray[np.int32]
    effect_programs: Array


SCALARS = (
    "friction",
    "restitution",
    "rolling_resistance",
    "linear_damping",
    "angular_damping",
)


def rigid_arrays(world: World, overrides: Mapping[str, Array] | None = None) -> RigidArrays:
    """Arrays of a world; `overrides` maps parameter paths to values of shape (W,), all of one length.

    Only overridden fields get W rows. Raises KeyError for an unknown path and ValueError for values that
    are not finite, outside their bounds, or of different lengths.
    """
    objects = world.objects
    effects = [e for e in world.effects if e.enabled]
    kinds, programs = effect_programs(effects)
    arrays = RigidArrays(
        mass=_row([object_mass(o) for o in objects]),
        **{name: _row([getattr(o, name) for o in objects]) for name in SCALARS},
        torsional_radius=_row([torsional_radius(world, o) for o in objects]),
        position=_rows([o.position for o in objects], 3),
        orientation=_rows([o.orientation for o in objects], 4),
        velocity=_rows([o.velocity for o in objects], 3),
        angular_velocity=_rows([o.angular_velocity for o in objects], 3),
        static_position=_rows([s.position for s in world.statics], 3),
        static_orientation=_rows([s.orientation for s in world.statics], 4),
        static_friction=_row([_or(s.friction, OWN) for s in world.statics]),
        static_restitution=_row([_or(s.restitution, OWN) for s in world.statics]),
        plane_friction=_row([_or(world.environment.motion_plane.friction, OWN)]),
        gravity=_row(list(world.environment.gravity)),
        effect_parameters=_effect_parameters(world),
        time_scale=np.ones((1, 1)),
        time_origin=_row([world.time.origin]),
        joint_friction=_row([getattr(j, "friction", 0.0) for j in world.joints]),
        joint_damping=_row([getattr(j, "damping", 0.0) for j in world.joints]),
        joint_stiffness=_row([getattr(j, "stiffness", 0.0) for j in world.joints]),
        joint_anchor=_rows([j.anchor for j in world.joints], 3),
        joint_other_anchor=_rows([getattr(j, "other_anchor", j.anchor) for j in world.joints], 3),
        joint_lower=_row([_or(getattr(j, "lower", None), -NEVER) for j in world.joints]),
        joint_upper=_row([_or(getattr(j, "upper", None), NEVER) for j in world.joints]),
        motor_target_speed=_motor_row(world, "target_speed"),
        motor_limit=_motor_row(world, "limit"),
        motor_delay=_motor_row(world, "delay"),
        effect_kind=kinds,
        effect_acts=np.array(
            [[e.objects is None or o.name in e.objects for o in objects] for e in effects], dtype=np.int32
        ).reshape(len(effects), len(objects)),
        effect_programs=programs,
    )
    return with_overrides(world, arrays, overrides) if overrides else arrays


def with_overrides(world: World, arrays: RigidArrays, overrides: Mapping[str, Array]) -> RigidArrays:
    """A copy of a world's arrays with some parameters given per world; raises as `rigid_arrays` does."""
    arrays = replace(arrays, **{name: field.copy() for name, field in vars(arrays).items()})
    _apply(world, arrays, overrides)
    return arrays


def _apply(world: World, arrays: RigidArrays, overrides: Mapping[str, Array]) -> None:
    lengths = {path: np.shape(v) for path, v in overrides.items()}
    if len(set(lengths.values())) > 1 or any(len(s) != 1 for s in lengths.values()):
        raise ValueError(f"overrides must be one-dimensional and of equal length, got {lengths}")
    rows = next(iter(lengths.values()))[0]
    columns = {o.name: i for i, o in enumerate(world.objects)}
    static_columns = {s.name: i for i, s in enumerate(world.statics)}
    effect_columns = {e.name: i for i, e in enumerate(e for e in world.effects if e.enabled)}
    joint_columns = {j.name: i for i, j in enumerate(world.joints)}
    effects = {e.name: e for e in world.effects}
    known = parameter_paths(world)
    turns: dict[str, Array] = {}
    for path, given in overrides.items():
        values = np.asarray(given, dtype=float)
        spec = known.get(path) or specification(world, path)  # the latter raises, naming the choices
        check_differs_per_world(world, path)
        if not (np.all(np.isfinite(values)) and values.min() >= spec.lower and values.max() <= spec.upper):
            raise ValueError(f"{path}: values must lie in {spec.lower} to {spec.upper} {spec.unit}")
        parts = path.split(".")
        if parts[0] in ("objects", "statics") and parts[2] == "rotation":
            turns.setdefault(parts[1], np.zeros((rows, 3)))[:, "xyz".index(parts[3])] = values
        elif parts[0] == "objects" and len(parts) == 4:
            _widen(arrays, parts[2], rows)[:, columns[parts[1]], "xyz".index(parts[3])] = values
        elif parts[0] == "objects":
            _widen(arrays, parts[2], rows)[:, columns[parts[1]]] = values
        elif parts[0] == "statics" and len(parts) == 4:
            _widen(arrays, "static_position", rows)[:, static_columns[parts[1]], "xyz".index(parts[3])] = values
        elif parts[0] == "statics":
            _widen(arrays, f"static_{parts[2]}", rows)[:, static_columns[parts[1]]] = values
        elif parts[0] == "environment" and parts[1] == "gravity":
            _widen(arrays, "gravity", rows)[:, "xyz".index(parts[2])] = values
        elif parts[0] == "environment":
            _widen(arrays, "plane_friction", rows)[:, 0] = values
        elif parts[0] == "joints":
            _apply_joint(arrays, world.joints[joint_columns[parts[1]]], parts[2:], joint_columns[parts[1]], values)
        elif parts[0] == "effects":
            if parts[1] in effect_columns:  # a disabled effect has no column: its parameters act on nothing
                slot = list(law_of(effects[parts[1]]).parameters).index(parts[2])
                _widen(arrays, "effect_parameters", rows)[:, effect_columns[parts[1]], slot] = values
        elif path == "time.origin":
            arrays.time_origin = values[:, None]
        else:
            arrays.time_scale = (values / world.time.seconds_per_frame)[:, None]
    for name, vectors in turns.items():
        is_static = name in static_columns  # names of objects and statics differ
        orientation = _widen(arrays, "static_orientation" if is_static else "orientation", rows)
        column = static_columns[name] if is_static else columns[name]
        turn = geometry.rotation_quaternion(vectors)
        orientation[:, column] = geometry.quaternion_product(turn, orientation[:, column])


def _apply_joint(arrays: RigidArrays, joint: Joint, field: list[str], column: int, values: Array) -> None:
    rows = len(values)
    if field[0] == "motor":
        _widen(arrays, f"motor_{field[1]}", rows)[:, column] = values
    elif len(field) == 1:
        _widen(arrays, f"joint_{field[0]}", rows)[:, column] = values
    else:
        axis = "xyz".index(field[1])
        _widen(arrays, f"joint_{field[0]}", rows)[:, column, axis] = values
        if not isinstance(joint, Spring):  # one point for both ends
            _widen(arrays, "joint_other_anchor", rows)[:, column, axis] = values


def _widen(arrays: RigidArrays, name: str, rows: int) -> Array:
    field: Array = getattr(arrays, name)
    if field.shape[0] != rows:
        field = np.repeat(field, rows, axis=0)
        setattr(arrays, name, field)
    return field


def _effect_parameters(world: World) -> Array:
    effects = [e for e in world.effects if e.enabled]
    values = np.zeros((1, len(effects), MAX_PARAMETERS))
    for i, effect in enumerate(effects):
        for j, (name, spec) in enumerate(law_of(effect).parameters.items()):
            values[0, i, j] = effect.parameters.get(name, spec.default)
    return values


def _motor_row(world: World, field: str) -> Array:
    """A motor's number of each joint, 0 where there is no motor or it has none."""
    motors = [getattr(j, "motor", None) for j in world.joints]
    return _row([getattr(m, field, None) or 0.0 for m in motors])


def _row(values: list[float]) -> Array:
    return np.asarray(values, dtype=float).reshape(1, -1)


def _rows(values: list[tuple[float, ...]], width: int) -> Array:
    return np.asarray(values, dtype=float).reshape(1, -1, width)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value
