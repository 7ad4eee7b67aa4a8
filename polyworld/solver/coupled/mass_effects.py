"""Effects whose force is proportional to mass, on the nodes of deformable objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.effects import Motion
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.effect_forces import effect_forces
from polyworld.solver.core.effect_table import Effects
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
    effects: Effects,
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
    wrench = effect_forces(effects, w, owner[i], b)
    f[w, i] = f[w, i] + wp.spatial_top(wrench)


class MassEffects:
    """The enabled effects of a world that act on its deformable objects."""

    def __init__(self, world: World) -> None:
        enabled = [e for e in world.effects if e.enabled]
        acts = [[e.objects is None or d.name in e.objects for d in world.deformables] for e in enabled]
        self.any = bool(np.any(acts)) if acts else False
        table = np.array(acts, dtype=np.int32).reshape(len(enabled), len(world.deformables))
        self._effects = Effects()
        self._effects.acts = buffers.ints(table)
        self._origin: Any = None

    def write(self, arrays: RigidArrays) -> bool:
        """Write parameter values; return True where arrays were reallocated."""
        if not self.any:
            return False
        values = arrays.effect_parameters
        origin = arrays.time_origin[:, 0]
        same = self._origin is not None and self._origin.shape == origin.shape
        if same and self._effects.parameters.shape == values.shape:
            buffers.write(self._effects.parameters, values)
            buffers.write(self._origin, origin)
            return False
        self._origin = buffers.doubles(origin)
        self._effects.kind = buffers.ints(arrays.effect_kind)
        self._effects.programs = buffers.doubles(arrays.effect_programs)
        self._effects.parameters = buffers.doubles(values)
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
                    self._effects,
                    nodes.x,
                    nodes.v,
                    nodes.f,
                ],
            )
