"""Compare two rollouts: how far objects end up apart, and which events are new, gone or shifted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import Event, Rollout, Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ObjectDifference:
    """How one object's centre moves in the other rollout compared with the base.

    largest [m] at largest_time [s]; final [m] at the end of what both cover; apart_from [s]: first time at
    which the centres are further apart than the tolerance, None if never. All None where the object is
    active in both at no common time. shape_largest [m] at shape_largest_time [s]: root mean square distance between
    the same points of a deformable object in both; None for rigid objects, and where they have other points (a fluid
    that flows in or out, another resolution).
    """

    name: str
    largest: float | None
    largest_time: float | None
    final: float | None
    apart_from: float | None
    shape_largest: float | None = None
    shape_largest_time: float | None = None


@dataclass(frozen=True)
class EventMatch:
    """The same event in both rollouts; shift [s] is the other's time minus the base's."""

    base: Event
    other: Event
    shift: float


@dataclass(frozen=True)
class Comparison:
    """Two rollouts over the time both cover, 0 to `horizon` [s]."""

    horizon: float
    tolerance: float
    time_tolerance: float
    objects: tuple[ObjectDifference, ...]
    objects_only_in_base: tuple[str, ...]
    objects_only_in_other: tuple[str, ...]
    events_only_in_base: tuple[Event, ...]
    events_only_in_other: tuple[Event, ...]
    events_in_both: tuple[EventMatch, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON-ready values."""
        return {
            "horizon": self.horizon,
            "tolerance": self.tolerance,
            "time_tolerance": self.time_tolerance,
            "objects": [asdict(o) for o in self.objects],
            "objects_only_in_base": list(self.objects_only_in_base),
            "objects_only_in_other": list(self.objects_only_in_other),
            "events_only_in_base": [e.to_dict() for e in self.events_only_in_base],
            "events_only_in_other": [e.to_dict() for e in self.events_only_in_other],
            "events_in_both": [
                {"base": m.base.to_dict(), "other": m.other.to_dict(), "shift": m.shift} for m in self.events_in_both
            ],
        }


def compare(
    base: Rollout,
    other: Rollout,
    objects: Sequence[str] | None = None,
    *,
    tolerance: float = 0.01,
    time_tolerance: float = 0.25,
) -> Comparison:
    """Compare two rollouts over the time both cover.

    objects: names to compare (default: all); an event belongs when one of its participants does. tolerance
    [m]: distance from which an object has parted from its base motion. time_tolerance [s]: events of equal
    kind and participants no further apart are the same event. Raises KeyError for a name in neither rollout, and
    ValueError for a rollout without events.
    """
    for rollout, what in ((base, "base"), (other, "other")):
        if rollout.contacts_until is not None and rollout.contacts_until <= 0.0:
            raise ValueError(f"of the {what} rollout {rollout.why_no_contacts()}: roll it out again with them")
    ours, theirs = base.trajectory.names, other.trajectory.names
    known = list(dict.fromkeys([*ours, *theirs]))
    chosen = list(objects) if objects is not None else known
    unknown = [name for name in chosen if name not in known]
    if unknown:
        raise KeyError(f"unknown objects {unknown}; objects in either rollout: {known}")
    horizon = min(_end(base), _end(other))
    a = [e for e in base.events if _belongs(e, chosen, horizon, objects is None)]
    b = [e for e in other.events if _belongs(e, chosen, horizon, objects is None)]
    matches = match_events(a, b, time_tolerance)
    matched_a, matched_b = {i for i, _ in matches}, {j for _, j in matches}
    return Comparison(
        horizon=horizon,
        tolerance=tolerance,
        time_tolerance=time_tolerance,
        objects=tuple(
            _difference(base.trajectory, other.trajectory, name, horizon, tolerance)
            for name in chosen
            if name in ours and name in theirs
        ),
        objects_only_in_base=tuple(n for n in chosen if n not in theirs),
        objects_only_in_other=tuple(n for n in chosen if n not in ours),
        events_only_in_base=tuple(e for i, e in enumerate(a) if i not in matched_a),
        events_only_in_other=tuple(e for j, e in enumerate(b) if j not in matched_b),
        events_in_both=tuple(EventMatch(a[i], b[j], b[j].time - a[i].time) for i, j in sorted(matches)),
    )


def match_events(a: Sequence[Event], b: Sequence[Event], tolerance: float) -> list[tuple[int, int]]:
    """Return index pairs of events of equal kind and participants, nearest in time first, each used once."""
    candidates = sorted(
        (abs(y.time - x.time), i, j)
        for i, x in enumerate(a)
        for j, y in enumerate(b)
        if x.kind == y.kind and x.participants == y.participants and abs(y.time - x.time) <= tolerance
    )
    used_a: set[int] = set()
    used_b: set[int] = set()
    matches = []
    for _, i, j in candidates:
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            matches.append((i, j))
    return matches


def positions_at(trajectory: Trajectory, column: int, times: Array) -> Array:
    """Return the centres (T, 3) of one object at times within the trajectory.

    The cubic through positions and velocities: exact for constant acceleration; between two samples with an
    impact between them, off by a part of the way travelled there.
    """
    if len(trajectory.times) == 1:
        return np.repeat(trajectory.positions[:, column], len(times), axis=0)
    k = np.clip(np.searchsorted(trajectory.times, times, side="right") - 1, 0, len(trajectory.times) - 2)
    step = (trajectory.times[k + 1] - trajectory.times[k])[:, None]
    u = (times - trajectory.times[k])[:, None] / step
    p, v = trajectory.positions[:, column], trajectory.velocities[:, column]
    value: Array = (
        (1 + 2 * u) * (1 - u) ** 2 * p[k]
        + u * (1 - u) ** 2 * step * v[k]
        + u**2 * (3 - 2 * u) * p[k + 1]
        + u**2 * (u - 1) * step * v[k + 1]
    )
    # A sample is returned as it is, to the bit.
    exact = trajectory.times[k] == times
    value[exact] = p[k[exact]]
    last = trajectory.times[k + 1] == times
    value[last] = p[k[last] + 1]
    return value


def _difference(base: Trajectory, other: Trajectory, name: str, horizon: float, tolerance: float) -> ObjectDifference:
    i, j = base.index(name), other.index(name)
    both = (base.times <= horizon) & base.active[:, i]
    # Before the other's object is active it has no motion to compare with.
    started = other.times[other.active[:, j]]
    both &= base.times >= (started[0] if len(started) else np.inf)
    times = base.times[both]
    if len(times) == 0:
        return ObjectDifference(name, None, None, None, None)
    distance = np.linalg.norm(positions_at(other, j, times) - base.positions[both, i], axis=1)
    peak = int(np.argmax(distance))
    beyond = np.flatnonzero(distance > tolerance)
    shape = _shape_difference(base, other, name, times)
    return ObjectDifference(
        name=name,
        largest=float(distance[peak]),
        largest_time=float(times[peak]),
        final=float(distance[-1]),
        apart_from=_first_beyond(times, distance, tolerance, int(beyond[0])) if len(beyond) else None,
        shape_largest=shape[0],
        shape_largest_time=shape[1],
    )


def _shape_difference(
    base: Trajectory, other: Trajectory, name: str, times: Array
) -> tuple[float | None, float | None]:
    """Largest root mean square distance of corresponding points at the base's `times` [m], and when [s]."""
    if name not in base.deformables or name not in other.deformables:
        return None, None
    a, b = base.deformables[name].points, other.deformables[name].points
    if a.shape[1] != b.shape[1] or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return None, None
    rows = np.searchsorted(base.times, times)
    after = np.clip(np.searchsorted(other.times, times), 1, max(len(other.times) - 1, 1))
    if len(other.times) == 1:
        moved = np.repeat(b, len(times), axis=0)
    else:
        gap = other.times[after] - other.times[after - 1]
        share = ((times - other.times[after - 1]) / gap)[:, None, None]
        moved = (1.0 - share) * b[after - 1] + share * b[after]
    apart = np.sqrt(((moved - a[rows]) ** 2).sum(axis=-1).mean(axis=-1))
    peak = int(np.argmax(apart))
    return float(apart[peak]), float(times[peak])


def _first_beyond(times: Array, distance: Array, tolerance: float, k: int) -> float:
    """Time at which the distance passes the tolerance, on the line between samples k - 1 and k."""
    if k == 0:
        return float(times[0])
    share = (tolerance - distance[k - 1]) / (distance[k] - distance[k - 1])
    return float(times[k - 1] + share * (times[k] - times[k - 1]))


def _belongs(event: Event, chosen: Sequence[str], horizon: float, everything: bool) -> bool:
    return event.time <= horizon and (everything or any(p in chosen for p in event.participants))


def _end(rollout: Rollout) -> float:
    """Return the time to which both motion and contacts are known [s]."""
    times, until = rollout.trajectory.times, rollout.contacts_until
    end = float(times[-1]) if len(times) else 0.0
    return end if until is None else min(end, until)
