"""Runs whose energy grows out of nothing diverge, with where, when and by how much; what is driven does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from polyworld import World, rollout, simulator
from polyworld.solver.energy_watch import watch
from polyworld.trajectory import BatchTrajectory

TIMES = np.linspace(0.0, 0.5, 11)


def world(*objects: dict[str, Any], **more: Any) -> World:
    """A world of rigid objects, called a, b, ..., in space by default."""
    named = [{"name": "abc"[i], "representation": "rigid_spatial", **o} for i, o in enumerate(objects)]
    return World.model_validate({"objects": named, **more})


def ball(*position: float, **more: Any) -> dict[str, Any]:
    """A sphere of 1 kg."""
    return {"shape": {"kind": "sphere", "radius": 0.1}, "mass": 1.0, "position": position, **more}


def accelerated(batch: BatchTrajectory, factor: float, since: int) -> BatchTrajectory:
    """The same motion with the last object's speed multiplied from a sample on."""
    velocities = batch.velocities.copy()
    velocities[:, since:, -1] *= factor
    return replace(batch, velocities=velocities)


def test_energy_out_of_nothing_is_found_in_the_object_that_has_it_at_the_sample_where_it_appears() -> None:
    scene = world(ball(0, 0, 1), ball(1, 0, 3, velocity=(2.0, 0.0, 0.0)))
    batch = simulator(scene, TIMES).run()
    same, reasons = watch(batch, [scene])
    assert same is batch
    assert reasons == (None,)
    marked, reasons = watch(accelerated(batch, 3.0, 6), [scene])
    assert marked.diverged[0]
    assert marked.diverged_time[0] == TIMES[6]
    assert marked.names[marked.diverged_object[0]] == "b"
    assert len(marked.world(0).times) == 6
    # Half of 1 kg times 8 times the squared speed, at 0.3 s of free fall.
    excess = 0.5 * 8.0 * (2.0**2 + (9.81 * 0.3) ** 2)
    assert f"exceeds by {excess:.3g} J" in str(reasons[0])


@pytest.mark.parametrize("factor", [1.02, 0.5])
def test_errors_of_a_coarse_step_and_losses_are_no_divergence(factor: float) -> None:
    scene = world(ball(0, 0, 1, velocity=(3.0, 0.0, 0.0)))
    batch = accelerated(simulator(scene, TIMES).run(), factor, 5)
    assert not watch(batch, [scene])[0].diverged.any()


DOOR = {"kind": "hinge", "name": "joint", "object": "a", "anchor": (-0.5, 0, 1), "axis": (0, 0, 1)}
SPRING = {"kind": "spring", "name": "joint", "object": "a", "anchor": (0, 0, 1), "other_anchor": (1, 0, 1)}
FLOOR = {"name": "floor", "shape": {"kind": "plane"}}
DRIVEN: dict[str, dict[str, Any]] = {
    "pull with default parameters": {
        "effects": [{"name": "pull", "kind": "central_force", "parameters": {"strength": 50.0, "exponent": 0.0}}]
    },
    "motor": {"joints": [{**DOOR, "motor": {"target_speed": 20.0, "limit": 50.0}}]},
    "effort": {"joints": [{**DOOR, "motor": {"limit": 50.0}}]},
    "stretched spring": {"joints": [{**SPRING, "stiffness": 2000.0, "rest_length": 0.3}]},
    "constant force": {"effects": [{"name": "push", "kind": "uniform_force", "parameters": {"x": 50.0}}]},
    "buoyancy": {
        "effects": [{"name": "lift", "kind": "buoyancy", "parameters": {"density_ratio": 5.0}}],
        "environment": {"gravity": (0.0, 0.0, -9.81)},
    },
    "forcing": {
        "effects": [
            {"name": "shake", "kind": "periodic_forcing", "parameters": {"amplitude_x": 40.0, "frequency": 1.0}}
        ]
    },
}


@pytest.mark.parametrize("name", DRIVEN)
def test_what_is_driven_may_gain_energy(name: str) -> None:
    scene = world(ball(0, 0, 1), **{"environment": {"gravity": (0.0, 0.0, 0.0)}, **DRIVEN[name]})
    found = rollout(scene, 0.5, sample_interval=0.05)
    assert found.status == "completed", found.why_ended()
    speed = np.linalg.norm(found.trajectory.velocities[:, 0], axis=1).max()
    assert speed > 1.5  # [m/s]


def test_overlapping_bodies_are_parted_without_a_divergence() -> None:
    scene = world(ball(0, 0, 0.02), ball(0.05, 0, 0.1), ball(0, 0.05, 0.15), statics=[FLOOR])
    assert rollout(scene, 0.5).status == "completed"
