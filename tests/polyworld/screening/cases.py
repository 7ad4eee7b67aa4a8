"""Measured motion for tests of the screening, made with NumPy alone: bouncing balls, discs on a table, a pendulum.

Laws are plain functions of time, place and velocity; nothing here knows the engine. SI units, z up.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.screening import Finding
from polyworld.world import Environment, MotionPlane, StaticObject, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Cylinder, Plane, Sphere

Array = NDArray[np.float64]
Law = Callable[[float, Array, Array], Array]  # (t, places (n, 3), velocities (n, 3)) -> accelerations beside gravity

G = 9.81
RADIUS = 0.05
SUBSTEP = 1.0 / 4800.0
HEADINGS = np.arange(8) * (2.0 * np.pi / 8.0)
# Eight launches: place and velocity.
LAUNCHES = tuple(
    (
        (0.2 * np.cos(a), 0.3 * np.sin(a), 0.3 + 0.12 * k),
        ((1.0 + 0.3 * k) * np.cos(a), (1.0 + 0.3 * k) * np.sin(a), 3.0 - 0.4 * k),
    )
    for k, a in enumerate(HEADINGS)
)


def run(name: str, times: Array, places: Array, names: Sequence[str] = ("ball",)) -> Run:
    """A run of positions (T, 3) or (T, n, 3) without orientations."""
    places = places if places.ndim == 3 else places[:, None]
    return Run(name, tuple(names), times, places, np.full((*places.shape[:2], 4), np.nan))


def numbers(finding: Finding) -> list[float]:
    """Return the numbers in the message of a finding."""
    return [float(n) for n in re.findall(r"(?<![\w-])\d+(?:\.\d+)?(?:e-?\d+)?", finding.message)]


def recorded(times: Array, paths: Array, noise: float = 1e-3, seed: int = 0) -> Recording:
    """Paths (R, T, 3) of one ball with white noise [m], a run `run_K` each."""
    noisy = paths + noise * np.random.default_rng(seed).standard_normal(paths.shape)
    return Recording(tuple(run(f"run_{k}", times, path) for k, path in enumerate(noisy)))


def ball_world(*, floor: float | None = 0.0, radius: float = RADIUS) -> World:
    """A ball over a floor at a height [m]; without one where that is None."""
    ball = RigidObject(name="ball", shape=Sphere(radius=radius), mass=0.1, position=(0.0, 0.0, 1.0))
    statics = () if floor is None else (StaticObject(name="floor", shape=Plane(), position=(0.0, 0.0, floor)),)
    return World(objects=(ball,), statics=statics)


def sampling(rate: float = 120.0, seconds: float = 1.6) -> Array:
    return np.arange(int(rate * seconds)) / rate


def bounces(
    times: Array,
    launches: Sequence[tuple[Sequence[float], Sequence[float]]] = LAUNCHES,
    law: Law | None = None,
    *,
    restitution: float = 0.8,
    floor: bool = True,
    gravity: float = G,
) -> Array:
    """Paths (R, T, 3) of balls that fall, fly and bounce on a floor at z = 0 without friction."""
    x = np.array([place for place, _ in launches], dtype=float)
    v = np.array([velocity for _, velocity in launches], dtype=float)
    out = np.empty((len(times), *x.shape))
    t = 0.0
    for k, until in enumerate(times):
        steps = round((until - t) / SUBSTEP)
        for _ in range(steps):
            a = np.zeros_like(v) if law is None else law(t, x, v)
            a[:, 2] -= gravity
            x += v * SUBSTEP + 0.5 * a * SUBSTEP**2
            v += a * SUBSTEP
            if floor:
                hit = (x[:, 2] < RADIUS) & (v[:, 2] < 0.0)
                v[hit, 2] *= -restitution
                x[hit, 2] = RADIUS
            t += SUBSTEP
        t = until
        out[k] = x
    return np.swapaxes(out, 0, 1)


def drag(rate: float) -> Law:
    """Quadratic drag: deceleration `rate` |v| v [1/m]."""
    return lambda _t, _x, v: -rate * np.linalg.norm(v, axis=1, keepdims=True) * v


def wind(rate: float, speed: float) -> Law:
    """Drag in air that moves along x."""
    return lambda _t, _x, v: drag(rate)(0.0, v, v - np.array([speed, 0.0, 0.0]))


def lift(spin: Sequence[float]) -> Law:
    """Magnus lift: acceleration spin x v [1/s]."""
    return lambda _t, _x, v: np.cross(np.asarray(spin, dtype=float), v)


def spring(rate: float, centre: Sequence[float] = (0.0, 0.0, 0.5)) -> Law:
    """A spring to a point: acceleration -rate (x - centre) [1/s^2]."""
    return lambda _t, x, _v: -rate * (x - np.asarray(centre))


def altered(recording: Recording, change: Callable[[Run], Run]) -> Recording:
    """The recording with every run changed."""
    return Recording(tuple(change(r) for r in recording.runs))


def scaled(recording: Recording, *, space: float = 1.0, time: float = 1.0) -> Recording:
    """The recording in units 1/space m and 1/time s."""
    return altered(recording, lambda r: replace(r, positions=r.positions * space, times=r.times * time))


def relabelled(recording: Recording, axes: Sequence[int], signs: Sequence[float] = (1.0, 1.0, 1.0)) -> Recording:
    """The recording with new axis k = sign k times old axis `axes[k]`."""
    return altered(recording, lambda r: replace(r, positions=r.positions[..., list(axes)] * np.asarray(signs)))


def colliding_discs(times: Array, count: int = 6, noise: float = 5e-4) -> tuple[World, Recording]:
    """Two discs of radius 0.05 m that meet on a table without friction, in `count` runs."""
    rng = np.random.default_rng(5)
    runs = []
    for k in range(count):
        x = np.array([[-0.4, 0.02 * k - 0.05], [0.3, 0.0]])
        v = np.array([[1.2 + 0.1 * k, 0.05 * k], [-0.3, 0.1]])
        places = np.empty((len(times), 2, 3))
        t = 0.0
        for row, until in enumerate(times):
            while t < until - 1e-12:
                x, t = x + v * SUBSTEP, t + SUBSTEP
                n = x[1] - x[0]
                closing = (v[1] - v[0]) @ n
                if n @ n < (2 * RADIUS) ** 2 and closing < 0.0:
                    push = 0.95 * closing * n / (n @ n)
                    v = v + np.stack([push, -push])
            places[row] = np.concatenate([x, np.full((2, 1), RADIUS)], axis=1)
        places[..., :2] += noise * rng.standard_normal((*places.shape[:2], 2))
        runs.append(run(f"run_{k}", times, places, ("red", "blue")))
    discs = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=Cylinder(radius=RADIUS, half_height=0.01),
            mass=0.1,
            friction=0.0,
            position=(x, 0.0, RADIUS),
        )
        for name, x in (("red", -0.4), ("blue", 0.3))
    )
    return World(objects=discs), Recording(tuple(runs))


def swinging(times: Array, amplitude: float = 0.5, length: float = 1.0, noise: float = 0.0) -> tuple[World, Recording]:
    """A small swing in the plane x, z about the origin (linear, with the frequency of a mathematical pendulum)."""
    angle = amplitude * np.cos(np.sqrt(G / length) * times) * np.exp(-0.05 * times)
    path = length * np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=1)
    path = path + noise * np.random.default_rng(3).standard_normal(path.shape)
    bob = RigidObject(name="ball", shape=Sphere(radius=RADIUS), mass=1.0, position=(0.0, 0.0, -length))
    hinge = Hinge(name="hinge", object="ball", anchor=(0.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0))
    return World(objects=(bob,), joints=(hinge,)), Recording((run("swing", times, path),))


def table_world() -> World:
    """A puck on a table seen from above, as a planar world."""
    puck = RigidObject(
        name="ball",
        representation="rigid_planar",
        shape=Cylinder(radius=RADIUS, half_height=0.01),
        mass=0.1,
        friction=0.2,
        position=(0.0, 0.0, 0.0),
    )
    return World(objects=(puck,), environment=Environment(motion_plane=MotionPlane()))
