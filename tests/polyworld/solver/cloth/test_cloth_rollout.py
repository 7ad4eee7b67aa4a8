"""Cloth in whole worlds: batches, repeatability, holding, and how far a damped one is from an undamped one in cost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld import World, rollout, simulator
from polyworld.model import mesh_of


def hanging(**more: Any) -> World:
    return World.model_validate(
        {
            "deformables": [
                {
                    "name": "flag",
                    "representation": "cloth",
                    "geometry": {
                        "kind": "sheet",
                        "corner": (0, 0, 0),
                        "edge_u": (0.6, 0, 0),
                        "edge_v": (0, 0.4, 0),
                        "divisions": (6, 4),
                    },
                    "bending_stiffness": 1e-4,
                    **more,
                }
            ],
            "attachments": [{"name": "pole", "object": "flag", "nodes": [0, 4]}],
            "environment": {"wind": (1.0, 0.5, 0.0)},
        }
    )


def test_open_shear_stiffness_follows_the_stretch_stiffness() -> None:
    """Left open, G t = E t / (2 (1 + nu)) of the world's own values, not of the described ones."""
    times = np.array([0.0, 0.3])
    values = {"objects.flag.stretch_stiffness": np.array([80.0])}
    opened = simulator(hanging(), times).run(values).deformables["flag"].points
    given = simulator(hanging(shear_stiffness=80.0 / 2.6), times).run(values).deformables["flag"].points
    assert np.allclose(opened, given, atol=1e-9)


def test_two_cloths_of_one_world_do_not_touch_each_others_numbers() -> None:
    one = hanging()
    other = one.model_dump()
    second = {**other["deformables"][0], "name": "banner", "stretch_stiffness": 50.0}
    second["geometry"] = {**second["geometry"], "corner": (0, 3.0, 0), "divisions": (3, 5)}
    other["deformables"] = [second, *other["deformables"]]
    alone = rollout(one, 0.3).trajectory.deformables["flag"].points
    both = rollout(World.model_validate(other), 0.3).trajectory.deformables["flag"].points
    # The inner step is the shorter of the two cloths': equal motion, not equal bytes.
    assert np.abs(alone - both).max() < 5e-3


@pytest.mark.parametrize("stiffness", [1e-7, 0.1])
def test_crumpling_cloth_stays_finite(stiffness: float) -> None:
    """A sheet thrown onto its own edge by its corner, undamped, soft and stiff."""
    world = hanging(bending_stiffness=stiffness, velocity=(5.0, 5.0, -20.0), stretch_stiffness=50.0, self_contact=False)
    run = rollout(world, 1.0)
    assert run.status == "completed"
    assert np.isfinite(run.trajectory.deformables["flag"].points).all()
    assert np.abs(run.trajectory.deformables["flag"].points).max() < 3.0


def test_patch_held_to_a_body_turns_with_it() -> None:
    """A strip with its first two rows on a spinning block: the block carries its moment, and momentum is shared.

    Free in space, so that the angular momentum of both together stays.
    """
    world = World.model_validate(
        {
            "objects": [
                {
                    "name": "block",
                    "representation": "rigid_spatial",
                    "shape": {"kind": "box", "half_extents": (0.05, 0.05, 0.05)},
                    "mass": 0.3,
                    "position": (0.0, 0.0, 0.0),
                    "angular_velocity": (0.0, 3.0, 0.0),
                }
            ],
            "deformables": [
                {
                    "name": "strip",
                    "representation": "cloth",
                    "geometry": {
                        "kind": "sheet",
                        "corner": (0.05, -0.05, 0),
                        "edge_u": (0.5, 0, 0),
                        "edge_v": (0, 0.1, 0),
                        "divisions": (10, 2),
                    },
                    "bending_stiffness": 0.01,
                }
            ],
            "attachments": [
                {
                    "name": "seam",
                    "object": "strip",
                    "to": "block",
                    "region": {"lower": (0, -1, -1), "upper": (0.101, 1, 1)},
                }
            ],
            "environment": {"gravity": (0, 0, 0), "air_density": 0.0},
        }
    )
    run = rollout(world, 0.5)
    assert run.status == "completed"
    t = run.trajectory
    points, velocities = t.deformables["strip"].points, t.deformables["strip"].velocities
    mass = mesh_of(world, world.deformables[0]).measure * 0.2
    inertia = 0.3 * 2.0 / 3.0 * 0.05**2  # of a cube
    momentum: np.ndarray = np.cross(points, mass[:, None] * velocities).sum(axis=1)
    momentum += 0.3 * np.cross(t.positions[:, 0], t.velocities[:, 0]) + inertia * t.angular_velocities[:, 0]
    assert np.abs(momentum[1:] - momentum[1]).max() < 1e-9 * np.abs(momentum[1]).max()
    tip = points[-1, -2] - points[-1, 4]
    assert abs(tip[2]) > 0.05  # the strip was swung along
