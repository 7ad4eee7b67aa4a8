"""Soft bodies through `polyworld.solver.rollout`."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld import World, rollout

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
