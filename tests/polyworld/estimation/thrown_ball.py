"""A thrown ball with quadratic drag that bounces on a floor, integrated by SciPy; and the world that describes it."""

import numpy as np
from scipy.integrate import solve_ivp

from polyworld.world import World

G = 9.81
RADIUS = 0.1
MASS = 0.5
DRAG = 0.03  # kg/m


def thrown(rng, drag, sigma, count=96, rate=120.0):
    """Simulate a ball thrown at a floor without friction, restitution 0.8: times (T,), noisy positions (T, 3)."""
    azimuth, speed = rng.uniform(0, 2 * np.pi), rng.uniform(2, 5)
    state = np.array([0, 0, rng.uniform(0.5, 1.5), speed * np.cos(azimuth), speed * np.sin(azimuth), rng.uniform(0, 2)])
    times = np.arange(count) / rate
    places = np.empty((count, 3))

    def slope(_, y):
        return np.concatenate([y[3:], [0, 0, -G] - drag / MASS * np.linalg.norm(y[3:]) * y[3:]])

    def landing(_, y):
        return y[2] - RADIUS

    landing.terminal, landing.direction = True, -1
    at, done = 0.0, 0
    while done < count:
        piece = solve_ivp(
            slope, (at, times[-1] + 1e-9), state, events=landing, rtol=1e-10, atol=1e-12, dense_output=True
        )
        rows = np.arange(done, np.searchsorted(times, piece.t[-1] + 1e-12))
        places[rows] = piece.sol(times[rows])[:3].T
        done = rows[-1] + 1 if len(rows) else done
        at, state = piece.t[-1], piece.y[:, -1].copy()
        state[5] *= -0.8
    return times, places + rng.normal(0, sigma, places.shape)


def ball_world(**changes):
    """Describe that ball and its floor, without drag."""
    ball = {
        "name": "ball",
        "shape": {"kind": "sphere", "radius": RADIUS},
        "position": [0, 0, 1],
        "mass": MASS,
        "restitution": 0.8,
        "friction": 0.0,
    }
    return World.model_validate(
        {
            "objects": [ball],
            "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
            "time": {"substep": 0.004},
            **changes,
        }
    )
