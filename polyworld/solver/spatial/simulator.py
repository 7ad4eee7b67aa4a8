"""W variants of one spatial world, run in one kernel launch per share of the worlds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.core.arrays import Overriding, RigidArrays, check_samples, check_worlds
from polyworld.solver.core.episodes import ContactLog, Log
from polyworld.solver.core.references import by_reference
from polyworld.solver.core.thread_pool import run_in_pool, shares
from polyworld.solver.core.time_table import schedules
from polyworld.solver.spatial import layout
from polyworld.solver.spatial.buffers import (
    ParameterBuffers,
    allocate_joints,
    allocate_state,
    check_room,
    zeros,
)
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_scene import write_joints
from polyworld.solver.spatial.kernels import roll_out_kernel
from polyworld.solver.spatial.scene import build_geometry
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World

Array = NDArray[np.float64]


class SpatialSimulator:
    """See `polyworld.solver.rollout.simulator`. Buffers are allocated once and written in place on every run."""

    def __init__(
        self,
        world: World,
        sample_times: Array,
        *,
        n_worlds: int = 1,
        record_events: bool = False,
        threads: int | None = None,
    ) -> None:
        self.world = world
        self.names = tuple(o.name for o in world.objects)
        self.n_worlds = n_worlds
        self.sample_times = np.atleast_2d(np.asarray(sample_times, dtype=float))
        self.record_events = record_events
        self.threads = threads or len(os.sched_getaffinity(0))
        self._all_names = self.names + tuple(s.name for s in world.statics)
        self._geometry, self._trees = build_geometry(world)
        self._table = schedules(world, self.sample_times)
        self._schedule = layout.Schedule()
        for name, dtype in (("end", wp.float64), ("steps", wp.int32), ("sample", wp.int32), ("joins", wp.int32)):
            setattr(self._schedule, name, buffers.array(getattr(self._table, name), dtype))
        self._schedule.own, self._schedule.reach = zeros((n_worlds,), wp.int32), zeros((n_worlds,), wp.int32)
        self._own, self._reach = self._schedule.own.numpy(), self._schedule.reach.numpy()
        self._pieces = shares(n_worlds, self.threads)
        self._parameters = ParameterBuffers(world, n_worlds)
        self._overriding = Overriding(world)
        self._state: Any
        self._joints: Joints
        self._samples: Any
        self._log: ContactLog
        self._allocate()

    def run(
        self,
        overrides: Mapping[str, Array] | None = None,
        *,
        samples: int | NDArray[np.int64] | None = None,
        schedule: NDArray[np.int64] | None = None,
    ) -> BatchTrajectory:
        """Roll variants out from their initial state; see `polyworld.solver.rollout.Simulator`."""
        each = check_samples(self.sample_times.shape[1], samples)
        count = int(each.max())
        worlds = check_worlds(self.n_worlds, overrides, schedule)
        arrays = self._overriding.arrays(overrides) if overrides else self._overriding.own
        own = np.zeros(worlds, dtype=np.int64) if schedule is None else schedule
        self._own[:worlds], self._reach[:worlds] = own, self._table.segments(own, each)
        self._write(arrays, worlds)
        self._launch(worlds)
        return self._read(arrays, own, count)

    def _allocate(self) -> None:
        w, n = self.n_worlds, len(self.names)
        samples = layout.Samples()
        shape = (w, self.sample_times.shape[1], n)
        samples.position = zeros(shape, wp.vec3d)
        samples.orientation = zeros(shape, wp.quatd)
        samples.velocity = zeros(shape, wp.vec3d)
        samples.angular_velocity = zeros(shape, wp.vec3d)
        samples.diverged_object = zeros((w,), wp.int32)
        samples.diverged_time = zeros((w,), wp.float64)
        samples.overflowed = zeros((w,), wp.int32)
        self._samples = samples
        self._state = allocate_state(self.world, self._pieces)
        self._joints = allocate_joints(self.world, self._state)
        self._log = ContactLog(w, self.names, self._all_names, record=self.record_events)
        self._fixed = [
            by_reference(self._geometry, layout.Geometry),
            by_reference(self._schedule, layout.Schedule),
            by_reference(self._state, layout.State),
            by_reference(samples, layout.Samples),
            by_reference(self._log.record, Log),
        ]
        self._joints_reference: Any = None
        fields = ("position", "orientation", "velocity", "angular_velocity")
        self._motion = {name: getattr(samples, name).numpy() for name in fields}

    def _write(self, arrays: RigidArrays, worlds: int) -> None:
        self._parameters.write(arrays)
        write_joints(self._joints, arrays, self.world)
        self._joints_reference = by_reference(self._joints, Joints, self._joints_reference)
        for content in self._motion.values():
            content[:worlds] = np.nan
        self._samples.diverged_object.numpy()[:worlds] = -1
        self._samples.diverged_time.numpy()[:worlds] = np.nan
        self._samples.overflowed.numpy()[:] = 0
        self._log.clear()

    def _launch(self, worlds: int) -> None:
        if not self.names:
            return
        kernel = roll_out_kernel(bool(self.world.joints))
        pieces = min(shares(worlds, self.threads), self._pieces)
        edges = np.linspace(0, worlds, pieces + 1).astype(int)
        geometry, schedule, state, samples, log = self._fixed
        parameters, joints = self._parameters.reference, self._joints_reference

        def piece(index: int) -> None:
            first, last = int(edges[index]), int(edges[index + 1])
            buffers.launch(
                kernel,
                last - first,
                [geometry, parameters, schedule, joints, state, samples, log, first, index],
            )

        kernel.module.load("cpu", block_dim=1)  # before the threads ask for it
        run_in_pool(piece, pieces, self.threads)

    def _read(self, arrays: RigidArrays, schedule: NDArray[np.int64], count: int) -> BatchTrajectory:
        out, worlds = self._samples, len(schedule)
        check_room(self._state, out.overflowed.numpy())
        diverged = out.diverged_object.numpy()[:worlds] >= 0
        starts = np.array([o.start_time for o in self.world.objects])
        times = self.sample_times[schedule, :count] * arrays.time_scale
        last = np.nanmax(times, axis=1)
        return BatchTrajectory(
            names=self.names,
            times=times,
            positions=self._motion["position"][:worlds, :count].copy(),
            orientations=np.roll(self._motion["orientation"][:worlds, :count], 1, axis=-1),
            velocities=self._motion["velocity"][:worlds, :count].copy(),
            angular_velocities=self._motion["angular_velocity"][:worlds, :count].copy(),
            active=self.sample_times[0, :count, None] >= starts[None, :],
            diverged=diverged,
            diverged_time=out.diverged_time.numpy()[:worlds].copy(),
            diverged_object=out.diverged_object.numpy()[:worlds].astype(np.int64),
            events=tuple(self._log.events(w, float(last[w]) - 2.0 * self.world.time.substep) for w in range(worlds)),
        )
