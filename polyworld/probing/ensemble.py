"""Roll out the members of an ensemble: one world with equally probable parameter values and the same edits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.edits.interventions import Intervention, branch
from polyworld.model import model_of
from polyworld.solver.core.patience import PATIENCE
from polyworld.solver.rollout import rollouts
from polyworld.trajectory import Rollout
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter, with_parameters

Array = NDArray[np.float64]

ALIKE = 1e-7  # relative: members rebuilt from parameter values are the same within the rounding of rotations


def member_worlds(start: World, values: Mapping[str, Array], edits: Sequence[Intervention]) -> tuple[World, ...]:
    """Return the worlds that N parameter values by path (N,) make of the world `start`, each after the same edits.

    Raises ValueError naming the first member in which an edit cannot be made.
    """
    members = []
    for i in range(len(next(iter(values.values())))):
        member = with_parameters(start, {path: float(value[i]) for path, value in values.items()})
        try:
            members.append(branch(member, edits))
        except ValueError as error:
            raise ValueError(f"in member {i + 1} of the ensemble, {error}") from error
    return tuple(members)


def roll_out_members(
    world: World,
    members: Sequence[World],
    paths: Iterable[str],
    horizon: float,
    *,
    sample_interval: float | None = None,
    progress: Callable[[float], None] | None = None,
    patience: float = PATIENCE,
) -> tuple[Rollout, ...]:
    """Roll out members of an ensemble about `world` in one batch.

    paths: parameters in which they may differ. patience: as for `rollout`. Raises ValueError where they differ in
    anything else.
    """
    overrides = differences(world, members, paths)
    for i, member in enumerate(members):
        rebuilt = with_parameters(world, {path: float(value[i]) for path, value in overrides.items()})
        if not _alike(rebuilt.model_dump(), member.model_dump()):
            raise ValueError("the edits change the members of the ensemble by more than the fitted parameters")
    return rollouts(
        world, members, overrides, horizon, sample_interval=sample_interval, progress=progress, patience=patience
    )


def differences(world: World, members: Sequence[World], paths: Iterable[str]) -> dict[str, Array]:
    """Return values (N,) by path that make `world` into the members, for those of the paths that it has.

    A component comes with the other two of its vector, into which an edit may have turned it.
    """
    known = parameter_paths(world)
    found: dict[str, Array] = {}
    for path in dict.fromkeys(sibling for given in paths for sibling in _components(given)):
        if path not in known:
            continue
        head, _, field = path.partition(".")[2].partition(".")
        if field.startswith("rotation."):
            found[path] = np.zeros(len(members))  # filled in below
            continue
        if field.startswith("shift."):
            axis = "xyz".index(field[-1])
            origin = model_of(world).mesh(head).nodes[0]
            found[path] = np.array([(model_of(member).mesh(head).nodes[0] - origin)[axis] for member in members])
            continue
        values = [read_parameter(member, path) for member in members]
        if None not in values:
            found[path] = np.array(values, dtype=np.float64)
    for path in [p for p in found if ".rotation." in p]:  # the axes of a rotation belong together
        kind, name = path.split(".")[:2]
        vectors = np.array([_rotation(world, member, kind, name) for member in members])
        for column, letter in enumerate("xyz"):
            if f"{path[:-1]}{letter}" in known:
                found[f"{path[:-1]}{letter}"] = vectors[:, column]
    return found


def _components(path: str) -> list[str]:
    """Paths of all components of the vector that a path is one of, or the path itself."""
    head, _, last = path.rpartition(".")
    return [f"{head}.{axis}" for axis in "xyz"] if last in ("x", "y", "z") else [path]


def _rotation(world: World, member: World, kind: str, name: str) -> Array:
    """Rotation vector (3,) that takes an object or static of `world` to how it stands in `member`."""
    first, second = (next(x for x in getattr(w, kind) if x.name == name) for w in (world, member))
    a, b = (Rotation.from_quat(x.orientation, scalar_first=True) for x in (first, second))
    vector: Array = (b * a.inv()).as_rotvec()
    return vector


def _alike(a: Any, b: Any) -> bool:
    """Whether nested values are equal, numbers within rounding."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(_alike(a[k], b[k]) for k in a)
    if isinstance(a, list | tuple):
        return isinstance(b, list | tuple) and len(a) == len(b) and all(_alike(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float | int):
        return bool(np.isclose(a, b, rtol=ALIKE, atol=ALIKE))
    return bool(a == b)
