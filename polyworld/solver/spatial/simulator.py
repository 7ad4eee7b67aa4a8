"""W variants of one spatial world, run in one kernel launch per share of the worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import Model
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.episodes import Log
from polyworld.solver.core.references import by_reference
from polyworld.solver.core.simulator import Batch, RigidSimulator
from polyworld.solver.core.time_table import Schedule
from polyworld.solver.spatial import layout
from polyworld.solver.spatial.buffers import (
    ParameterBuffers,
    allocate_joints,
    allocate_state,
    enlarge,
    system_of,
    zeros,
)
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_scene import write_joints
from polyworld.solver.spatial.kernels import roll_out_kernel
from polyworld.solver.spatial.scene import build_geometry
from polyworld.trajectory import Event
from polyworld.world.representations.joint import Hinge, Slider

Array = NDArray[np.float64]


class SpatialSimulator(RigidSimulator):
    """See `RigidSimulator`."""

    def _build(self, model: Model) -> None:
        self._geometry, self._trees = build_geometry(model)
        self._parameters = ParameterBuffers(self.world, self.n_worlds)
        self._state: Any
        self._joints: Joints
        self._samples: Any
        self._allocate()

    def _allocate(self) -> None:
        w, n = self.n_worlds, len(self.names)
        samples = layout.Samples()
        shape = (w, self.sample_times.shape[1], n)
        samples.position = zeros(shape, wp.vec3d)
        samples.orientation = zeros(shape, wp.quatd)
        samples.velocity = zeros(shape, wp.vec3d)
        samples.angular_velocity = zeros(shape, wp.vec3d)
        samples.outcome = self._outcome
        self._samples = samples
        self._state = allocate_state(self.world, self._slots)
        self._joints = allocate_joints(self.world, self._state)
        self._system = system_of(self._geometry, self._state, self._log.record)
        self._references = [by_reference(self._schedule, Schedule), by_reference(samples, layout.Samples)]
        fields = ("position", "orientation", "velocity", "angular_velocity")
        self._motion = {name: buffers.Mirror(getattr(samples, name)) for name in fields}

    def _write(self, arrays: RigidArrays, _worlds: int) -> None:
        self._take_log()
        self._parameters.write(arrays)
        write_joints(self._joints, arrays, self.world)
        self._system.parameters = self._parameters.reference
        self._system.joints = by_reference(self._joints, Joints, self._system.joints)

    def _take_log(self) -> None:
        by_reference(self._log.record, Log, self._system.log)

    def _forget(self, worlds: NDArray[np.int64]) -> None:
        for content in self._motion.values():
            content.values[worlds] = np.nan
            content.push()

    def control(
        self, forces: Array, torques: Array, efforts: Mapping[str, float], speeds: Mapping[str, float], /
    ) -> None:
        bodies = buffers.Mirror(self._state.bodies)
        own = bodies.values[0, : len(self.names)]
        own["push"], own["push_torque"] = forces, torques
        bodies.push()
        if self._joints.count:
            joints = buffers.Mirror(self._joints.joint)
            for row, kind in zip(joints.values[0], buffers.read(self._joints.kinds), strict=True):
                joint = self.world.joints[kind["column"]]
                if isinstance(joint, Hinge | Slider) and joint.motor is not None:
                    sign = -1.0 if joint.motor.reverse else 1.0
                    row["effort"] = efforts.get(joint.name, sign * joint.motor.limit)
                    row["target_speed"] = speeds.get(joint.name, joint.motor.target_speed or 0.0)
            joints.push()
            buffers.write(self._joints.tree.known, 0)  # accelerations at the end of the last step were without this

    def release(self) -> None:
        still = np.zeros((len(self.names), 3))
        self.control(still, still, {}, {})

    def _records(self) -> dict[str, Any]:
        return {"state": self._state, "joints": self._joints}

    def _kernel(self) -> Any:
        return roll_out_kernel(bool(self.world.joints))

    def _inputs(self, first: int, index: int, /) -> list[Any]:
        return [self._system, *self._references, first, index, self._apart]

    def _enlarge(self) -> bool:
        return enlarge(self._system, self._state, self._joints, self.world)

    def _states(self, batch: Batch) -> tuple[Array, Array, Array, Array]:
        c, count = batch.worlds, batch.count
        motion = {name: content.pull()[:c, :count] for name, content in self._motion.items()}
        return (
            motion["position"].copy(),
            np.roll(motion["orientation"], 1, axis=-1),
            motion["velocity"].copy(),
            motion["angular_velocity"].copy(),
        )

    def _events(self, batch: Batch) -> tuple[tuple[Event, ...], ...]:
        ends = self._end_of_contacts(batch, 2.0 * self.world.time.substep)
        return tuple(self._log.events(w, float(ends[w])) for w in range(batch.worlds))
