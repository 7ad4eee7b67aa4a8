"""Results of a rollout: sampled motion, events and status. Plain arrays in, plain arrays out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.core.reported import Reported, json_ready

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

EventKind = Literal["contact_begin", "contact_end", "entry", "exit", "rest", "release"]
Status = Literal["completed", "diverged", "truncated"]


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
    Rows after a divergence or truncation are absent: T then is shorter than asked.
    """

    names: tuple[str, ...]
    times: Array
    positions: Array
    orientations: Array
    velocities: Array
    angular_velocities: Array
    active: Bools
    deformables: Mapping[str, PointMotion] = field(default_factory=dict)

    def __repr__(self) -> str:
        span = f"{self.times[0]:.4g} to {self.times[-1]:.4g} s" if len(self.times) else "empty"
        return f"Trajectory({', '.join(self.names)}; {len(self.times)} samples, {span})"

    def index(self, name: str) -> int:
        """Return the column of an object; raises KeyError naming the valid choices."""
        if name not in self.names:
            raise KeyError(f"unknown object {name!r}; objects: {list(self.names)}")
        return self.names.index(name)

    def select(self, rows: NDArray[np.int64]) -> Trajectory:
        """Return the motion at some of the times."""
        return Trajectory(
            names=self.names,
            times=self.times[rows],
            positions=self.positions[rows],
            orientations=self.orientations[rows],
            velocities=self.velocities[rows],
            angular_velocities=self.angular_velocities[rows],
            active=self.active[rows],
            deformables={name: motion.select(rows) for name, motion in self.deformables.items()},
        )

    def batch(self) -> BatchTrajectory:
        """Return the same as the motion of a single world."""
        return BatchTrajectory(
            names=self.names,
            times=self.times[None],
            positions=self.positions[None],
            orientations=self.orientations[None],
            velocities=self.velocities[None],
            angular_velocities=self.angular_velocities[None],
            active=self.active,
            diverged=np.zeros(1, dtype=bool),
            diverged_time=np.full(1, np.nan),
            diverged_object=np.full(1, -1, dtype=np.int64),
            events=((),),
            deformables={name: motion.select(None) for name, motion in self.deformables.items()},
        )


@dataclass(frozen=True)
class Truncation:
    """The end of a run that could not go on: when [s], and why, in words."""

    time: float
    reason: str


@dataclass(frozen=True, repr=False)
class Rollout(Reported):
    """A world run forward: deterministic, so equal worlds and horizons give equal bytes.

    diverged_reason: in words, None where the state was no number or too fast. truncated: when and why the run was ended
    early, though nothing diverged. contacts_until: contact and release events
    are known up to this time [s] only, 0 where events were not recorded (then there is none of any kind); None where
    they are known throughout.
    """

    world_id: str
    horizon: float
    trajectory: Trajectory
    events: tuple[Event, ...]
    status: Status = "completed"
    diverged_time: float | None = None
    diverged_object: str | None = None
    diverged_element: int | None = None  # node of a deformable object
    diverged_reason: str | None = None
    truncated: Truncation | None = None
    contacts_until: float | None = None

    def summary(self) -> str:
        """Return how it ended and where each object began and ended, a line each."""
        motion = self.trajectory
        lines = [
            f"Rollout of {self.world_id}: {self.horizon:.4g} s, {self.why_ended() or 'completed'}; "
            f"{len(motion.times)} samples, {len(self.events)} events"
        ]
        for column, name in enumerate(motion.names):
            rows = np.flatnonzero(motion.active[:, column])
            if not len(rows):
                lines.append(f"  {name}: not there before {self.horizon:.4g} s")
                continue
            begin, end = (", ".join(f"{x:.4g}" for x in motion.positions[row, column]) for row in rows[[0, -1]])
            speed = float(np.linalg.norm(motion.velocities[rows[-1], column]))
            lines.append(f"  {name}: ({begin}) to ({end}) m, at {speed:.4g} m/s")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return motion and events as JSON-ready values, arrays as nested lists (`Trajectory` has shapes and units).

        None stands where an object is not there yet; points of deformable objects are left out.
        """
        motion = self.trajectory
        there = motion.active[..., None]
        found: dict[str, Any] = json_ready(
            {
                "world": self.world_id,
                "horizon": self.horizon,
                "status": self.status,
                "why_ended": self.why_ended(),
                "names": motion.names,
                "times": motion.times,
                "positions": np.where(there, motion.positions, np.nan),
                "orientations": np.where(there, motion.orientations, np.nan),
                "velocities": np.where(there, motion.velocities, np.nan),
                "angular_velocities": np.where(there, motion.angular_velocities, np.nan),
                "events": [event.to_dict() for event in self.events],
            }
        )
        return found

    def why_ended(self) -> str | None:
        """Return when and why the run ended before its horizon, in words; None where it did not."""
        if self.truncated is not None:
            return f"truncated at {self.truncated.time:.4g} s: {self.truncated.reason}"
        if self.status == "completed":
            return None
        node = "" if self.diverged_object not in self.trajectory.deformables else f", node {self.diverged_element}"
        reason = "" if self.diverged_reason is None else f": {self.diverged_reason}"
        return f"diverged at {self.diverged_time:.4g} s ({self.diverged_object}{node}){reason}"

    def why_no_contacts(self) -> str | None:
        """Return why contacts are not known throughout, in words; None where they are."""
        if self.contacts_until is None:
            return None
        if self.contacts_until <= 0.0:
            return "events were not recorded (record_events=False)"
        return f"contact events are recorded up to {self.contacts_until:.6g} s only: there were too many"


@dataclass(frozen=True)
class BatchTrajectory:
    """Motion of W variants of one world; leading axis W, otherwise as `Trajectory`, world axes and SI.

    Samples of a diverged world from its divergence on are NaN and `diverged` (W,) is True there;
    diverged_time (W,) [s] and diverged_object (W,) index say where it happened (NaN, -1 elsewhere).
    times (W, T): worlds with different seconds_per_frame have different times. truncated: of the worlds that ended
    early without a divergence, by index; their samples from then on are NaN too. contacts_until (W,): see `Rollout`.
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
    truncated: Mapping[int, Truncation] = field(default_factory=dict)
    contacts_until: tuple[float | None, ...] | None = None

    @property
    def stopped(self) -> Bools:
        """Whether each world (W,) diverged or was truncated."""
        found: Bools = self.diverged | np.isfinite(self.end_times())
        return found

    def end_times(self) -> Array:
        """Times (W,) at which worlds diverged or were truncated [s]; NaN where they were not."""
        found: Array = np.where(self.diverged, self.diverged_time, np.nan)
        for w, truncation in self.truncated.items():
            found[w] = truncation.time
        return found

    def world(self, index: int) -> Trajectory:
        """Return the trajectory of one world, cut before its divergence or truncation."""
        count, end = self.times.shape[1], self.end_times()[index]
        if np.isfinite(end):
            # Not by what is NaN: so is the centre of a fluid that has not started to flow.
            count = int(np.searchsorted(self.times[index], end * (1.0 - 1e-12)))
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
