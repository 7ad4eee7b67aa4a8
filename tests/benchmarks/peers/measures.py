"""What is right and wrong about motion: energy, momentum, penetration, and the exact motion of a chain."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from tests.benchmarks.peers.scenes import BALL, GRAVITY, ROD, THIN, Array, Body, Motion, Scene


def inertia(body: Body) -> Array:
    """Principal moments (3,) of a body of 1 kg [kg m^2]."""
    if body.kind == "sphere":
        return np.full(3, 0.4 * body.size[0] ** 2)
    if body.kind == "cylinder":
        across = body.size[0] ** 2 / 4 + body.size[1] ** 2 / 3
        return np.array([across, across, body.size[0] ** 2 / 2])
    x, y, z = np.square(body.size)
    return np.array([y + z, x + z, x + y]) / 3


def energy(scene: Scene, motion: Motion) -> Array:
    """Kinetic and potential energy (T,) of all bodies [J]."""
    moments = np.array([inertia(body) for body in scene.bodies])
    own = np.einsum("tnji,tnj->tni", motion.rotations, motion.spins)
    kinetic = 0.5 * (motion.velocities**2).sum((1, 2)) + 0.5 * (moments * own**2).sum((1, 2))
    total: Array = kinetic - (motion.positions @ np.array(scene.gravity)).sum(1)
    return total


def energy_gain(scene: Scene, motion: Motion) -> float:
    """Largest rise of the energy above its least value so far, over the energy at the start above rest [1]; exact 0.

    Energy that a penalty contact stores is counted as a rise when it comes back.
    """
    values = energy(scene, motion)
    lowest = np.minimum.accumulate(values)
    rest = -(np.array(scene.gravity) @ np.array([0.0, 0.0, BALL])) * len(scene.bodies)
    return float((values - lowest).max() / (values[0] - rest))


def penetration(scene: Scene, motion: Motion) -> float:
    """Deepest overlap of balls with each other, with floor and with walls at any sample, over their radius [1]."""
    deepest = 0.0
    i, j = np.triu_indices(len(scene.bodies), 1)
    for x in motion.positions:
        if len(i):
            deepest = max(deepest, float((2 * BALL - np.linalg.norm(x[i] - x[j], axis=1)).max()))
        deepest = max(deepest, float((BALL - x[:, 2]).max()))
        if scene.walls is not None:
            deepest = max(deepest, float((np.abs(x[:, :2]) + BALL - scene.walls).max()))
    return deepest / BALL


def sunk(scene: Scene, motion: Motion) -> float:
    """Deepest overlap of balls with the terrain at any sample, along its normal nearly, over their radius [1]."""
    assert scene.terrain is not None
    balls = [k for k, body in enumerate(scene.bodies) if body.kind == "sphere"]
    x = motion.positions[:, balls]
    near = np.full(x.shape[:2], np.inf)
    # The nearest point of the mesh lies within a radius: a fan of points under the ball finds it to some percent.
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        for reach in (0.0, 0.3, 0.6, 0.9):
            foot = x[..., :2] + reach * BALL * np.array([np.cos(angle), np.sin(angle)])
            height = x[..., 2] - scene.terrain.height(foot)
            near = np.minimum(near, np.where(height < 0, height, np.hypot(height, reach * BALL)))
    return float((BALL - near).max() / BALL)


def momentum_drift(motion: Motion) -> float:
    """Largest change of the total momentum over the sum of |m v| at the start [1]; exact 0 without outer forces."""
    total = motion.velocities.sum(axis=1)
    return float(np.abs(total - total[0]).max() / np.linalg.norm(motion.velocities[0], axis=1).sum())


def chain_angles(count: int, angle: float, times: Array) -> Array:
    """Angles (T, n) from the vertical of a chain of rods let go from rest, by Lagrange's equations [rad].

    With a_i = n - 1 - i + 1/2 rod lengths of mass below the middle of rod i: M_ij = a_max(i, j) cos(t_i - t_j) l^2,
    M_ii = n - 1 - i times l^2 plus the moment of rod i about its end. DOP853 at 1e-10.
    """
    below = count - 1 - np.arange(count) + 0.5
    most = np.minimum(below[:, None], below[None, :]) * ROD**2
    own = ((ROD / 2) ** 2 + THIN**2) / 3 + (ROD / 2) ** 2 + (count - 1 - np.arange(count)) * ROD**2

    def rate(_: float, y: Array) -> Array:
        turn, speed = y[:count], y[count:]
        difference = turn[:, None] - turn[None, :]
        mass = most * np.cos(difference)
        np.fill_diagonal(mass, own)
        coupling = most * np.sin(difference)
        np.fill_diagonal(coupling, 0.0)
        force = -coupling @ speed**2 - GRAVITY * ROD * below * np.sin(turn)
        return np.concatenate([speed, np.linalg.solve(mass, force)])

    start = np.concatenate([np.full(count, angle), np.zeros(count)])
    out = solve_ivp(rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-10, atol=1e-10)
    angles: Array = out.y[:count].T
    return angles


def chain_error(scene: Scene, motion: Motion, angle: float) -> float:
    """Largest distance of the last rod's middle from where it should be, over the chain's length [1]."""
    angles = chain_angles(len(scene.bodies), angle, motion.times)
    weights = np.full(len(scene.bodies), ROD)
    weights[-1] = ROD / 2
    exact = np.stack([np.sin(angles) @ weights, -np.cos(angles) @ weights], axis=-1)
    apart = np.linalg.norm(motion.positions[:, -1][:, [0, 2]] - exact, axis=-1)
    return float(apart.max() / (ROD * len(scene.bodies)))


def chain_drift(scene: Scene, motion: Motion) -> float:
    """Largest change of a chain's energy over the energy that it can lose at the start [1]."""
    values = energy(scene, motion)
    count = len(scene.bodies)
    hanging = -GRAVITY * ROD * sum(k + 0.5 for k in range(count))
    return float(np.abs(values - values[0]).max() / (values[0] - hanging))
