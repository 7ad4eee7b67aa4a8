"""Events read off a trajectory: entry into and exit from the view, and coming to rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import Event, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

REST_SPEED = 0.01  # [m/s]
REST_SPIN = 0.05  # [rad/s]
REST_TIME = 0.2  # [s] an object must stay slow for


def all_events(world: World, trajectory: Trajectory, contacts: tuple[Event, ...]) -> tuple[Event, ...]:
    """Contact, entry, exit and rest events in order of time."""
    found = [*contacts, *view_events(world, trajectory), *rest_events(trajectory)]
    return tuple(sorted(found, key=lambda e: (e.time, e.kind, e.participants)))


def in_view(world: World, positions: Array) -> Bools | None:
    """Whether points (..., 3) are in the camera's image, else in the world's region; None without either."""
    if world.camera is not None:
        return world.camera.sees(positions)
    if world.region is not None:
        inside: Bools = np.all((positions >= world.region.lower) & (positions <= world.region.upper), axis=-1)
        return inside
    return None


def view_events(world: World, trajectory: Trajectory) -> list[Event]:
    """Entries and exits of object centres; the time between two samples is found on the straight line.

    An object that is in view at the first sample has no entry; one that joins in view enters when it joins.
    """
    inside = in_view(world, trajectory.positions)
    if inside is None:
        return []
    events: list[Event] = []
    for i, name in enumerate(trajectory.names):
        seen = inside[:, i] & trajectory.active[:, i]
        for k in np.flatnonzero(seen[1:] != seen[:-1]):
            if trajectory.active[k, i]:
                time, spot = _crossing(world, trajectory, i, int(k))
            else:  # it joined in view: that is its entry
                time, spot = world.object(name).start_time, np.asarray(world.object(name).position)
            events.append(Event("entry" if seen[k + 1] else "exit", time, (name,), _point(spot)))
    return events


def rest_events(trajectory: Trajectory) -> list[Event]:
    """Ends of motion: slow from there for REST_TIME or to the end of the trajectory, after having moved.

    The time is that of the first slow sample.
    """
    events: list[Event] = []
    times = trajectory.times
    for i, name in enumerate(trajectory.names):
        slow = np.linalg.norm(trajectory.velocities[:, i], axis=-1) < REST_SPEED
        slow &= np.linalg.norm(trajectory.angular_velocities[:, i], axis=-1) < REST_SPIN
        active = trajectory.active[:, i]
        for k in np.flatnonzero(slow[1:] & ~slow[:-1] & active[:-1]) + 1:
            moving = np.flatnonzero(~slow[k:])
            until = times[-1] if len(moving) == 0 else times[k + moving[0]]
            if len(moving) == 0 or until - times[k] >= REST_TIME:
                events.append(Event("rest", float(times[k]), (name,), _point(trajectory.positions[k, i])))
    return events


def _crossing(world: World, trajectory: Trajectory, i: int, k: int) -> tuple[float, Array]:
    """Time and place between samples k and k + 1 at which object i passes the edge of the view."""
    a, b = trajectory.positions[k, i], trajectory.positions[k + 1, i]
    first = in_view(world, a[None])
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        now = in_view(world, (a + middle * (b - a))[None])
        if now is not None and first is not None and bool(now[0]) == bool(first[0]):
            low = middle
        else:
            high = middle
    time = trajectory.times[k] + high * (trajectory.times[k + 1] - trajectory.times[k])
    return float(time), a + high * (b - a)


def _point(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
