"""Laws that depend on time go by the clock of the run: shaken from another moment on, a body moves otherwise."""

import numpy as np
import pytest

from polyworld.solver.rollout import rollout
from polyworld.world import World

AMPLITUDE, FREQUENCY, PHASE = 1.5, 0.7, 0.4


def shaken(origin, **parts):
    effect = {
        "name": "shaking",
        "kind": "periodic_forcing",
        "parameters": {"amplitude_x": AMPLITUDE, "frequency": FREQUENCY, "phase": PHASE},
    }
    return World.model_validate(
        {
            "effects": [effect],
            "environment": {"gravity": [0, 0, 0]},
            "time": {"origin": origin, "substep": 0.002},
            **parts,
        }
    )


def displaced(origin, time):
    """x(t) from rest for x'' = A sin(2 pi f (t + origin) + phase)."""
    omega = 2 * np.pi * FREQUENCY
    start = omega * origin + PHASE
    return AMPLITUDE / omega**2 * (np.sin(start) + omega * time * np.cos(start) - np.sin(omega * time + start))


BODIES = {
    "space": {"objects": [{"name": "b", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 0]}]},
    "plane": {
        "objects": [
            {
                "name": "b",
                "representation": "rigid_planar",
                "shape": {"kind": "sphere", "radius": 0.1},
                "position": [0, 0, 0],
            }
        ]
    },
    "rope": {
        "deformables": [
            {"name": "b", "representation": "rope", "points": [[-0.1, 0, 0], [0.1, 0, 0]], "linear_density": 1.0}
        ]
    },
}


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("origin", [0.0, 0.9])
def test_a_forcing_acts_at_the_clock_of_the_world(kind, origin):
    path = rollout(shaken(origin, **BODIES[kind]), 1.5, sample_interval=0.1).trajectory
    moved = path.positions[:, 0, 0] - path.positions[0, 0, 0]
    # A node of a rope is moved in first order of its inner step.
    assert moved == pytest.approx(displaced(origin, path.times), abs=2e-3 if kind == "rope" else 2e-5)
