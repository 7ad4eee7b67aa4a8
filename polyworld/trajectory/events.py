"""Events read off a trajectory: entry into and exit from the view, and coming to rest.

A deformable object is in view while at least half of its points are, and rests while their root mean square speed is
low: its centre alone would miss a pendulum of rope, or a spreading fluid.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import Event, Trajectory
from polyworld.world import World, geometry
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

REST_SPEED = 0.01  # [m/s]
REST_SPIN = 0.05  # [rad/s]
REST_TIME = 0.2  # [s] an object must stay slow for


def all_events(world: World, trajectory: Trajectory, contacts: tuple[Event, ...]) -> tuple[Event, ...]:
    """Contact, entry, exit and rest events in order of time."""
    found = [*contacts, *view_events(world, trajectory), *rest_events(world, trajectory)]
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
        shares = None
        if name in trajectory.deformables:
            shares = share_in_view(world, trajectory.deformables[name].points)
            seen = (shares >= 0.5) & trajectory.active[:, i]
        for k in np.flatnonzero(seen[1:] != seen[:-1]):
            if not trajectory.active[k, i]:  # it joined in view: that is its entry
                time, spot = _joining(world, trajectory, i, int(k) + 1)
            elif shares is not None:
                time, spot = _passing(trajectory, shares, i, int(k))
            else:
                time, spot = _crossing(world, trajectory, i, int(k))
            events.append(Event("entry" if seen[k + 1] else "exit", time, (name,), _point(spot)))
    return events


def rest_events(world: World, trajectory: Trajectory) -> list[Event]:
    """Ends of motion: slow from there for REST_TIME or to the end of the trajectory, after having moved.

    The time is that of the first slow sample.
    """
    events: list[Event] = []
    times = trajectory.times
    for i, name in enumerate(trajectory.names):
        if name in trajectory.deformables:
            slow = point_speed(trajectory.deformables[name].velocities) < REST_SPEED
        else:
            slow = np.linalg.norm(trajectory.velocities[:, i], axis=-1) < REST_SPEED
            slow &= turning(world, trajectory, name) < REST_SPIN
        active = trajectory.active[:, i]
        for k in np.flatnonzero(slow[1:] & ~slow[:-1] & active[:-1]) + 1:
            moving = np.flatnonzero(~slow[k:])
            until = times[-1] if len(moving) == 0 else times[k + moving[0]]
            if len(moving) == 0 or until - times[k] >= REST_TIME:
                events.append(Event("rest", float(times[k]), (name,), _point(trajectory.positions[k, i])))
    return events


def turning(world: World, trajectory: Trajectory, name: str) -> Array:
    """Return how fast a rigid body turns (T,) [rad/s], of a ball on a floor without its spin about the vertical.

    A ball touches the floor in a point, so that this spin lasts and leaves its place as it is.
    """
    spin: Array = trajectory.angular_velocities[:, trajectory.index(name)]
    environment = world.environment
    if isinstance(world.object(name).shape, Sphere):
        lying = world.planar and environment.motion_plane.supports
        up = geometry.plane_axes(environment.motion_plane)[2] if lying else np.asarray(environment.gravity)
        up = up / max(float(np.linalg.norm(up)), 1e-12)
        spin = spin - (spin @ up)[:, None] * up
    turned: Array = np.linalg.norm(spin, axis=-1)
    return turned


def share_in_view(world: World, points: Array) -> Array:
    """Share (T,) of the points (T, k, 3) that are there which are in view; 0 where none is there."""
    known = np.isfinite(points).all(axis=-1)
    seen = in_view(world, points)
    assert seen is not None  # asked only of worlds with a view
    share: Array = (seen & known).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1)
    return share


def point_speed(velocities: Array) -> Array:
    """Root mean square speed (T,) of the points that are there, from velocities (T, k, 3); 0 where none is."""
    squares = (velocities**2).sum(axis=-1)
    known = np.isfinite(squares)
    count = np.maximum(known.sum(axis=-1), 1)
    speed: Array = np.sqrt(np.where(known, squares, 0.0).sum(axis=-1) / count)
    return speed


def _joining(world: World, trajectory: Trajectory, i: int, k: int) -> tuple[float, Array]:
    item: Any = world.item(trajectory.names[i])
    if world.is_rigid(item.name):
        return item.start_time, np.asarray(item.position)
    return float(getattr(item, "start_time", trajectory.times[k])), trajectory.positions[k, i]


def _passing(trajectory: Trajectory, shares: Array, i: int, k: int) -> tuple[float, Array]:
    """Time and place of a deformable object's centre between samples k and k + 1 at which half of it is in view."""
    part = (0.5 - shares[k]) / (shares[k + 1] - shares[k])
    time = trajectory.times[k] + part * (trajectory.times[k + 1] - trajectory.times[k])
    ends = trajectory.positions[k : k + 2, i]
    spot = (1.0 - part) * ends[0] + part * ends[1]
    # A fluid's first drops have no centre before them.
    return float(time), spot if np.isfinite(spot).all() else ends[np.isfinite(ends).all(axis=1)][0]


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
