"""A double pendulum by Lagrange's equations: two balls on rods that turn freely about y, angles from hanging."""

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

UPPER, LOWER, MASS, RADIUS, G = 0.3, 0.25, 0.1, 0.02, 9.81


def angles(start: tuple[float, float, float, float], times: Array, damping: float = 0.0) -> Array:
    """Angles and their rates (4, T), with the balls' own inertia; damping [N m s/rad] of the upper hinge."""
    own = 0.4 * MASS * RADIUS**2

    def rate(_t: float, y: Array) -> Array:
        a, b, da, db = y
        couple = MASS * UPPER * LOWER
        matrix = [
            [2 * MASS * UPPER**2 + own, couple * np.cos(a - b)],
            [couple * np.cos(a - b), MASS * LOWER**2 + own],
        ]
        force = [
            -couple * np.sin(a - b) * db**2 - 2 * MASS * G * UPPER * np.sin(a) - damping * da,
            couple * np.sin(a - b) * da**2 - MASS * G * LOWER * np.sin(b),
        ]
        return np.array([da, db, *np.linalg.solve(matrix, force)])

    found: Array = solve_ivp(rate, (0.0, times[-1]), start, t_eval=times, rtol=1e-10, atol=1e-12).y
    return found
