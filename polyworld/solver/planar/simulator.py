"""W variants of one planar world, run in one kernel launch per share of the worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import Model
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.effect_contacts import contact_laws
from polyworld.solver.core.effect_forces import forces_among
from polyworld.solver.core.references import by_reference
from polyworld.solver.core.simulator import Batch, RigidSimulator
from polyworld.solver.planar.kernels import roll_out
from polyworld.solver.planar.plane_motion import PlaneMotion
from polyworld.solver.planar.records import Bodies, Contacts, References, Row, Samples, Scene, Step
from polyworld.solver.planar.scene import build_scene
from polyworld.solver.planar.statics import rotation_in_plane, static_poses
from polyworld.trajectory import Event
from polyworld.world import geometry

Array = NDArray[np.float64]

MOST_BYTES = 1_000_000_000  # of contact rows
BODY_FIELDS = {
    "pose": wp.vec3d,
    "rate": wp.vec3d,
    "next_rate": wp.vec3d,
    "shift": wp.vec3d,
    "push": wp.vec3d,
    "control": wp.vec3d,
    "drag": wp.vec3d,
    "reaction": wp.vec3d,
    "touching": wp.int32,
    "coupled": wp.int32,
    "decay_step": wp.float64,
    "since": wp.float64,
    "room": wp.vec2d,
    "ahead": wp.vec2d,
    "cuts": wp.int32,
    "members": wp.int32,
    "member": wp.int32,
    "label": wp.int32,
    "island": wp.int32,
    "island_of": wp.int32,
    "last_rate": wp.vec3d,
    "rate_direction": wp.vec3d,
    "last_drag": wp.vec3d,
    "drag_direction": wp.vec3d,
    "linear_decay": wp.vec3d,
    "angular_decay": wp.vec3d,
    "mass": wp.float64,
    "inverse_mass": wp.float64,
    "inverse_inertia": wp.float64,
    "hold": wp.float64,
    "support": wp.float64,
    "mixed": wp.vec3d,
    "patch": wp.vec2d,
    "linear_damping": wp.float64,
    "angular_damping": wp.float64,
    "rolling": wp.float64,
    "height": wp.float64,
}


class PlanarSimulator(RigidSimulator):
    """See `RigidSimulator`.

    Bodies and statics are their outlines on the motion plane. A pair can meet only if their extents along the
    plane's normal overlap at the start; a static plane counts where it cuts the motion plane. Pressing on the
    motion plane is not a contact event; touching a static is. A contact that opens for less than MERGE
    seconds and closes again is one contact.
    """

    def _build(self, model: Model) -> None:
        self._scene, self._static_poses = build_scene(model)
        world, self._axes = model.world, model.plane_axes
        rotations = [geometry.quaternion_matrix(np.asarray(o.orientation)) for o in world.objects]
        # Moment of inertia about the plane's normal, per unit mass.
        self._gyration = np.array(
            [
                self._axes[2] @ r @ s.inertia @ r.T @ self._axes[2] / s.volume
                for r, s in zip(rotations, model.solids, strict=True)
            ]
        )
        self._described = np.array([o.orientation for o in world.objects]).reshape(1, -1, 4)
        self._allocate()

    def roll(
        self,
        overrides: Mapping[str, Array] | None = None,
        *,
        samples: int | NDArray[np.int64] | None = None,
        schedule: NDArray[np.int64] | None = None,
    ) -> PlaneMotion:
        """As `run`, in the plane: views of buffers that the next run writes to."""
        batch = self._roll(overrides, samples, schedule)
        out, c = self._of_samples, batch.worlds
        out.pull()
        return PlaneMotion(
            names=self.names,
            axes=self._axes,
            times=batch.times,
            pose=out.pose[:c, : batch.count],
            rate=out.rate[:c, : batch.count],
            height=self._of_bodies.height[:c],
            described=self._described,
            diverged=batch.diverged | batch.truncated,
        )

    def _allocate(self) -> None:
        w, n, s = self.n_worlds, self._scene.bodies, self._scene.statics
        self._scene.schedule = self._schedule
        own = self.model.arrays()
        self._scene.contact_laws, self._scene.forces = contact_laws(own.effect_kind), forces_among(own.effect_kind)
        effects = self._scene.effects
        effects.kind, effects.acts = buffers.ints(own.effect_kind), buffers.ints(own.effect_acts)
        effects.programs = buffers.doubles(own.effect_programs)
        effects.parameters = buffers.doubles(np.repeat(own.effect_parameters, w, axis=0))
        self._effect_parameters = buffers.Mirror(effects.parameters)
        pairs = int(np.triu(buffers.read(self._scene.collides), 1).sum())
        corners = np.diff(buffers.read(self._scene.first))
        bodies = Bodies()
        for name, dtype in BODY_FIELDS.items():
            setattr(bodies, name, buffers.per_world((w, n), dtype))
        bodies.static_pose = buffers.per_world((w, s), wp.vec3d)
        bodies.first_row = buffers.per_world((w, n + 2), wp.int32)
        bodies.first_body = buffers.per_world((w, n + 2), wp.int32)
        bodies.friction = buffers.per_world((w, n + s), wp.float64)
        bodies.restitution = buffers.per_world((w, n + s), wp.float64)
        bodies.gravity = buffers.zeros((w,), wp.vec3d)
        bodies.time_scale = buffers.zeros((w,), wp.float64)
        bodies.time_origin = buffers.zeros((w,), wp.float64)
        bodies.corners = buffers.per_world((w, 2 * int(corners.max(initial=1))), wp.vec2d)
        contacts = Contacts()
        slots, pairs = self._slots, max(pairs, 1)
        contacts.near = buffers.per_world((slots, pairs), wp.vec2i)
        contacts.near_gap = buffers.per_world((slots, pairs), wp.float64)
        contacts.meet = buffers.per_world((slots, pairs), wp.float64)
        for name in ("row_at", "row_count"):
            setattr(contacts, name, buffers.per_world((slots, pairs), wp.int32))
        for name in ("kept", "kept_rows"):
            setattr(contacts, name, buffers.per_world((slots, pairs), wp.vec2i))
        contacts.last = buffers.zeros((w,), Step)
        # Touching outlines form a planar graph: at most 3 (n + s) pairs of two points, twice that for overlaps.
        rows = min(2 * pairs, 12 * (n + s) + 64)
        contacts.rows = buffers.per_world((slots, 2, rows), Row)
        contacts.active = buffers.per_world((slots, rows), wp.int32)
        contacts.order = buffers.per_world((slots, rows), wp.int32)
        samples = Samples()
        samples.pose = buffers.per_world((w, self.sample_times.shape[1], n), wp.vec3d)
        samples.rate = buffers.per_world((w, self.sample_times.shape[1], n), wp.vec3d)
        samples.outcome = self._outcome
        self._bodies, self._contacts, self._samples = bodies, contacts, samples
        self._of_bodies, self._of_samples = map(_Mirrors, (bodies, samples))
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
        b.patch[:c, :, 0] = arrays.torsional_radius
        b.patch[:c, :, 1] = arrays.torsional_radius**2 / self._gyration
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
        self._effect_parameters.values[:c] = arrays.effect_parameters
        self._effect_parameters.push()
        b.decay_step[:c] = -1.0
        b.since[:c] = 0.0
        b.cuts[:c] = 0
        b.reaction[:c] = 0.0
        b.touching[:c] = 0
        b.control[:c] = 0.0
        b.push()

    def _forget(self, worlds: NDArray[np.int64]) -> None:
        self._of_samples.pose[worlds] = np.nan
        self._of_samples.rate[worlds] = np.nan
        self._of_samples.push()

    def control(
        self, forces: Array, torques: Array, efforts: Mapping[str, float], speeds: Mapping[str, float], /
    ) -> None:
        del efforts, speeds  # no joints, no motors
        control = self._of_bodies.control[:1]
        control[..., :2] = forces @ self._axes[:2].T * self._of_bodies.inverse_mass[:1, :, None]
        control[..., 2] = torques @ self._axes[2] * self._of_bodies.inverse_inertia[:1]
        buffers.write(self._bodies.control, control, np.s_[:1])

    def release(self) -> None:
        self._of_bodies.control[:1] = 0.0
        buffers.write(self._bodies.control, 0.0, np.s_[:1])

    def _records(self) -> dict[str, Any]:
        return {"bodies": self._bodies, "contacts": self._contacts}

    def _kernel(self) -> Any:
        return roll_out

    def _inputs(self, first: int, index: int, /) -> list[Any]:
        records = [self._scene, self._bodies, self._contacts, self._log.record, self._samples]
        return [*records, self._references, first, index, self._apart]

    def _enlarge(self) -> bool:
        """Make room for two points of every pair that may meet, more than which there cannot be."""
        contacts = self._contacts
        slots, halves, rows = contacts.rows.shape
        most = 2 * contacts.near.shape[1]
        if rows >= most or slots * halves * most * wp.types.type_size_in_bytes(Row) > MOST_BYTES:
            return False
        contacts.rows = buffers.per_world((slots, halves, most), Row)
        contacts.active = buffers.per_world((slots, most), wp.int32)
        contacts.order = buffers.per_world((slots, most), wp.int32)
        self._references.contacts = by_reference(contacts, Contacts)
        return True

    def _states(self, batch: Batch) -> tuple[Array, Array, Array, Array]:
        c, axes = batch.worlds, self._axes
        self._of_samples.pull()
        pose, rate = self._of_samples.pose[:c, : batch.count], self._of_samples.rate[:c, : batch.count]
        rotation = np.zeros((*pose.shape[:3], 4))
        rotation[..., 0] = np.cos(pose[..., 2] / 2)
        rotation[..., 1:] = np.sin(pose[..., 2] / 2)[..., None] * axes[2]
        # The angle counts from the world's own orientation, an override's rotation included.
        described = np.broadcast_to(self._described[:, None], rotation.shape)
        return (
            pose[..., :2] @ axes[:2] + self._of_bodies.height[:c, None, :, None] * axes[2],
            geometry.quaternion_product(rotation, described),
            rate[..., :2] @ axes[:2],
            rate[..., 2:] * axes[2],
        )

    def _events(self, batch: Batch) -> tuple[tuple[Event, ...], ...]:
        ends = self._end_of_contacts(batch, 0.0)
        height = self._of_bodies.height
        found = []
        for w in range(batch.worlds):

            def place(episode: Any, w: int = w) -> Array:
                spot: Array = episode["position"][:2] @ self._axes[:2] + height[w, episode["a"]] * self._axes[2]
                return spot

            found.append(self._log.events(w, float(ends[w]), place=place))
        return tuple(found)


class _Mirrors:
    """A record's Warp arrays in NumPy, each looked up once; see `polyworld.core.buffers.Mirror`."""

    def __init__(self, record: Any) -> None:
        self._record = record
        self._kept: list[buffers.Mirror] = []

    def __getattr__(self, name: str) -> Any:
        kept = buffers.Mirror(getattr(self._record, name))
        self._kept.append(kept)
        setattr(self, name, kept.values)
        return kept.values

    def pull(self) -> None:
        """Take from the device what was looked up."""
        for kept in self._kept:
            kept.pull()

    def push(self) -> None:
        """Give the device what was looked up."""
        for kept in self._kept:
            kept.push()
