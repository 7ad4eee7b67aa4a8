"""W variants of one planar world, run in one kernel launch per share of the worlds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.core.arrays import Overriding, RigidArrays, check_samples, check_worlds
from polyworld.solver.core.effect_contacts import contact_laws
from polyworld.solver.core.effect_forces import forces_among
from polyworld.solver.core.episodes import ContactLog
from polyworld.solver.core.references import by_reference
from polyworld.solver.core.thread_pool import run_in_pool, shares
from polyworld.solver.core.time_table import schedules
from polyworld.solver.planar.plane_motion import PlaneMotion
from polyworld.solver.planar.records import Bodies, Contacts, References, Row, Samples, Scene
from polyworld.solver.planar.scene import build_joints, build_scene
from polyworld.solver.planar.statics import rotation_in_plane, static_poses
from polyworld.solver.planar.step import rollout
from polyworld.trajectory import BatchTrajectory, Event
from polyworld.world import World, geometry

Array = NDArray[np.float64]

EPISODES = 4096  # contact episodes kept for a world; more is an error, not a silence
BODY_FIELDS = {
    "pose": wp.vec3d,
    "rate": wp.vec3d,
    "next_rate": wp.vec3d,
    "shift": wp.vec3d,
    "push": wp.vec3d,
    "drag": wp.vec3d,
    "reaction": wp.vec3d,
    "touching": wp.int32,
    "coupled": wp.int32,
    "linear_decay": wp.vec3d,
    "angular_decay": wp.vec3d,
    "mass": wp.float64,
    "inverse_mass": wp.float64,
    "inverse_inertia": wp.float64,
    "hold": wp.float64,
    "support": wp.float64,
    "mixed": wp.vec3d,
    "patch": wp.float64,
    "linear_damping": wp.float64,
    "angular_damping": wp.float64,
    "rolling": wp.float64,
    "height": wp.float64,
}


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class PlanarSimulator:
    """See `polyworld.solver.rollout.simulator`. Buffers are allocated once and written in place on every run.

    Bodies and statics are their outlines on the motion plane. A pair can meet only if their extents along the
    plane's normal overlap at the start; a static plane counts where it cuts the motion plane. Pressing on the
    motion plane is not a contact event; touching a static is. A contact that opens for less than MERGE
    seconds and closes again is one contact. A hinge holds each body by the point that lies at its anchor where
    the run starts the body, overrides included; it makes no events.
    """

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
        self.threads = threads or available_cores()
        self._overriding = Overriding(world)
        self._table = schedules(world, self.sample_times)
        self._scene, self._all_names, self._static_poses = build_scene(world, self._table)
        self._axes = geometry.plane_axes(world.environment.motion_plane)
        rotations = [geometry.quaternion_matrix(np.asarray(o.orientation)) for o in world.objects]
        solids = [geometry.mass_properties(o.shape) for o in world.objects]
        # Moment of inertia about the plane's normal, per unit mass.
        self._gyration = np.array(
            [
                self._axes[2] @ r @ s.inertia @ r.T @ self._axes[2] / s.volume
                for r, s in zip(rotations, solids, strict=True)
            ]
        )
        self._described = np.array([o.orientation for o in world.objects]).reshape(1, -1, 4)
        self._joints = build_joints(world)
        self._allocate()

    def run(
        self,
        overrides: Mapping[str, Array] | None = None,
        *,
        samples: int | NDArray[np.int64] | None = None,
        schedule: NDArray[np.int64] | None = None,
    ) -> BatchTrajectory:
        """Roll variants out from their initial state; see `polyworld.solver.rollout.Simulator`."""
        return self._trajectory(self.roll(overrides, samples=samples, schedule=schedule))

    def roll(
        self,
        overrides: Mapping[str, Array] | None = None,
        *,
        samples: int | NDArray[np.int64] | None = None,
        schedule: NDArray[np.int64] | None = None,
    ) -> PlaneMotion:
        """As `run`, in the plane: views of buffers that the next run writes to."""
        each = check_samples(self.sample_times.shape[1], samples)
        count = int(each.max())
        worlds = check_worlds(self.n_worlds, overrides, schedule)
        arrays = self._overriding.arrays(overrides) if overrides else self._overriding.own
        own = np.zeros(worlds, dtype=np.int64) if schedule is None else schedule
        self._of_scene.schedule[:worlds] = own
        self._of_scene.reach[:worlds] = self._table.segments(own, each)
        self._write(arrays, worlds)
        self._launch(worlds)
        return self._rolled(own, count)

    def _allocate(self) -> None:
        w, n, s = self.n_worlds, self._scene.bodies, self._scene.statics
        self._scene.schedule, self._scene.reach = buffers.zeros((w,), wp.int32), buffers.zeros((w,), wp.int32)
        own = self._overriding.own
        self._scene.contact_laws, self._scene.forces = contact_laws(own.effect_kind), forces_among(own.effect_kind)
        effects = self._scene.effects
        effects.kind, effects.acts = buffers.ints(own.effect_kind), buffers.ints(own.effect_acts)
        effects.programs = buffers.doubles(own.effect_programs)
        effects.parameters = buffers.doubles(np.repeat(own.effect_parameters, w, axis=0))
        self._effect_parameters = _view(effects.parameters)
        pairs = int(_view(self._scene.collides).sum())
        corners = np.diff(_view(self._scene.first))
        bodies = Bodies()
        for name, dtype in BODY_FIELDS.items():
            setattr(bodies, name, buffers.zeros((w, n), dtype))
        bodies.static_pose = buffers.zeros((w, s), wp.vec3d)
        bodies.decay_step = buffers.zeros((w,), wp.float64)
        bodies.friction = buffers.zeros((w, n + s), wp.float64)
        bodies.restitution = buffers.zeros((w, n + s), wp.float64)
        bodies.gravity = buffers.zeros((w,), wp.vec3d)
        bodies.time_scale = buffers.zeros((w,), wp.float64)
        bodies.time_origin = buffers.zeros((w,), wp.float64)
        bodies.corners = buffers.zeros((w, 2 * int(corners.max(initial=1))), wp.vec2d)
        contacts = Contacts()
        contacts.near = buffers.zeros((w, max(pairs, 1)), wp.vec2i)
        contacts.near_gap = buffers.zeros((w, max(pairs, 1)), wp.float64)
        # Touching outlines form a planar graph: at most 3 (n + s) pairs of two points, twice that for overlaps.
        contacts.rows = buffers.zeros((w, 2, min(2 * max(pairs, 1), 12 * (n + s) + 64)), Row)
        joints = self._joints
        joints.anchor = buffers.zeros((w, joints.count), wp.vec2d)
        joints.arm = buffers.zeros((w, joints.count, 2), wp.vec2d)
        joints.moment_arm = buffers.zeros((w, joints.count, 2), wp.vec2d)
        joints.impulse = buffers.zeros((w, joints.count), wp.vec2d)
        joints.active = buffers.zeros((w, joints.count), wp.int32)
        self._log = ContactLog(w, self.names, self._all_names, record=self.record_events, capacity=EPISODES)
        samples = Samples()
        samples.pose = buffers.zeros((w, self.sample_times.shape[1], n), wp.vec3d)
        samples.rate = buffers.zeros((w, self.sample_times.shape[1], n), wp.vec3d)
        samples.diverged_object = buffers.zeros((w,), wp.int32)
        samples.diverged_time = buffers.zeros((w,), wp.float64)
        samples.overflowed = buffers.zeros((w,), wp.int32)
        self._bodies, self._contacts, self._samples = bodies, contacts, samples
        self._of_scene = _Views(self._scene)
        self._of_bodies, self._of_joints, self._of_samples = map(_Views, (bodies, joints, samples))
        self._references = References()
        self._references.scene = by_reference(self._scene, Scene)
        self._references.bodies = by_reference(bodies, Bodies)
        self._references.contacts = by_reference(contacts, Contacts)

    def _write(self, arrays: RigidArrays, c: int) -> None:
        """Fill the device arrays of the first c worlds in place."""
        b, axes = self._of_bodies, self._axes
        flat, normal = axes[:2], axes[2]
        angle = rotation_in_plane(arrays.orientation, self._described, normal, "objects")
        pose, rate = b.pose[:c], b.rate[:c]
        pose[..., :2] = arrays.position @ flat.T
        pose[..., 2] = angle
        rate[..., :2] = arrays.velocity @ flat.T
        rate[..., 2] = arrays.angular_velocity @ normal
        b.height[:c] = arrays.position @ normal
        b.static_pose[:c] = static_poses(self.world, arrays, self._static_poses)
        b.mass[:c] = arrays.mass
        b.inverse_mass[:c] = 1.0 / arrays.mass
        b.inverse_inertia[:c] = 1.0 / (arrays.mass * self._gyration)
        plane = self.world.environment.motion_plane
        load = np.maximum(0.0, -(arrays.gravity @ normal))[:, None] if plane.supports else np.zeros((1, 1))
        own = arrays.plane_friction < 0
        support = np.where(own, arrays.friction, np.sqrt(np.abs(arrays.plane_friction) * arrays.friction))
        b.support[:c] = support
        b.hold[:c] = load * support
        b.patch[:c] = arrays.torsional_radius
        b.linear_damping[:c] = arrays.linear_damping
        b.angular_damping[:c] = arrays.angular_damping
        b.rolling[:c] = arrays.rolling_resistance
        n = self._scene.bodies
        b.friction[:c, :n] = arrays.friction
        b.friction[:c, n:] = arrays.static_friction
        b.restitution[:c, :n] = arrays.restitution
        b.restitution[:c, n:] = arrays.static_restitution
        b.gravity[:c] = arrays.gravity @ axes.T
        b.time_scale[:c] = arrays.time_scale[:, 0]
        b.time_origin[:c] = arrays.time_origin[:, 0]
        self._effect_parameters[:c] = arrays.effect_parameters
        b.decay_step[:c] = -1.0
        b.reaction[:c] = 0.0
        b.touching[:c] = 0
        self._write_joints(arrays, c)
        self._log.clear()
        out = self._of_samples
        out.pose[:c] = np.nan
        out.rate[:c] = np.nan
        out.diverged_object[:c] = -1
        out.diverged_time[:c] = np.nan
        out.overflowed[:c] = 0

    def _write_joints(self, arrays: RigidArrays, c: int) -> None:
        """Set each hinge's pivot in its bodies' own axes, at the poses the run starts from."""
        body, anchor, pose = self._of_joints.body, self._of_joints.anchor[:c], self._of_bodies.pose[:c]
        anchor[:] = arrays.joint_anchor @ self._axes[:2].T
        arm = self._of_joints.arm[:c]
        for j, e in np.argwhere(body >= 0):
            x, y = (anchor[:, j] - pose[:, body[j, e], :2]).T
            angle = pose[:, body[j, e], 2]
            arm[:, j, e, 0] = np.cos(angle) * x + np.sin(angle) * y
            arm[:, j, e, 1] = np.cos(angle) * y - np.sin(angle) * x
        self._of_joints.impulse[:c] = 0.0

    def _launch(self, worlds: int) -> None:
        if self._scene.bodies == 0:
            return
        pieces = shares(worlds, self.threads)
        edges = np.linspace(0, worlds, pieces + 1).astype(int)

        def piece(index: int) -> None:
            first, last = int(edges[index]), int(edges[index + 1])
            buffers.launch(
                rollout,
                last - first,
                [
                    self._scene,
                    self._bodies,
                    self._contacts,
                    self._joints,
                    self._log.record,
                    self._samples,
                    self._references,
                    first,
                ],
            )

        rollout.module.load("cpu", block_dim=1)  # before the threads ask for it
        run_in_pool(piece, pieces, self.threads)

    def _rolled(self, schedule: NDArray[np.int64], count: int) -> PlaneMotion:
        out, c = self._of_samples, len(schedule)
        if out.overflowed[:c].any():
            raise RuntimeError(
                f"{int(out.overflowed[:c].max())} contact points overflow the buffer: the objects overlap at the start"
            )
        return PlaneMotion(
            names=self.names,
            axes=self._axes,
            times=self.sample_times[schedule, :count] * self._of_bodies.time_scale[:c, None],
            pose=out.pose[:c, :count],
            rate=out.rate[:c, :count],
            height=self._of_bodies.height[:c],
            described=self._described,
            diverged=out.diverged_object[:c] >= 0,
        )

    def _trajectory(self, motion: PlaneMotion) -> BatchTrajectory:
        out, axes, pose, rate = self._of_samples, self._axes, motion.pose, motion.rate
        worlds, count = pose.shape[:2]
        rotation = np.zeros((*pose.shape[:3], 4))
        rotation[..., 0] = np.cos(pose[..., 2] / 2)
        rotation[..., 1:] = np.sin(pose[..., 2] / 2)[..., None] * axes[2]
        starts = np.array([o.start_time for o in self.world.objects])
        # The last touch noted before a divergence lies up to a step before it: such a contact has not ended.
        last = np.nanmax(motion.times, axis=1)
        ends = np.where(motion.diverged, out.diverged_time[:worlds] - 2.0 * self.world.time.substep, last)
        return BatchTrajectory(
            names=self.names,
            times=motion.times,
            positions=pose[..., :2] @ axes[:2] + motion.height[:, None, :, None] * axes[2],
            # The angle counts from the world's own orientation, an override's rotation included.
            orientations=geometry.quaternion_product(
                rotation, np.broadcast_to(self._described[:, None], rotation.shape)
            ),
            velocities=rate[..., :2] @ axes[:2],
            angular_velocities=rate[..., 2:] * axes[2],
            active=self.sample_times[0, :count, None] >= starts[None, :],
            diverged=motion.diverged,
            diverged_time=out.diverged_time[:worlds].copy(),
            diverged_object=out.diverged_object[:worlds].astype(np.int64),
            events=tuple(self._events(w, float(ends[w])) for w in range(worlds)),
        )

    def _events(self, w: int, end: float) -> tuple[Event, ...]:
        """Contact events of one world in order of time."""
        height = self._of_bodies.height[w]

        def place(episode: Any) -> Array:
            spot: Array = episode["position"][:2] @ self._axes[:2] + height[episode["a"]] * self._axes[2]
            return spot

        return self._log.events(w, end, place=place)


def _view(array: Any) -> Any:
    """Return the memory of a Warp array on the CPU as a NumPy array."""
    return array.numpy()


class _Views:
    """The memory of a record's Warp arrays on the CPU as NumPy arrays, each looked up once."""

    def __init__(self, record: Any) -> None:
        self._record = record

    def __getattr__(self, name: str) -> Any:
        view = _view(getattr(self._record, name))
        setattr(self, name, view)
        return view
