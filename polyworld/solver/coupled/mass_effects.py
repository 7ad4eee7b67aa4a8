"""Effects whose force is proportional to mass, on the nodes of deformable objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.effects import Motion
from polyworld.solver.core.arrays import RigidArrays
from polyworld.solver.core.effect_forces import effect_forces
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import OPTIONS
from polyworld.world import World

wp.set_module_options(OPTIONS)


@wp.kernel
def add_effects(
    dt: wp.array[wp.float64],
    inner: wp.array[wp.int32],
    time: wp.array[wp.float64],
    origin: wp.array[wp.float64],
    gravity: wp.array[wp.vec3d],
    owner: wp.array[wp.int32],
    mass: wp.array2d[wp.float64],
    kinds: wp.array[wp.int32],
    acts: wp.array2d[wp.int32],
    parameters: wp.array3d[wp.float64],
    programs: wp.array2d[wp.float64],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    f: wp.array2d[wp.vec3d],
) -> None:
    w, i = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    b = Motion()  # of a node: without size, spin or contact
    b.mass = mass[w % mass.shape[0], i]
    b.x = x[w, i]
    b.v = v[w, i]
    middle = (wp.float64(inner[0]) + wp.float64(0.5)) * dt[w]  # of the inner step
    b.t = origin[w % origin.shape[0]] + time[w] + middle
    b.gravity = gravity[w % gravity.shape[0]]
    wrench = effect_forces(kinds, acts, parameters, programs, w, owner[i], b)
    f[w, i] = f[w, i] + wp.spatial_top(wrench)


class MassEffects:
    """The enabled effects of a world that act on its deformable objects."""

    def __init__(self, world: World) -> None:
        enabled = [e for e in world.effects if e.enabled]
        acts = [[e.objects is None or d.name in e.objects for d in world.deformables] for e in enabled]
        self.any = bool(np.any(acts)) if acts else False
        table = np.array(acts, dtype=np.int32).reshape(len(enabled), len(world.deformables))
        self._acts: Any = buffers.array(table, wp.int32)
        self._kinds: Any = None
        self._parameters: Any = None
        self._programs: Any = None
        self._origin: Any = None

    def write(self, arrays: RigidArrays) -> bool:
        """Write parameter values; return True where arrays were reallocated."""
        if not self.any:
            return False
        values = arrays.effect_parameters
        origin = arrays.time_origin[:, 0]
        same = self._parameters is not None and self._origin.shape == origin.shape
        if same and self._parameters.shape == values.shape:
            self._parameters.numpy()[:] = values
            self._origin.numpy()[:] = origin
            return False
        self._origin = buffers.array(origin, wp.float64)
        self._kinds = buffers.array(arrays.effect_kind, wp.int32)
        self._programs = buffers.array(arrays.effect_programs, wp.float64)
        self._parameters = buffers.array(values, wp.float64)
        return True

    def launch(self, nodes: Nodes, clock: Clock) -> None:
        """Add the forces at the current positions and velocities."""
        if self.any:
            buffers.launch(
                add_effects,
                nodes.x.shape,
                [
                    clock.dt,
                    clock.inner,
                    clock.time,
                    self._origin,
                    clock.gravity,
                    nodes.owner,
                    nodes.mass,
                    self._kinds,
                    self._acts,
                    self._parameters,
                    self._programs,
                    nodes.x,
                    nodes.v,
                    nodes.f,
                ],
            )
