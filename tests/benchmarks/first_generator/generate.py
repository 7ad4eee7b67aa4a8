"""What a hidden ball's world gives to the solver, and its noisy runs. It imports nothing of the project it examines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.benchmarks.first_generator.cases import Hidden
from tests.benchmarks.first_generator.design import GRAVITY, RESTITUTION
from tests.benchmarks.first_generator.observer import Fault, noisy
from tests.benchmarks.first_generator.strength import flights, hidden_world
from tests.scenes.ball import Path as Motion


def world_json(hidden: Hidden) -> dict[str, Any]:
    """Return the base world, given to the solver. The ball starts as the first launch does, as far as frames show."""
    ball, first = hidden.design.ball, hidden.design.launches[0]
    return {
        "objects": [
            {
                "name": "ball",
                "shape": {"kind": "sphere", "radius": ball.radius},
                "mass": ball.mass,
                "friction": ball.friction,
                "restitution": RESTITUTION,
                "position": [round(v, 2) for v in first.position],
                "velocity": [0.0, 0.0, 0.0],
            }
        ],
        "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
        "environment": {"gravity": [0.0, 0.0, -GRAVITY]},
        "time": {"seconds_per_frame": float(hidden.design.stamps[1]), "substep": 0.002},
    }


def observed_runs(hidden: Hidden, rng: np.random.Generator, runs: Sequence[int]) -> list[tuple[str, Any, Any, Any]]:
    """Noisy runs as the hidden world's observer sees them."""
    ball, fault = hidden_world(hidden.design.ball, hidden.effects)
    motions = flights(hidden.design, ball, fault, runs)
    return [_observed(hidden, f"run{k}", motion, fault, rng) for k, motion in zip(runs, motions, strict=True)]


def _observed(
    hidden: Hidden, name: str, motion: Motion, fault: Fault, rng: np.random.Generator
) -> tuple[str, Any, Any, Any]:
    case = hidden.case
    places, turns = fault.seen(motion.positions[:, None], motion.orientations[:, None])
    sigma = case.noise * hidden.design.path_scale
    seen, turned, keep = noisy(places, turns, rng, sigma=sigma, angle=case.noise, kind=case.kind)
    return name, hidden.design.stamps[keep], seen[keep], turned[keep]
