"""Which observations meet which samples of a rollout, and by how much the two differ.

Every observed position and orientation becomes one entry; entries are ordered by time, so that a shorter
horizon is a prefix. Planar worlds are compared in their motion plane only: what happens along its normal is
outside the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.readouts import object_mesh
from polyworld.representations.rigid import RigidObject
from polyworld.symmetry import smallest_rotation, turn_about
from polyworld.tracks import ObservedTracks
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Entries:
    """Observations of one kind: sample (m,), object column in the world (m,), and column in the tracks (m,)."""

    sample: Ints
    column: Ints
    track: Ints

    def before(self, samples: int) -> int:
        """How many entries belong to the first `samples` sample times."""
        return int(np.searchsorted(self.sample, samples, side="left"))


@dataclass(frozen=True)
class Readout:
    """The tracks of a record that a world can be compared with; its shapes are `shape_entries`.

    axes (d, 3): rows span the directions compared, d = 2 in planar worlds. sample_times (T,) [s] at the
    world's own seconds_per_frame. unmodelled: tracks without an object of that name in the world, unobserved:
    objects without a track.
    """

    tracks: ObservedTracks
    sample_times: Array
    positions: Entries
    rotations: Entries
    axes: Array
    normal: Array | None
    unmodelled: tuple[str, ...]
    unobserved: tuple[str, ...]

    @classmethod
    def of(cls, world: World, tracks: ObservedTracks) -> Readout:
        """Match tracks to the world's objects by name.

        Observations before an object's start_time are left out, as are those of confidence 0. Raises
        ValueError when no name matches, no frame is left, or a frame number is negative.
        """
        names = list(world.moving_names)
        known = tracks.observed_names
        if not any(n in names for n in known):
            raise ValueError(f"no track belongs to an object of the world; tracks {list(known)}, objects {names}")
        if len(tracks.frames) == 0 or tracks.frames[0] < 0:
            raise ValueError("tracks must have at least one frame, and frame numbers must not be negative")
        times = tracks.frames.astype(np.float64) * world.time.seconds_per_frame
        columns = np.array([names.index(n) if n in names else -1 for n in tracks.names], dtype=np.int64)
        starts = np.array([start_time(world, n) if n in names else np.inf for n in tracks.names])
        # A start time is a frame's time up to rounding.
        present = times[:, None] >= starts[None, :] - 1e-9
        seen = present & (tracks.confidence > 0.0)
        fluids = {d.name for d in world.deformables if d.representation.startswith("fluid")}
        compared = np.array(
            [
                (order != 0 or not world.planar) and n not in fluids
                for n, order in zip(tracks.names, tracks.symmetry, strict=True)
            ],
            dtype=bool,
        )
        turned = (
            present
            & compared[None, :]
            & (tracks.orientation_confidence > 0.0)
            & np.all(np.isfinite(tracks.orientations), axis=-1)
        )
        frame = geometry.plane_axes(world.environment.motion_plane)
        return cls(
            tracks=tracks,
            sample_times=times,
            positions=_entries(seen, columns),
            rotations=_entries(turned, columns),
            axes=frame[:2] if world.planar else np.eye(3),
            normal=frame[2] if world.planar else None,
            unmodelled=tuple(n for n in known if n not in names),
            unobserved=tuple(n for n in names if n not in known),
        )

    def position_differences(self, batch: BatchTrajectory) -> Array:
        """Simulated minus observed positions [m], shape (W, m, d), for the samples the batch holds."""
        count = self.positions.before(batch.positions.shape[1])
        rows, columns = self.positions.sample[:count], self.positions.column[:count]
        observed = self.tracks.positions[rows, self.positions.track[:count]]
        difference: Array = (batch.positions[:, rows, columns] - observed) @ self.axes.T
        return difference

    def rotation_differences(self, batch: BatchTrajectory) -> Array:
        """Rotation from observed to simulated orientation [rad], shape (W, m, 1) planar or (W, m, 3) spatial.

        Planar: the angle about the plane's normal, folded into the object's symmetry of order n. Spatial: the
        rotation vector, the smallest over the n turns about the body's z axis that look alike; for order 0
        the turn about that axis is removed and only its tilt remains.
        """
        count = self.rotations.before(batch.orientations.shape[1])
        rows, columns = self.rotations.sample[:count], self.rotations.column[:count]
        track = self.rotations.track[:count]
        simulated = batch.orientations[:, rows, columns]
        observed = self.tracks.orientations[rows, track]
        order = np.asarray(self.tracks.symmetry)[track]
        if self.normal is not None:
            return turn_about(simulated, observed, self.normal, order)[..., None]
        return smallest_rotation(simulated, observed, order)


def _entries(chosen: NDArray[np.bool_], columns: Ints) -> Entries:
    sample, track = np.nonzero(chosen)  # row-major: ordered by time
    return Entries(sample.astype(np.int64), columns[track], track.astype(np.int64))


def start_time(world: World, name: str) -> float:
    """Time [s] at which an object joins; fluids are there from the beginning."""
    return float(getattr(world.item(name), "start_time", 0.0))


def turning_length(world: World, name: str, normal: Array | None) -> float:
    """`gyration_radius` of any object of a world, a deformable one in its initial shape [m]."""
    item = world.item(name)
    if isinstance(item, RigidObject):
        return gyration_radius(item, normal)
    mesh = object_mesh(world, name)
    share = mesh.measure / mesh.measure.sum()
    offset = mesh.nodes - share @ mesh.nodes
    if normal is None:  # the mean over the axes of the squared distances from each
        return float(np.sqrt(2.0 / 3.0 * share @ (offset**2).sum(axis=1)))
    return float(np.sqrt(share @ ((offset - np.outer(offset @ normal, normal)) ** 2).sum(axis=1)))


def gyration_radius(item: RigidObject, normal: Array | None) -> float:
    """Radius of gyration [m]: about the motion plane's normal, or the mean over the axes.

    It is the length by which a rotation moves an object's substance, so it turns radians into metres.
    """
    properties = geometry.mass_properties(item.shape)
    if normal is None:
        return float(np.sqrt(np.trace(properties.inertia) / 3.0 / properties.volume))
    body = geometry.quaternion_matrix(np.asarray(item.orientation)).T @ normal
    return float(np.sqrt(body @ properties.inertia @ body / properties.volume))
