"""Designs of the hidden ball's experiments: how the launches begin, at which instants they are seen."""

# ruff: noqa: ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.first_generator.closed_form import base_positions
from tests.scenes.ball import Ball, Launch

Array = NDArray[np.float64]

GRAVITY = 9.81
RESTITUTION = 0.8
FITTED_RUNS = 8
HELD_OUT_RUNS = 2
DURATION = 1.6


@dataclass(frozen=True)
class BallDesign:
    """Launches of one ball: the first `fitted` are given, the rest held out. stamps (T,): from each run's start [s]."""

    name: str
    ball: Ball
    launches: tuple[Launch, ...]
    fitted: int
    stamps: Array

    def base_paths(self) -> Array:
        """Positions (runs, T, 3) in the base world."""
        return np.array([self.base_path(launch) for launch in self.launches])

    def base_path(self, launch: Launch) -> Array:
        """Positions (T, 3) of one launch in the base world."""
        return base_positions(launch, self.stamps, **self.base_values)

    @property
    def base_values(self) -> dict[str, float]:
        """Base parameters for the closed forms."""
        return {
            "radius": self.ball.radius,
            "friction": self.ball.friction,
            "restitution": RESTITUTION,
            "gravity": GRAVITY,
        }

    @property
    def path_scale(self) -> float:
        """Standard deviation of a coordinate [m]: over instants, axes and runs, about the mean of each run."""
        paths = self.base_paths()
        return float(np.sqrt(np.mean((paths - paths.mean(axis=1, keepdims=True)) ** 2)))


def bouncing(rng: np.random.Generator, *, runs: int = FITTED_RUNS, rate: float = 120.0) -> BallDesign:
    """Launches through the air: 0.5 to 8 m/s, all headings, 0.3 to 2.5 m high, spins to 30 rad/s, meeting mid-way."""
    launches = []
    for k in range(runs + HELD_OUT_RUNS):
        speed = float(rng.uniform(0.5, 8.0)) if k else float(rng.uniform(5.0, 8.0))
        heading = 2.0 * np.pi * (k + rng.uniform(0.0, 1.0)) / (runs + HELD_OUT_RUNS) * 3.0
        rise = float(rng.uniform(-0.4, 0.9))
        launches.append(_through_the_middle(rng, speed, heading, rise, float(rng.uniform(0.3, 2.5))))
    return _design("bouncing", rng, launches, runs, rate, friction=0.15)


def _through_the_middle(rng: np.random.Generator, speed: float, heading: float, rise: float, height: float) -> Launch:
    flat = speed * np.cos(rise) * np.array([np.cos(heading), np.sin(heading)])
    start = -flat * DURATION * rng.uniform(0.3, 0.7) + rng.normal(0.0, 0.3, 2)
    spin = rng.normal(size=3)
    spin *= rng.uniform(0.0, 30.0) / np.linalg.norm(spin)
    return Launch((start[0], start[1], height), (flat[0], flat[1], speed * np.sin(rise)), tuple(spin))


def sliding(rng: np.random.Generator, *, runs: int = FITTED_RUNS, rate: float = 120.0) -> BallDesign:
    """As `floor`, but two of eight launches go through the air: they separate forces of the floor from the air's."""
    on_floor = floor(rng, runs=runs, rate=rate)
    launches = list(on_floor.launches)
    for k in range(3, len(launches), 4):
        vx, vy, _ = launches[k].velocity
        heading, rise = float(np.arctan2(vy, vx)), float(rng.uniform(0.0, 0.9))
        launches[k] = _through_the_middle(rng, float(np.hypot(vx, vy)), heading, rise, 1.0)
    return _design("sliding", rng, launches, runs, rate, friction=0.12)


def floor(rng: np.random.Generator, *, runs: int = FITTED_RUNS, rate: float = 120.0) -> BallDesign:
    """Launches along the floor: 1 to 4 m/s with backspin, so that the ball slides long before it rolls."""
    launches = []
    for k in range(runs + HELD_OUT_RUNS):
        heading = 2.0 * np.pi * (k + rng.uniform(0.0, 1.0)) / (runs + HELD_OUT_RUNS) * 3.0
        along = np.array([np.cos(heading), np.sin(heading), 0.0])
        speed = float(rng.uniform(1.0, 4.0))
        start = -along * speed * rng.uniform(0.3, 0.7) + np.array([*rng.normal(0.0, 0.25, 2), 0.0])
        back = -float(rng.uniform(0.0, 40.0)) * np.array([-along[1], along[0], 0.0])
        spin = back + np.array([0.0, 0.0, rng.uniform(-10.0, 10.0)])
        launches.append(Launch((start[0], start[1], 0.1), tuple(speed * along), tuple(spin)))
    return _design("floor", rng, launches, runs, rate, friction=0.12)


def outward(rng: np.random.Generator, *, runs: int = FITTED_RUNS, rate: float = 120.0) -> BallDesign:
    """Launches through the air from one place into all directions, 1 to 5 m/s."""
    launches = []
    for k in range(runs + HELD_OUT_RUNS):
        speed, rise = float(rng.uniform(1.0, 5.0)), float(rng.uniform(-0.4, 0.9))
        heading = 2.0 * np.pi * (k + rng.uniform(0.0, 1.0)) / (runs + HELD_OUT_RUNS) * 3.0
        made = _through_the_middle(rng, speed, heading, rise, float(rng.uniform(0.3, 2.0)))
        start = (*rng.normal(0.0, 0.2, 2), made.position[2])
        launches.append(Launch(start, made.velocity, made.spin))
    return _design("outward", rng, launches, runs, rate, friction=0.15)


def drops(rng: np.random.Generator, *, runs: int = FITTED_RUNS, rate: float = 120.0) -> BallDesign:
    """Drops from rest, without spin, from 0.5 to 2.5 m."""
    launches = [
        Launch((*rng.normal(0.0, 0.5, 2), rng.uniform(0.5, 2.5)), (0.0, 0.0, 0.0)) for _ in range(runs + HELD_OUT_RUNS)
    ]
    return _design("drops", rng, launches, runs, rate, friction=0.15)


def one_speed(rng: np.random.Generator, *, runs: int = FITTED_RUNS, rate: float = 120.0) -> BallDesign:
    """Return one throw, repeated: the same speed, heading, height and spin within a few per cent."""
    speed, heading = float(rng.uniform(2.0, 6.0)), float(rng.uniform(-np.pi, np.pi))
    rise, height = float(rng.uniform(0.0, 0.6)), float(rng.uniform(0.5, 2.0))
    spin = rng.normal(size=3) * 8.0
    launches = []
    for _ in range(runs + HELD_OUT_RUNS):
        made = _through_the_middle(rng, speed * rng.uniform(0.98, 1.02), heading + rng.normal(0.0, 0.02), rise, height)
        launches.append(Launch(made.position, made.velocity, tuple(spin)))
    return _design("one_speed", rng, launches, runs, rate, friction=0.15)


def _design(
    name: str, rng: np.random.Generator, launches: list[Launch], runs: int, rate: float, *, friction: float
) -> BallDesign:
    floats = tuple(
        Launch(
            tuple(float(v) for v in launch.position),
            tuple(float(v) for v in launch.velocity),
            tuple(float(v) for v in launch.spin),
        )
        for launch in launches
    )
    ball = Ball(mass=round(float(rng.uniform(0.3, 0.8)), 2), friction=friction, restitution=lambda speed: RESTITUTION)
    stamps = np.arange(round(DURATION * rate) + 1) / rate
    return BallDesign(name, ball, floats, runs, stamps)


DESIGNS = {
    "bouncing": bouncing,
    "sliding": sliding,
    "floor": floor,
    "outward": outward,
    "drops": drops,
    "one_speed": one_speed,
}
