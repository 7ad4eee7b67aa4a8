"""Soft bodies through `polyworld.solver.rollout`."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld import World, rollout, simulator

BALL = {
    "name": "ball",
    "representation": "soft",
    "shape": {"kind": "sphere", "radius": 0.1},
    "position": (0.0, 0.0, 1.0),
    "youngs_modulus": 5e4,
}


def world(*items: dict[str, object], **more: object) -> World:
    return World.model_validate({"deformables": items, **more})


def test_ball_falls_freely_and_turns_without_deforming() -> None:
    spinning = {**BALL, "velocity": (1.0, 0.0, 2.0), "angular_velocity": (0.0, 0.0, 2.0)}
    trajectory = rollout(world(spinning), 0.4).trajectory
    t = trajectory.times
    assert trajectory.positions[:, 0, 0] == pytest.approx(t, abs=1e-9)
    assert trajectory.positions[:, 0, 2] == pytest.approx(1.0 + 2.0 * t - 0.5 * 9.81 * t**2, abs=1e-3)
    assert trajectory.angular_velocities[-1, 0] == pytest.approx([0.0, 0.0, 2.0], abs=0.02)
    motion = trajectory.deformables["ball"]
    assert motion.quantities["volume"] == pytest.approx(4 / 3 * np.pi * 1e-3, rel=2e-3)
    assert motion.quantities["strain"].max() < 1e-3


def test_each_world_of_a_batch_moves_as_it_does_alone() -> None:
    """Bit by bit, whatever the others' stiffness, damping and yield stress; worlds differ."""
    start = world({**BALL, "position": (0.0, 0.0, 0.15)}, statics=[{"name": "floor", "shape": {"kind": "plane"}}])
    values = {
        "objects.ball.youngs_modulus": np.array([3e4, 1e5]),
        "objects.ball.damping": np.array([0.0, 0.02]),
        "objects.ball.yield_stress": np.array([1e12, 3e3]),
    }
    times = np.array([0.1, 0.3])
    both = simulator(start, times, n_worlds=2).run(values)
    for w in range(2):
        alone = simulator(start, times).run({k: v[w : w + 1] for k, v in values.items()})
        for name in ("points", "velocities"):
            one, two = (getattr(r.deformables["ball"], name) for r in (alone, both))
            assert one[0].tobytes() == two[w].tobytes()
    assert np.abs(both.positions[0] - both.positions[1]).max() > 1e-3
    plastic = both.deformables["ball"].quantities["plastic_strain"]
    assert plastic[0].max() == 0.0
    assert plastic[1].max() > 0.0


def test_repeated_runs_of_one_simulator_start_afresh() -> None:
    """Plastic strain of the first run is gone in the second; another damping needs other launches."""
    falling = {**BALL, "velocity": (0, 0, -3), "yield_stress": 1e3, "position": (0, 0, 0.12)}
    start = world(falling, statics=[{"name": "floor", "shape": {"kind": "plane"}}])
    start = start.model_copy(
        update={"statics": world(BALL, statics=[{"name": "f", "shape": {"kind": "plane"}}]).statics}
    )
    run = simulator(start, np.array([0.05, 0.1]))
    first = run.run().deformables["ball"].points.tobytes()
    damped = run.run({"objects.ball.damping": np.array([0.05])}).deformables["ball"].points.tobytes()
    again = run.run().deformables["ball"].points.tobytes()
    assert first == again
    assert first != damped


@pytest.mark.parametrize("representation", ["soft", "soft_planar"])
def test_body_settles_on_a_floor_by_its_weight(representation: str) -> None:
    """At rest the middle of a soft ball is lower than its radius; a slice stays in its plane."""
    body = {**BALL, "representation": representation, "position": (0, 0, 0.1), "damping": 0.02, "youngs_modulus": 2e4}
    plane = {"motion_plane": {"normal": (0.0, -1.0, 0.0), "supports": False}}
    floor = {"name": "floor", "shape": {"kind": "plane"}}
    planar = representation == "soft_planar"
    trajectory = rollout(world(body, statics=[floor], environment=plane if planar else {}), 1.0).trajectory
    height = trajectory.positions[:, 0, 2]
    assert 0.08 < height[-1] < 0.095
    assert np.ptp(height[-5:]) < 1e-4
    points = trajectory.deformables["ball"].points
    assert points[-1, :, 2].min() > -1e-3
    assert not planar or np.abs(points[..., 1]).max() < 1e-9
