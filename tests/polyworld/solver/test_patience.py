"""Rollouts that would take too long are refused with what makes them slow; those that do end with what they have."""

import math

import numpy as np
import pytest

from polyworld.core.interruption import Interrupted
from polyworld.solver.core import patience
from polyworld.solver.core.patience import TooLong, in_words
from polyworld.solver.rollout import predicted_cost, rollout, simulator
from polyworld.world import Environment, TimeBase, World
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Sphere
from tests.polyworld.solver.test_interruption import AtTheStart


def rod(**given: float) -> World:
    rope = Rope(name="cable", points=((0.0, 0.0, 1.0), (1.2, 0.0, 1.0)), segments=40, **given)
    hook = Attachment(name="hook", object="cable", end="start")
    return World(deformables=(rope,), attachments=(hook,), time=TimeBase(seconds_per_frame=0.004))


def test_a_slow_rollout_is_refused_with_the_part_that_forces_the_small_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "TRIAL", 0.0)
    with pytest.raises(TooLong, match=r"predicted to take .* more than the limit of 0.0001 s \(patience\)") as refusal:
        rollout(rod(bending_stiffness=0.5), 1.0, patience=1e-4)
    # sqrt(16 EI / (rho l^4)) = 1.4e4 rad/s: 0.6 of 2 / omega, and four times that with half the segments.
    assert "Rope 'cable': bending of its 0.03 m segments needs 8.5e-05 s" in str(refusal.value)
    assert "with 20 segments instead of 40 0.00034 s" in str(refusal.value)


def test_a_rollout_that_outlasts_its_limit_ends_with_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "TRIAL", math.inf)
    cut, whole = rollout(rod(), 0.02, patience=1e-9), rollout(rod(), 0.02)
    assert (cut.status, whole.status) == ("truncated", "completed")
    assert cut.truncated is not None
    assert "ran for its limit" in cut.truncated.reason
    kept = len(cut.trajectory.times)
    assert 1 <= kept < len(whole.trajectory.times)
    assert np.array_equal(cut.trajectory.positions, whole.trajectory.positions[:kept])


def test_rigid_objects_are_stopped_at_the_limit() -> None:
    ball = RigidObject(name="ball", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.0))
    world = World(objects=(ball,), environment=Environment(gravity=(0.0, 0.0, 0.0)))
    with pytest.raises(TooLong, match="stopped after its limit"):
        rollout(world, 2000.0, patience=1e-3)
    assert rollout(world, 0.1).status == "completed"


def test_the_predicted_cost_states_steps_and_the_slow_part() -> None:
    cost = predicted_cost(rod(bending_stiffness=0.5), 0.1)
    assert cost.substeps == 50
    assert cost.seconds > 0.0
    assert "41 nodes take 32 inner steps" in cost.cause
    assert "s for 50 substeps" in str(cost)


def test_a_liquid_is_interrupted_within_a_step_and_runs_again_as_if_nothing_had_been() -> None:
    box = {"shape": {"kind": "box", "half_extents": [0.1, 0.5, 0.1]}, "position": [0, 0, 0.1]}
    world = World.model_validate(
        {
            "deformables": [{"name": "water", "representation": "fluid_planar", "volumes": [box]}],
            "fluid_grid": {"lower": [-0.2, -0.5, 0], "upper": [0.2, 0.5, 0.4], "cell": 0.05},
            "environment": {"motion_plane": {"normal": [0, -1, 0], "supports": False}},
        }
    )
    used, new = (simulator(world, np.array([0.0, 0.01])) for _ in range(2))
    with AtTheStart().active(), pytest.raises(Interrupted):
        used.run()
    again = used.run().deformables["water"].points
    assert np.array_equal(again, new.run().deformables["water"].points)
    assert np.ptp(again[0, :, :, 2], axis=0).max() > 0.0


def test_spans_of_time_are_said_in_their_unit() -> None:
    assert [in_words(s) for s in (0.25, 42.0, 300.0, 9000.0, 4e5)] == ["0.25 s", "42 s", "5 min", "2.5 h", "4.6 days"]
