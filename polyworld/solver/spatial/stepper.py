"""Rigid bodies of W worlds, advanced one step at a time: the rigid part of the coupled solver."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import Model
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.episodes import ContactLog, Log
from polyworld.solver.core.references import by_reference
from polyworld.solver.spatial.buffers import (
    SHARED,
    ParameterBuffers,
    allocate_joints,
    allocate_state,
    enlarge,
    system_of,
    zeros,
)
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_scene import write_joints
from polyworld.solver.spatial.kernels import load_worlds, step_kernel
from polyworld.solver.spatial.scene import build_geometry
from polyworld.trajectory import Event


class RigidStepper:
    """Bodies of W variants of one world, of which others may read and change the state between steps.

    bodies: Warp array (W, n + s + 1) of `layout.Body`, objects first, then statics, then the world itself; x, q, v,
    w may be written between steps, with `rotation` the matrix of q. geometry: their shapes; system: all of a step's
    records. Parameters are arrays of W
    rows, written in place, so that a captured graph of `launch_step` stays valid.
    """

    def __init__(self, model: Model, n_worlds: int, record_events: bool = False) -> None:
        self.world = world = model.world
        self.n_worlds = n_worlds
        self.record_events = record_events
        self.names = tuple(o.name for o in world.objects)
        self._all_names = self.names + tuple(s.name for s in world.statics)
        self.geometry, self._trees = build_geometry(model)
        self.state = allocate_state(world, n_worlds)
        self.joints = allocate_joints(world, self.state)
        self.bodies = self.state.bodies
        self.log = ContactLog(n_worlds, self.names, self._all_names, record=record_events)
        self._start: Any = buffers.array([o.start_time for o in world.objects], wp.float64)
        self._half = zeros((n_worlds,), wp.int32)
        self._diverged = zeros((n_worlds,), wp.int32)
        self._kernel = step_kernel(bool(world.joints))
        self._parameters = ParameterBuffers(world, n_worlds)
        self.system = system_of(self.geometry, self.state, self.log.record)
        self.write(model.arrays())

    def write(self, arrays: RigidArrays) -> None:
        """Take parameters and initial states; `reset` puts the bodies there."""
        wide = {
            name: values if name in SHARED else np.repeat(values, self.n_worlds // len(values), axis=0)
            for name, values in vars(arrays).items()
        }
        self._parameters.write(replace(arrays, **wide))
        write_joints(self.joints, replace(arrays, **wide), self.world)
        self.system.parameters = self._parameters.reference
        self.system.joints = by_reference(self.joints, Joints, self.system.joints)

    def reset(self) -> None:
        """Back to the initial state at time 0, without contacts."""
        self.log.clear()
        buffers.write(self._half, 0)
        buffers.write(self._diverged, -1)
        buffers.launch(load_worlds, self.n_worlds, [self.system, self._start])

    def launch_step(self, time: Any, h: Any) -> None:
        """Launch one step of every world from time[w] over h[w], Warp arrays (W,) float64 [s].

        A world with h[w] <= 0, or one that has diverged, stays as it is. An object that starts at the step's end
        or before takes part from then on.
        """
        if not self.names:
            return
        buffers.launch(self._kernel, self.n_worlds, [self.system, self._start, time, h, self._half, self._diverged])

    def diverged(self) -> NDArray[np.int32]:
        """Index (W,) of the first object whose state cannot be trusted, -1 where there is none."""
        diverged: NDArray[np.int32] = buffers.read(self._diverged)
        return diverged

    def overflowed(self) -> NDArray[np.bool_]:
        """Worlds (W,) that ran out of room for contacts, and stay as they are."""
        found: NDArray[np.bool_] = buffers.read(self.state.overflowed) > 0
        return found

    def enlarge(self) -> bool:
        """Make more room for contacts, in place; runs begin again. Return False where memory does not allow it."""
        return enlarge(self.system, self.state, self.joints, self.world)

    def reserve(self) -> None:
        """Make room in the log for all contacts that one step may begin, as far as there may be."""
        if self.record_events and self.log.reserve(len(self.names) * len(self._all_names)):
            by_reference(self.log.record, Log, self.system.log)

    def events(self, w: int, end: float) -> tuple[Event, ...]:
        """Contacts of world w up to the time `end` [s], in order of time; none where they are not recorded."""
        return self.log.events(w, end - 2.0 * self.world.time.substep)
