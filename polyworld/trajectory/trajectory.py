"""Results of a rollout: sampled motion, events and status. Plain arrays in, plain arrays out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

EventKind = Literal["contact_begin", "contact_end", "entry", "exit", "rest", "release"]
Status = Literal["completed", "diverged"]


@dataclass(frozen=True)
class Event:
    """Something that happened: when, to whom, and how hard.

    time [s]; participants are object or static names, alphabetical for contacts; impulse [N s] is the normal
    impulse of the first substep for contact_begin and of the whole contact for contact_end; speed [m/s] is
    the normal approach speed for contact_begin; position [m] is the contact point or the object's centre.
    """

    kind: EventKind
    time: float
    participants: tuple[str, ...]
    position: tuple[float, float, float] | None = None
    impulse: float | None = None
    speed: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the event as JSON-ready values."""
        return {
            "kind": self.kind,
            "time": self.time,
            "participants": list(self.participants),
            "position": None if self.position is None else list(self.position),
            "impulse": self.impulse,
            "speed": self.speed,
        }


@dataclass(frozen=True)
class PointMotion:
    """Points of one deformable object at T times: nodes of a rope, cloth or soft body, particles of a fluid.

    points, velocities (..., T, k, 3) [m], [m/s]: NaN for a fluid particle that is not (yet, or any more) there.
    quantities: name -> (..., T, m), for example tension of a rope's segments [N]. In a batch the arrays have a
    leading axis W. Elements between the points: `polyworld.model.mesh_of`.
    """

    points: Array
    velocities: Array
    quantities: Mapping[str, Array] = field(default_factory=dict)

    def select(self, index: Any) -> PointMotion:
        """Index the leading axes: one world of a batch, or some of the times."""
        return PointMotion(
            self.points[index], self.velocities[index], {k: v[index] for k, v in self.quantities.items()}
        )


@dataclass(frozen=True)
class Trajectory:
    """Motion of n objects at T times: rigid ones, then deformable ones, of which these are the motion of the centre
    of mass, the mean rotation (identity for fluids) and the mean angular velocity. `deformables` has their points.

    times (T,) [s]; positions (T, n, 3) [m]; orientations (T, n, 4) w, x, y, z; velocities (T, n, 3) [m/s];
    angular_velocities (T, n, 3) [rad/s]; active (T, n): False before an object's start_time.
    Rows after a divergence are absent: T then is shorter than asked.
    """

    names: tuple[str, ...]
    times: Array
    positions: Array
    orientations: Array
    velocities: Array
    angular_velocities: Array
    active: Bools
    deformables: Mapping[str, PointMotion] = field(default_factory=dict)

    def index(self, name: str) -> int:
        """Return the column of an object; raises KeyError naming the valid choices."""
        if name not in self.names:
            raise KeyError(f"unknown object {name!r}; objects: {list(self.names)}")
        return self.names.index(name)


@dataclass(frozen=True)
class Rollout:
    """A world run forward: deterministic, so equal worlds and horizons give equal bytes."""

    world_id: str
    horizon: float
    trajectory: Trajectory
    events: tuple[Event, ...]
    status: Status = "completed"
    diverged_time: float | None = None
    diverged_object: str | None = None
    diverged_element: int | None = None  # node of a deformable object


@dataclass(frozen=True)
class BatchTrajectory:
    """Motion of W variants of one world; leading axis W, otherwise as `Trajectory`, world axes and SI.

    Samples of a diverged world from its divergence on are NaN and `diverged` (W,) is True there;
    diverged_time (W,) [s] and diverged_object (W,) index say where it happened (NaN, -1 elsewhere).
    times (W, T): worlds with different seconds_per_frame have different times.
    """

    names: tuple[str, ...]
    times: Array
    positions: Array
    orientations: Array
    velocities: Array
    angular_velocities: Array
    active: Bools  # (T, n), the same in all worlds
    diverged: Bools
    diverged_time: Array
    diverged_object: NDArray[np.int64]
    events: tuple[tuple[Event, ...], ...]  # one tuple a world; empty tuples when events were not recorded
    deformables: Mapping[str, PointMotion] = field(default_factory=dict)
    diverged_element: NDArray[np.int64] | None = None  # (W,) node of a deformable object, 0 of a rigid one, -1

    def world(self, index: int) -> Trajectory:
        """Return the trajectory of one world, cut before its divergence."""
        count = self.times.shape[1]
        if self.diverged[index]:
            # Not by what is NaN: so is the centre of a fluid that has not started to flow.
            count = int(np.searchsorted(self.times[index], self.diverged_time[index] * (1.0 - 1e-12)))
        keep = slice(0, count)
        return Trajectory(
            names=self.names,
            times=self.times[index, keep],
            positions=self.positions[index, keep],
            orientations=self.orientations[index, keep],
            velocities=self.velocities[index, keep],
            angular_velocities=self.angular_velocities[index, keep],
            active=self.active[keep],
            deformables={name: motion.select((index, keep)) for name, motion in self.deformables.items()},
        )
