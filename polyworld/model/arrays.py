"""A rigid world as plain arrays: shared fields have one row, fields that differ per world have W rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.effects import MAX_PARAMETERS
from polyworld.expressions.effect import effect_programs, law_of
from polyworld.world import World, geometry
from polyworld.world.parameters import (
    check_differs_per_world,
    object_mass,
    parameter_paths,
    specification,
    torsional_radius,
)
from polyworld.world.representations.joint import Spring

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

KEPT = 64  # lists of paths whose destinations are cached
OWN, DOMINANT = (
    -1.0,
    -2.0,
)  # codes of a coefficient that is left to the other, and, minus itself, of one that holds alone
NEVER = 1.0e30  # a time or a stop that is never reached


@dataclass
class RigidArrays:
    """Initial state and parameters of n objects, s statics and e effects; R is 1 or W for each field alone.

    mass, friction, restitution, rolling_resistance, torsional_radius, linear_damping, angular_damping (R, n);
    position, velocity, angular_velocity (R, n, 3); orientation (R, n, 4); static_position (R, s, 3),
    static_orientation (R, s, 4); static_friction,
    static_restitution (R, s) and plane_friction (R, 1), `OWN` where left to the touching object, those of dominant
    statics as `coded` codes them;
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


def rigid_arrays(world: World) -> RigidArrays:
    """Return the arrays of a world, of one row each."""
    objects = world.objects
    effects = [e for e in world.effects if e.enabled]
    kinds, programs = effect_programs(effects)
    return RigidArrays(
        mass=_row([object_mass(o) for o in objects]),
        **{name: _row([getattr(o, name) for o in objects]) for name in SCALARS},
        torsional_radius=_row([torsional_radius(world, o) for o in objects]),
        position=_rows([o.position for o in objects], 3),
        orientation=_rows([o.orientation for o in objects], 4),
        velocity=_rows([o.velocity for o in objects], 3),
        angular_velocity=_rows([o.angular_velocity for o in objects], 3),
        static_position=_rows([s.position for s in world.statics], 3),
        static_orientation=_rows([s.orientation for s in world.statics], 4),
        static_friction=coded(_row([_or(s.friction, OWN) for s in world.statics]), _dominant(world)),
        static_restitution=coded(_row([_or(s.restitution, OWN) for s in world.statics]), _dominant(world)),
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


def coded(values: Array, dominant: NDArray[np.bool_]) -> Array:
    """Return coefficients (R, s) of statics as the solvers read them; `OWN` and what is coded already stay."""
    found: Array = np.where(dominant & (values >= 0.0), DOMINANT - values, values)
    return found


class Overriding:
    """Arrays of variants of one world: where each parameter goes in them is looked up once, not for every batch."""

    def __init__(self, world: World) -> None:
        self.own = rigid_arrays(world)
        self._world = world
        self._known = parameter_paths(world)
        self._dominant = _dominant(world)
        self._destinations: dict[tuple[str, ...], _Destinations] = {}

    def arrays(self, overrides: Mapping[str, Array]) -> RigidArrays:
        """Return the world's arrays with parameters, by path, given as values (W,), one a world.

        Fields of which none is given have one row.

        Raises KeyError for an unknown path, ValueError for values that are not finite, outside their bounds, or of
        different lengths.
        """
        if not overrides:
            return self.own
        lengths = {path: np.shape(v) for path, v in overrides.items()}
        if len(set(lengths.values())) > 1 or any(len(s) != 1 for s in lengths.values()):
            raise ValueError(f"overrides must be one-dimensional and of equal length, got {lengths}")
        paths = tuple(overrides)
        if not len(overrides[paths[0]]):
            raise ValueError("overrides must hold a value for at least one world, got none")
        destinations = self._destinations.get(paths)
        if destinations is None:
            if len(self._destinations) == KEPT:
                self._destinations.clear()
            destinations = self._destinations[paths] = self._looked_up(paths)
        values = np.array([overrides[path] for path in paths], dtype=float)
        inside = (values >= destinations.lower[:, None]) & (values <= destinations.upper[:, None]) & np.isfinite(values)
        if not inside.all():
            path = paths[int(np.argmin(inside.all(axis=1)))]
            spec = self._known[path]
            raise ValueError(f"{path}: values must lie in {spec.lower} to {spec.upper} {spec.unit}")
        values /= destinations.unit[:, None]
        rows = values.shape[1]
        changed: dict[str, Any] = {}
        for name, (which, where) in destinations.written.items():
            changed[name] = np.repeat(getattr(self.own, name), rows, axis=0)
            changed[name][(slice(None), *where)] = values[which].T
            if name in ("static_friction", "static_restitution"):
                changed[name] = coded(changed[name], self._dominant)
        for name, (which, bodies, axes) in destinations.rotated.items():
            columns, own = np.unique(bodies, return_inverse=True)
            vectors = np.zeros((rows, len(columns), 3))
            vectors[:, own, axes] = values[which].T
            changed[name] = np.repeat(getattr(self.own, name), rows, axis=0)
            rotation = geometry.rotation_quaternion(vectors)
            changed[name][:, columns] = geometry.quaternion_product(rotation, changed[name][:, columns])
        return replace(self.own, **changed)

    def _looked_up(self, paths: tuple[str, ...]) -> _Destinations:
        specs, unit = [], np.ones(len(paths))
        written: dict[str, list[tuple[int, tuple[Any, ...]]]] = {}
        rotated: dict[str, list[tuple[int, int, int]]] = {}
        for i, path in enumerate(paths):
            specs.append(self._known.get(path) or specification(self._world, path))  # the latter raises, with choices
            check_differs_per_world(self._world, path)
            parts = path.split(".")
            if parts[0] in ("objects", "statics") and parts[2] == "rotation":
                field = "orientation" if parts[0] == "objects" else "static_orientation"
                rotated.setdefault(field, []).append((i, self._column(parts), "xyz".index(parts[3])))
                continue
            if path == "time.seconds_per_frame":
                unit[i] = self._world.time.seconds_per_frame
            for field, where in self._fields(path, parts):
                written.setdefault(field, []).append((i, where))
        return _Destinations(
            lower=np.array([s.lower for s in specs]),
            upper=np.array([s.upper for s in specs]),
            unit=unit,
            written={
                field: (np.array([i for i, _ in found]), tuple(np.array([w for _, w in found]).T))
                for field, found in written.items()
            },
            rotated={field: tuple(np.array(found).T) for field, found in rotated.items()},
        )

    def _fields(self, path: str, parts: list[str]) -> list[tuple[str, tuple[Any, ...]]]:
        """Fields that a parameter is written to, and where, behind the axis of worlds."""
        if path == "time.origin":
            return [("time_origin", (0,))]
        if path == "time.seconds_per_frame":
            return [("time_scale", (0,))]
        if parts[0] == "environment":
            is_gravity = parts[1] == "gravity"
            return [("gravity", ("xyz".index(parts[2]),)) if is_gravity else ("plane_friction", (0,))]
        column = self._column(parts)
        if parts[0] == "effects":
            effect = next(e for e in self._world.effects if e.name == parts[1])
            if not effect.enabled:  # its parameters act on nothing
                return []
            return [("effect_parameters", (column, list(law_of(effect).parameters).index(parts[2])))]
        prefix = {"objects": "", "statics": "static_", "joints": "joint_"}[parts[0]]
        if parts[2] == "motor":
            return [(f"motor_{parts[3]}", (column,))]
        if len(parts) == 3:
            return [(f"{prefix}{parts[2]}", (column,))]
        where = (column, "xyz".index(parts[3]))
        fields: list[tuple[str, tuple[Any, ...]]] = [(f"{prefix}{parts[2]}", where)]
        if parts[0] == "joints" and not isinstance(self._world.joints[column], Spring):  # one point for both ends
            fields.append(("joint_other_anchor", where))
        return fields

    def _column(self, parts: list[str]) -> int:
        """Return the column of the part of the world that a path names; -1 of an effect that is switched off."""
        named: dict[str, Sequence[Any]] = {
            "objects": self._world.objects,
            "statics": self._world.statics,
            "joints": self._world.joints,
            "effects": [e for e in self._world.effects if e.enabled],
        }
        return next((i for i, part in enumerate(named[parts[0]]) if part.name == parts[1]), -1)


def dot(a: Array, b: Array) -> Array:
    """Return scalar products (...,) of vectors (..., 3), summed term by term: the same in a batch of any size."""
    result: Array = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return result


@dataclass(frozen=True)
class _Destinations:
    """Destinations of P parameters.

    lower, upper, unit (P,): bounds, and what values are divided by. written: field -> which parameters (m,), and their
    indices behind the axis of worlds; rotated: field -> which parameters (m,), bodies (m,) and axes (m,).
    """

    lower: Array
    upper: Array
    unit: Array
    written: Mapping[str, tuple[Ints, tuple[Ints, ...]]]
    rotated: Mapping[str, tuple[Ints, ...]]


def _dominant(world: World) -> NDArray[np.bool_]:
    """Find which statics (s,) are dominant."""
    return np.array([s.dominant for s in world.statics], dtype=bool)


def _effect_parameters(world: World) -> Array:
    effects = [e for e in world.effects if e.enabled]
    values = np.zeros((1, len(effects), MAX_PARAMETERS))
    for i, effect in enumerate(effects):
        for j, (name, spec) in enumerate(law_of(effect).parameters.items()):
            values[0, i, j] = effect.parameters.get(name, spec.default)
    return values


def _motor_row(world: World, field: str) -> Array:
    """Return a motor's number of each joint, 0 where there is no motor or it has none."""
    motors = [getattr(j, "motor", None) for j in world.joints]
    return _row([getattr(m, field, None) or 0.0 for m in motors])


def _row(values: list[float]) -> Array:
    return np.asarray(values, dtype=float).reshape(1, -1)


def _rows(values: list[tuple[float, ...]], width: int) -> Array:
    return np.asarray(values, dtype=float).reshape(1, -1, width)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value
