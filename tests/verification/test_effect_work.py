"""The work of every law of the catalogue is at most the bound that its file states, by which energy is watched."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from polyworld import World, simulator
from polyworld.effects import CATALOGUE
from polyworld.effects.law import Course
from polyworld.solver.core.effect_evaluation import Bodies, accelerations_of
from polyworld.solver.energy_watch import watch

MASS, RADIUS, STATES = 0.7, 0.1, 400
TIMES = np.linspace(0.0, 0.8, 41)


def drawn(kind: str, rng: np.random.Generator) -> dict[str, float]:
    """Return parameters of a law from the ranges that fits search."""
    return {
        n: float(rng.uniform(max(q.search[0], q.lower), q.search[1])) for n, q in CATALOGUE[kind].parameters.items()
    }


def bounces(kind: str, parameters: dict[str, float]) -> World:
    """Return a spinning ball that is thrown at a floor, under a law."""
    ball = {
        "name": "ball",
        "representation": "rigid_spatial",
        "shape": {"kind": "sphere", "radius": RADIUS},
        "mass": MASS,
        "position": (0.0, 0.0, 0.5),
        "velocity": (1.0, 0.5, 0.0),
        "angular_velocity": (0.0, 20.0, 3.0),
        "restitution": 0.8,
        "friction": 0.4,
    }
    law = {"name": "law", "kind": kind, "parameters": parameters}
    return World.model_validate(
        {"objects": [ball], "statics": [{"name": "floor", "shape": {"kind": "plane"}}]} | {"effects": [law]}
    )


@pytest.mark.parametrize("kind", CATALOGUE)
def test_no_force_has_more_power_than_its_bound(kind: str) -> None:
    law, rng = CATALOGUE[kind], np.random.default_rng(3)
    assert law.work is not None, "a driving law leaves its worlds unwatched: say so here where there is one"
    if law.force is None:
        pytest.skip("it acts in impacts alone")
    for _ in range(10):
        parameters = drawn(kind, rng)
        x, v, w = (scale * rng.normal(size=(STATES, 3)) for scale in (1.0, 3.0, 20.0))
        bodies = Bodies(
            mass=np.full(STATES, MASS),
            radius=np.full(STATES, RADIUS),
            positions=x,
            velocities=v,
            spins=w,
            times=rng.uniform(0.0, 10.0, STATES),
            contact=np.ones(STATES),
        )
        power = MASS * np.einsum("ij,ij->i", accelerations_of(bounces(kind, parameters), bodies)[0], v)
        for k in range(STATES):
            speed = float(np.linalg.norm(v[k]))
            course = Course(
                mass=MASS,
                gravity=9.81,
                path=np.array([speed]),  # in a second at this speed
                reach=float(np.linalg.norm(x[k])),
                speed=speed * max(1.0, 2.0 / parameters.get("duration", 2.0)),  # of a pulse, the peak of its force
                spin=float(np.linalg.norm(w[k])),
            )
            assert power[k] <= law.work(parameters, course)[0] + 1e-9 * (1.0 + abs(power[k]))


@pytest.mark.parametrize("kind", CATALOGUE)
def test_energy_is_watched_under_every_law_and_no_law_is_taken_for_a_divergence(kind: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(3):
        scene = bounces(kind, drawn(kind, rng))
        batch = simulator(scene, TIMES).run()
        assert watch(batch, [scene])[1] == (None,)
        velocities: Any = batch.velocities.copy()
        velocities[:, 30:] *= 1e9  # beyond the bound of any law of the catalogue
        assert watch(replace(batch, velocities=velocities), [scene])[0].diverged[0]
