"""The acceleration that an effect is said to give is the one that the motion shows, less that of everything else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from polyworld.probing.effect_accelerations import effect_accelerations, in_contact
from polyworld.solver.core.effect_evaluation import frictions_of
from polyworld.solver.rollout import rollout
from polyworld.trajectory import Event, PointMotion, Rollout, Trajectory
from polyworld.world import World

LAWS: dict[str, dict[str, Any]] = {
    "linear_drag": {"parameters": {"coefficient": 0.4}},
    "wind": {"parameters": {"coefficient": 0.05, "velocity_x": 3.0, "velocity_z": 1.0}},
    "fan": {"parameters": {"force_y": 2.0, "centre_x": 0.5, "width": 0.4}},
    "magnus_lift": {"parameters": {"coefficient": 0.02}},
    "periodic_forcing": {"parameters": {"amplitude_z": 3.0, "frequency": 1.5}},
    "expression": {
        "expression": {"x": "-k*v.x", "z": "q*x.x"},
        "parameters": {"k": 0.8, "q": 2.0},
        "parameter_units": {"k": "1/s", "q": "1/s^2"},
    },
}


def thrown(*effects: dict[str, Any]) -> World:
    bodies = [
        {
            "name": name,
            "shape": {"kind": "sphere", "radius": 0.1},
            "mass": 0.5,
            "position": [0, y, 0],
            "velocity": [1.5, 0.2, 1.0],
            "angular_velocity": [0, 4.0, 2.0],
            "start_time": late,
        }
        for name, y, late in (("ball", 0.0, 0.0), ("other", 3.0, 0.1))
    ]
    time = {"substep": 0.001, "origin": 0.3}
    return World.model_validate({"objects": bodies, "effects": effects, "time": time})


@pytest.mark.parametrize("kind", LAWS)
def test_acceleration_is_what_the_motion_of_a_thrown_ball_shows(kind: str) -> None:
    world = thrown({"name": "e", "kind": kind, "objects": ["ball"], **LAWS[kind]})
    result = rollout(world, 0.4, sample_interval=0.004)
    run = result.trajectory
    (found,) = effect_accelerations(world, result)
    shown = np.gradient(run.velocities[:, 0], run.times, axis=0) - np.array(world.environment.gravity)
    assert np.abs(found[:, 0]).max() > 0.1
    assert_allclose(found[1:-1, 0], shown[1:-1], atol=2e-3 * np.abs(shown).max() + 1e-6)
    assert not found[:, 1].any()  # it acts on the ball alone


def test_disabled_effects_are_left_out_and_objects_that_join_late_are_at_rest_before() -> None:
    world = thrown(
        {"name": "off", "kind": "linear_drag", "parameters": {"coefficient": 1.0}, "enabled": False},
        {"name": "push", "kind": "uniform_force", "parameters": {"x": 2.0}},
    )
    result = rollout(world, 0.2, sample_interval=0.02)
    found = effect_accelerations(world, result)
    assert found.shape == (1, 11, 2, 3)
    active = result.trajectory.active
    assert not active.all()
    assert_allclose(found[0][active][:, 0], 2.0 / 0.5)
    assert not found[0][~active].any()


def test_planar_objects_are_pushed_in_their_plane_alone() -> None:
    world = World.model_validate(
        {
            "objects": [
                {
                    "name": "disc",
                    "representation": "rigid_planar",
                    "shape": {"kind": "cylinder", "radius": 0.1, "half_height": 0.02},
                    "mass": 2.0,
                    "position": [0, 0, 0.02],
                    "velocity": [1.0, 0, 0],
                    "friction": 0.0,
                }
            ],
            "effects": [
                {"name": "tilt", "kind": "uniform_acceleration", "parameters": {"x": 0.5, "z": 3.0}},
                {"name": "film", "kind": "viscous_friction", "parameters": {"coefficient": 0.6}},
            ],
        }
    )
    result = rollout(world, 0.2)
    tilt, film = effect_accelerations(world, result)
    assert_allclose(tilt[:, 0], np.broadcast_to([0.5, 0, 0], tilt[:, 0].shape))
    assert_allclose(film[:, 0], -0.6 / 2.0 * result.trajectory.velocities[:, 0], rtol=1e-9)  # it lies on the plane


def test_a_deformable_object_has_the_mean_over_its_mass() -> None:
    rope = {"name": "rope", "representation": "rope", "points": [(0, 0, 0), (1, 0, 0)], "segments": 4}
    law = {"expression": {"z": "q*x.x"}, "parameters": {"q": 2.0}, "parameter_units": {"q": "1/s^2"}}
    effect = {"name": "e", "kind": "expression", **law}
    world = World.model_validate({"deformables": [rope], "effects": [effect]})
    nodes = np.zeros((1, 5, 3))
    nodes[0, :, 0] = [0.0, 0.25, 0.5, 0.75, 2.0]
    mass = np.array([0.5, 1.0, 1.0, 1.0, 0.5]) / 4.0  # ends stand for half a segment
    still = np.zeros((1, 1, 3))
    run = Trajectory(
        names=("rope",),
        times=np.zeros(1),
        positions=still,
        orientations=np.array([[[1.0, 0, 0, 0]]]),
        velocities=still,
        angular_velocities=still,
        active=np.ones((1, 1), dtype=bool),
        deformables={"rope": PointMotion(nodes, np.zeros_like(nodes))},
    )
    (found,) = effect_accelerations(world, Rollout(world.id, 0.0, run, ()))
    assert_allclose(found[0, 0], [0.0, 0.0, 2.0 * mass @ nodes[0, :, 0]], rtol=1e-12)


def test_a_friction_patch_changes_the_coefficient_within_its_radius() -> None:
    patch = {"name": "wet", "kind": "friction_patch", "parameters": {"x": 1.0, "radius": 0.5, "friction": -0.3}}
    world = thrown(patch, {"name": "push", "kind": "uniform_force", "parameters": {"x": 2.0}})
    places = np.array([[1.2, 0, 0], [1.6, 0, 0]])
    assert_allclose(frictions_of(world, places, 0.5), [[0.2, 0.5], [0.5, 0.5]])
    assert_allclose(frictions_of(world, places, 0.1)[0], [0.0, 0.1])  # no less than none


def test_contact_lasts_from_the_event_that_begins_it_to_the_one_that_ends_it() -> None:
    world = thrown()
    result = rollout(world, 0.2, sample_interval=0.02)
    pair = ("ball", "other")
    events = (Event("contact_begin", 0.05, pair), Event("contact_end", 0.09, pair), Event("contact_begin", 0.15, pair))
    touching = in_contact(world, replace(result, events=events))
    expected = [(0.05 <= t <= 0.09) or t >= 0.15 for t in result.trajectory.times]
    assert touching.tolist() == [[e, e] for e in expected]
