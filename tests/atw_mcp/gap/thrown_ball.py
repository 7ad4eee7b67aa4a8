"""A ball thrown through air, integrated by SciPy: what the gap tools are given in tests. The truth is known here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

MASS, DRAG, SIGMA = 0.5, 0.03, 1e-3
LAUNCHES = (((3.0, 0.0, 4.0), 1.0), ((-6.0, 2.0, 5.0), 1.2), ((9.0, -3.0, 3.0), 1.5), ((1.0, 5.0, 6.0), 1.0))
EFFECTS = ["linear_drag", "quadratic_drag", "tilt"]


def flown(drag: float = DRAG, launches: Any = LAUNCHES, seed: int = 1) -> list[NDArray[np.float64]]:
    """Rows t, x, y, z [s, m] of every launch, with noise."""
    rng = np.random.default_rng(seed)
    times = np.arange(61) / 60

    def slope(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([y[3:], -drag / MASS * np.linalg.norm(y[3:]) * y[3:] - [0.0, 0.0, 9.81]])

    runs = []
    for velocity, height in launches:
        path = solve_ivp(slope, (0, 1), [0, 0, height, *velocity], t_eval=times, rtol=1e-9, atol=1e-11).y[:3].T
        runs.append(np.column_stack([times, path + rng.normal(scale=SIGMA, size=path.shape)]))
    return runs


def write_table(path: Path, runs: list[NDArray[np.float64]], header: str = "run,object,t,x,y,z") -> Path:
    """The runs r0, r1, ... of an object called ball, as a CSV."""
    rows = [f"r{i},ball," + ",".join(f"{v:.6f}" for v in row) for i, run in enumerate(runs) for row in run]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def world() -> dict[str, Any]:
    """The ball's world as JSON: gravity and nothing else."""
    return {
        "objects": [
            {
                "name": "ball",
                "representation": "rigid_spatial",
                "shape": {"kind": "sphere", "radius": 0.1},
                "mass": MASS,
                "position": [0.0, 0.0, 1.0],
            }
        ],
        "time": {"seconds_per_frame": 1 / 60, "frame_count": 61},
    }
