"""The nodes of all ropes, cloths and soft bodies of W worlds: what their stages share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers

Array = NDArray[np.float64]
Fields = dict[str, dict[str, Array]]  # deformable -> parameter -> values (1,) shared, or (W,)


@dataclass
class Nodes:
    """State of N nodes in W worlds, Warp arrays; R is 1 or W for each array alone.

    x, v (W, N) vec3d: position, velocity. f (W, N) vec3d: force, gathered by the stages, cleared before each inner
    step. mass, inverse_mass (R, N) float64; inverse_mass is 0 for a node held to the world. radius (N,) float64.
    owner (N,) int32: index among the world's deformables. first: name -> index of an object's first node; count:
    name -> number of its nodes. friction, restitution (R, D) float64 by deformable. active (W, N) int32: 0 before
    the object's start_time.
    """

    x: Any
    v: Any
    f: Any
    mass: Any
    inverse_mass: Any
    radius: Any
    owner: Any
    friction: Any
    restitution: Any
    active: Any
    first: dict[str, int]
    count: dict[str, int]


@dataclass
class Clock:
    """Time in W worlds, Warp arrays (W,) float64 unless said otherwise.

    time: now [s]. h: length of the coupling step [s]. dt: length of the inner step [s], 0 for a world that has taken
    all of this coupling step's inner steps (its kernels then do nothing). inner_steps (W,) int32: inner steps in a
    coupling step. inner (1,) int32: inner steps taken. gravity (R,) vec3d.
    """

    time: Any
    h: Any
    dt: Any
    inner_steps: Any
    inner: Any
    gravity: Any


def parameter_row(fields: Fields, names: tuple[str, ...], parameter: str) -> Any:
    """Warp array (R, n) float64 of one parameter of several objects; R is 1 where all share their values."""
    columns = [np.atleast_1d(fields[name][parameter]) for name in names]
    rows = max((len(c) for c in columns), default=1)
    values = np.stack([np.broadcast_to(c, (rows,)) for c in columns], axis=1) if columns else np.zeros((1, 0))
    return buffers.array(np.ascontiguousarray(values, dtype=np.float64), wp.float64)
