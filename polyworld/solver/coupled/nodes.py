"""The nodes of all ropes, cloths and soft bodies of W worlds, and their clock: what all stages share."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers

Array = NDArray[np.float64]
Fields = dict[str, dict[str, Array]]  # deformable -> parameter -> values (1,) shared, or (W,)


@wp.struct
class Nodes:
    """State of N nodes in W worlds; R is 1 or W for each array alone.

    x, v (W, N): position, velocity. f (W, N): force, gathered by the stages, cleared before each inner step. mass,
    inverse_mass (R, N): inverse_mass is 0 for a node held to the world. owner (N,): index among the world's
    deformables. active (W, N): 0 before the object's start_time. across: unit normal of the motion plane that all stay
    in, zero in space.
    """

    x: wp.array2d[wp.vec3d]
    v: wp.array2d[wp.vec3d]
    f: wp.array2d[wp.vec3d]
    mass: wp.array2d[wp.float64]
    inverse_mass: wp.array2d[wp.float64]
    owner: wp.array[wp.int32]
    active: wp.array2d[wp.int32]
    across: wp.vec3d


@wp.struct
class Clock:
    """Time in W worlds, (W,) unless said otherwise.

    time: now [s]. h: length of the coupling step [s]. dt: length of the inner step [s], 0 for a world that has taken
    all of this coupling step's inner steps (its kernels then do nothing). inner_steps: inner steps in a coupling step.
    inner (1,): inner steps taken. gravity (R,).
    """

    time: wp.array[wp.float64]
    h: wp.array[wp.float64]
    dt: wp.array[wp.float64]
    inner_steps: wp.array[wp.int32]
    inner: wp.array[wp.int32]
    gravity: wp.array[wp.vec3d]


def parameter_row(fields: Fields, names: tuple[str, ...], parameter: str) -> Any:
    """Warp array (R, n) float64 of one parameter of several objects; R is 1 where all share their values."""
    columns = [np.atleast_1d(fields[name][parameter]) for name in names]
    rows = max((len(c) for c in columns), default=1)
    values = np.stack([np.broadcast_to(c, (rows,)) for c in columns], axis=1) if columns else np.zeros((1, 0))
    return buffers.array(np.ascontiguousarray(values, dtype=np.float64), wp.float64)
