"""Bodies on a floor or in the air, with tracks from closed formulas or SciPy's integrator and white noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.initial_states import with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.world import StaticObject, TimeBase, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane, Sphere

Array = NDArray[np.float64]

GRAVITY = 9.81
FRAME = 0.04  # [s]
RADIUS = 0.1  # [m]
FLOOR = StaticObject(name="floor", shape=Plane(), friction=None, restitution=None)


def ball(name: str = "ball", **fields: Any) -> RigidObject:
    """A ball on the floor at the origin."""
    return RigidObject(name=name, **{"shape": Sphere(radius=RADIUS), "position": (0.0, 0.0, RADIUS), **fields})


def box(name: str = "box", **fields: Any) -> RigidObject:
    """A cube on the floor at the origin."""
    shape = Box(half_extents=(RADIUS, RADIUS, RADIUS))
    return RigidObject(name=name, **{"shape": shape, "position": (0.0, 0.0, RADIUS), **fields})


def scene(
    objects: Sequence[RigidObject], tracks: ObservedTracks, *, statics: Sequence[StaticObject] = (FLOOR,), **fields: Any
) -> World:
    """A spatial world of objects that begin as their tracks do."""
    time = TimeBase(seconds_per_frame=tracks.seconds_per_frame, frame_count=len(tracks.frames))
    world = World(objects=tuple(objects), statics=tuple(statics), time=time, **fields)
    return with_initial_states(world, tracks)


def tracks_of(
    places: Mapping[str, Array],
    *,
    sigma: float = 0.002,
    orientations: Mapping[str, Array] | None = None,
    turn_sigma: float = 0.02,
    frame: float = FRAME,
    seed: int = 0,
) -> ObservedTracks:
    """Tracks of true places (T, 3) [m] with white noise; orientations (T, 4) of some, with noise [rad]."""
    rng = np.random.default_rng(seed)
    names, count = tuple(places), len(next(iter(places.values())))
    positions = np.stack([places[name] for name in names], axis=1)
    turned = np.full((count, len(names), 4), np.nan)
    for name, own in (orientations or {}).items():
        noise = geometry.rotation_quaternion(rng.normal(0.0, turn_sigma, (count, 3)))
        turned[:, names.index(name)] = geometry.quaternion_product(noise, own)
    return ObservedTracks(
        names=names,
        frames=np.arange(count),
        seconds_per_frame=frame,
        positions=positions + rng.normal(0.0, sigma, positions.shape),
        position_sigma=np.full((count, len(names)), sigma),
        orientations=turned,
        confidence=np.ones((count, len(names))),
        orientation_confidence=np.isfinite(turned).all(axis=2).astype(float),
        symmetry=(1,) * len(names),
    )


def upright(count: int) -> Array:
    """Orientations (T, 4) of a body that does not turn."""
    return np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))


def frames(count: int, step: float = FRAME) -> Array:
    """Times (T,) [s] of frames."""
    return np.arange(count) * step


def slowed(times: Array, speed: float, deceleration: float) -> Array:
    """Places (T, 3) along x of a body at RADIUS over the floor, slowed evenly until it rests."""
    t = np.minimum(times, speed / deceleration)
    way = speed * t - 0.5 * deceleration * t**2
    return np.stack([way, np.zeros_like(way), np.full_like(way, RADIUS)], axis=1)


def rolling_deceleration(lever: float) -> float:
    """Deceleration [m/s^2] of a solid ball by a rolling-resistance moment M = b N: 5/7 g b / R.

    From m dv/dt = -F and 2/5 m R^2 domega/dt = F R - M with v = omega R.
    """
    return 5.0 / 7.0 * GRAVITY * lever / RADIUS


def thrown(times: Array, velocity: Sequence[float], viscous: float, quadratic: float, height: float = 2.0) -> Array:
    """Places (T, 3) of a body in the air by SciPy: dv/dt = g - c v - k |v| v, from (0, 0, height)."""

    def rates(_: float, state: Array) -> Array:
        v = state[3:]
        resistance = -(viscous + quadratic * np.linalg.norm(v)) * v
        return np.concatenate([v, resistance + np.array([0.0, 0.0, -GRAVITY])])

    start = np.array([0.0, 0.0, height, *velocity])
    solved = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-12)
    found: Array = solved.y[:3].T
    return found
