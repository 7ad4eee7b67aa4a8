"""The base world of the hidden ball in closed form, and what of a hidden effect is left when launches are refitted.

Parabolas between bounces; on the floor uniform deceleration until the ball rolls, then uniform motion. Used to say how
large a hidden effect is (an effect that other initial states imitate is small) and to check the integrator.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tests.scenes.ball import RESTING, UP, Launch

Array = NDArray[np.float64]


def base_positions(
    launch: Launch, times: Array, *, radius: float, friction: float, restitution: float, gravity: float
) -> Array:
    """Positions (T, 3) of a homogeneous ball on the floor z = 0; times from the launch on."""
    x, v, w = (np.array(p, dtype=np.float64) for p in (launch.position, launch.velocity, launch.spin))
    out = np.empty((len(times), 3))
    done, t, end = 0, float(times[0]), float(times[-1])
    down = -gravity * UP
    while True:
        height = x[2] - radius
        if abs(height) < 1e-12 and v[2] < RESTING:
            out[done:] = _on_floor(x, v, w, times[done:] - t, radius=radius, push=friction * gravity)
            return out
        fall = (v[2] + np.sqrt(max(v[2] ** 2 + 2.0 * gravity * height, 0.0))) / gravity
        here = times[done:][times[done:] < t + fall] - t
        out[done : done + len(here)] = x + here[:, None] * v + 0.5 * here[:, None] ** 2 * down
        done += len(here)
        t += fall
        if done == len(times) or t >= end:
            rest = times[done:] - t + fall
            out[done:] = x + rest[:, None] * v + 0.5 * rest[:, None] ** 2 * down
            return out
        x = x + fall * v + 0.5 * fall**2 * down
        v = v + fall * down
        x[2] = radius
        slip = np.array([v[0] - radius * w[1], v[1] + radius * w[0]])
        speed = float(np.linalg.norm(slip))
        if speed > 0.0:
            lost = min(2.0 / 7.0 * speed, friction * (1.0 + restitution) * -v[2]) / speed * slip
            v[:2] -= lost
            w[:2] += 2.5 / radius * np.array([-lost[1], lost[0]])
        v[2] = -restitution * v[2]


def _on_floor(x: Array, v: Array, w: Array, times: Array, *, radius: float, push: float) -> Array:
    """Sliding with deceleration `push` until the touching point stands still, then rolling."""
    slip = np.array([v[0] - radius * w[1], v[1] + radius * w[0]])
    speed = float(np.linalg.norm(slip))
    along = slip / speed if speed > 0.0 else np.zeros(2)
    slides = 2.0 / 7.0 * speed / push if push > 0.0 else np.inf
    a = np.minimum(times, slides)[:, None]
    b = np.maximum(times - slides, 0.0)[:, None]
    rolled = v[:2] - push * along * min(slides, 1e9)
    flat = x[:2] + a * v[:2] - 0.5 * push * a**2 * along + b * rolled
    return np.column_stack([flat, np.full(len(times), radius)])


def left_after_refit(
    observed: Array, launch: Launch, times: Array, *, radius: float, friction: float, restitution: float, gravity: float
) -> float:
    """Mean square per coordinate [m^2] between a motion (T, 3) and the nearest motion of the base world.

    Position and velocity of the launch are fitted (along the floor alone where it starts on it); the spin is known.
    """
    on_floor = abs(launch.position[2] - radius) < 1e-12 and abs(launch.velocity[2]) < 1e-12
    free = [0, 1, 3, 4] if on_floor else [0, 1, 2, 3, 4, 5]
    state = np.array([*launch.position, *launch.velocity])

    def residual(values: Array) -> Array:
        full = state.copy()
        full[free] = values
        full[2] = max(full[2], radius)
        started = Launch(tuple(full[:3]), tuple(full[3:]), launch.spin)
        path = base_positions(
            started, times, radius=radius, friction=friction, restitution=restitution, gravity=gravity
        )
        return (path - observed).ravel()

    begin = state[free]
    best = least_squares(residual, begin, method="lm", max_nfev=12 * len(free))
    return float(np.mean(best.fun**2))
