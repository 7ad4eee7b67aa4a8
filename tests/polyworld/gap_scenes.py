"""Measured motion for tests, made by SciPy alone: a ball that flies and bounces, a puck that slides, a pendulum.

Laws are given as plain functions; nothing here knows the engine's laws. Worlds that describe the scenes without what is
hidden come along. SI units, z up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.world import World

Array = NDArray[np.float64]
Acceleration = Callable[[float, Array, Array, Array], Array]  # (t, x, v, omega), besides gravity

G = 9.81
RADIUS, MASS, RESTITUTION = 0.1, 0.5, 0.8
DOWN = np.array([0.0, 0.0, -G])


def nothing(_t: float, _x: Array, _v: Array, _omega: Array) -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Launch:
    """How a run begins."""

    place: Array
    velocity: Array
    spin: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Bouncing:
    """A ball over frictionless planes (unit normal, offset): what moves it, and how it rebounds.

    after: (normal speed of approach, velocity along the plane) -> (normal speed after, velocity along the plane after).
    """

    acceleration: Acceleration = nothing
    after: Callable[[float, Array], tuple[float, Array]] = lambda speed, along: (RESTITUTION * speed, along)
    planes: Sequence[tuple[Array, float]] = ((np.array([0.0, 0.0, 1.0]), 0.0),)
    gravity: Array = field(default_factory=lambda: DOWN)

    def places(self, launch: Launch, times: Array) -> Array:
        """Positions (T, 3) of the centre at times (T,) from the launch on."""
        events = []
        for normal, offset in self.planes:

            def gap(t: float, y: Array, n: Array = normal, d: float = offset) -> float:  # noqa: ARG001
                return float(n @ y[:3] - d - RADIUS)

            gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
            events.append(gap)
        y = np.concatenate([launch.place, launch.velocity])
        out = np.empty((len(times), 3))
        t, done = 0.0, 0
        while done < len(times):
            piece = solve_ivp(
                lambda t, y: np.concatenate([y[3:], self.gravity + self.acceleration(t, y[:3], y[3:], launch.spin)]),
                (t, times[-1] + 1e-9),
                y,
                events=events,
                rtol=1e-9,
                atol=1e-11,
                max_step=0.05,
                dense_output=True,
            )
            rows = np.arange(done, np.searchsorted(times, piece.t[-1] + 1e-12))
            if len(rows):
                out[rows] = piece.sol(times[rows])[:3].T
                done = int(rows[-1]) + 1
            t, y = float(piece.t[-1]), piece.y[:, -1].copy()
            for normal, offset in self.planes:
                gap_now, speed = float(normal @ y[:3]) - offset - RADIUS, -float(normal @ y[3:])
                if gap_now < 1e-9 and speed > 0.0:
                    along = y[3:] + speed * normal
                    rebound, along = self.after(speed, along)
                    y[3:] = along + rebound * normal
                    y[:3] -= (gap_now - 1e-12) * normal
        return out


def launches(rng: np.random.Generator, count: int = 8) -> list[Launch]:
    """Throws of 0.5 to 6 m/s in all directions from 0.4 to 2.5 m above the floor, that cross about one place."""
    made = []
    for _ in range(count):
        speed, azimuth, rise = rng.uniform(0.5, 6.0), rng.uniform(0, 2 * np.pi), rng.uniform(-0.3, 0.9)
        flat = speed * np.cos(rise) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        place = np.array([0.0, 0.0, rng.uniform(0.4, 2.5)]) - 0.8 * flat + np.array([*rng.normal(0, 0.2, 2), 0.0])
        made.append(Launch(place, flat + np.array([0.0, 0.0, speed * np.sin(rise)]), rng.normal(0, 10, 3)))
    return made


def ball_recording(
    ball: Bouncing,
    begins: Sequence[Launch],
    rng: np.random.Generator,
    sigma: float = 0.001,
    *,
    duration: float = 1.6,
    rate: float = 120.0,
    orientations: bool = False,
) -> Recording:
    """One run a launch with white noise [m]; with orientations, those of an unchanging spin with 0.01 rad of noise."""
    times = np.arange(round(duration * rate)) / rate
    runs = []
    for k, launch in enumerate(begins):
        places = ball.places(launch, times)
        turned = np.full((len(times), 1, 4), np.nan)
        if orientations:
            rate_of = float(np.linalg.norm(launch.spin))
            half = (rate_of * times + rng.normal(0, 0.01, len(times))) / 2
            axis = launch.spin / max(rate_of, 1e-12)
            turned[:, 0] = np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None] * axis], axis=1)
        noisy = places + rng.normal(0, sigma, places.shape)
        runs.append(Run(f"run{k}", ("ball",), times, noisy[:, None], turned))
    return Recording(tuple(runs))


def ball_world(**changes: Any) -> World:
    """The ball over its floor, without friction; `changes` replace fields of the ball."""
    ball = {
        "name": "ball",
        "shape": {"kind": "sphere", "radius": RADIUS},
        "position": [0, 0, 1],
        "mass": MASS,
        "restitution": RESTITUTION,
        "friction": 0.0,
    }
    return World.model_validate(
        {
            "objects": [ball | changes],
            "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
            "time": {"substep": 0.004},
        }
    )


def puck_recording(
    deceleration: Callable[[Array, float], float],
    rng: np.random.Generator,
    sigma: float = 0.0005,
    *,
    runs: int = 6,
    duration: float = 1.5,
    rate: float = 100.0,
) -> Recording:
    """A disc pushed over a table, x and y measured: deceleration (place (2,), speed) [m/s^2] against the motion."""
    times = np.arange(round(duration * rate)) / rate
    made = []
    for k in range(runs):
        speed, azimuth = rng.uniform(0.8, 3.0), rng.uniform(0, 2 * np.pi)
        heading = np.array([np.cos(azimuth), np.sin(azimuth)])
        begin = -heading * 0.6 * speed + rng.normal(0, 0.05, 2)

        def slope(t: float, y: Array, b: Array = begin, h: Array = heading) -> Array:  # noqa: ARG001
            return np.array([y[1], -deceleration(b + h * y[0], y[1]) if y[1] > 0.0 else 0.0])

        def stop(t: float, y: Array) -> float:  # noqa: ARG001
            return float(y[1])

        stop.terminal, stop.direction = True, -1  # type: ignore[attr-defined]
        path = solve_ivp(
            slope, (0, times[-1]), (0.0, speed), events=stop, rtol=1e-9, atol=1e-11, max_step=0.01, dense_output=True
        )
        along = path.sol(np.minimum(times, path.t[-1]))[0]
        places = np.concatenate([begin + along[:, None] * heading, np.zeros((len(times), 1))], axis=1)
        places[:, :2] += rng.normal(0, sigma, (len(times), 2))
        made.append(Run(f"run{k}", ("puck",), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    return Recording(tuple(made))


def puck_world(friction: float = 0.1) -> World:
    """The disc on its table, a planar world."""
    return World.model_validate(
        {
            "objects": [
                {
                    "name": "puck",
                    "representation": "rigid_planar",
                    "shape": {"kind": "cylinder", "radius": 0.05, "half_height": 0.02},
                    "position": [0, 0, 0],
                    "mass": 0.2,
                    "friction": friction,
                    "torsional_radius": 0.0,  # the path does not depend on a spin that nobody measured
                }
            ],
            "time": {"substep": 0.004},
        }
    )


LENGTH = 0.8  # of the pendulum [m]
BOB = 0.05


def pendulum_recording(
    torque: Callable[[float], float], rng: np.random.Generator, sigma: float = 0.0005, *, runs: int = 3
) -> Recording:
    """A ball on a light rod, swinging in x and z about the origin: torque (rate) [N m] besides that of gravity."""
    times = np.arange(200) / 50.0
    inertia = MASS * LENGTH**2 + 0.4 * MASS * BOB**2
    made = []
    for k in range(runs):

        def slope(t: float, y: Array) -> Array:  # noqa: ARG001
            return np.array([y[1], (-MASS * G * LENGTH * np.sin(y[0]) + torque(y[1])) / inertia])

        path = solve_ivp(slope, (0, times[-1]), (rng.uniform(0.3, 1.2), 0.0), rtol=1e-9, atol=1e-11, dense_output=True)
        angle = path.sol(times)[0]
        places = LENGTH * np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=1)
        places += rng.normal(0, sigma, places.shape)
        made.append(Run(f"run{k}", ("bob",), times, places[:, None], np.full((len(times), 1, 4), np.nan)))
    return Recording(tuple(made))


def pendulum_world() -> World:
    """The pendulum without friction: a hinge along y at the origin."""
    return World.model_validate(
        {
            "objects": [
                {
                    "name": "bob",
                    "shape": {"kind": "sphere", "radius": BOB},
                    "position": [0, 0, -LENGTH],
                    "mass": MASS,
                }
            ],
            "joints": [{"kind": "hinge", "name": "pivot", "object": "bob", "anchor": [0, 0, 0], "axis": [0, 1, 0]}],
            "time": {"substep": 0.004},
        }
    )
