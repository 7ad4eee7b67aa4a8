"""Worlds of a batch, of every solver: each moves as it would alone, to the bit, and a run leaves nothing behind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from tests.polyworld.solver.fluid.scenes import plane_world, pool
from tests.polyworld.solver.test_rollout_planar import crowd
from tests.scenes.six_bodies import six_body_world
from tests.verification import rope_world
from tests.verification.test_contact_effects import ball, bouncing, law
from tests.verification.test_joint_parameters import wheel
from tests.verification.test_planar_joints import double_pendulum
from tests.verification.test_spatial_joints import two_rods
from tests.verification.test_static_parameters import SHAPES, flight

FLOOR = {"name": "floor", "shape": {"kind": "plane"}}
FIELDS = ("times", "positions", "orientations", "velocities", "angular_velocities")
Made = tuple[World, dict[str, Any], float]


def rope() -> World:
    """A load on a rope that swings."""
    cord = rope_world.rope([[0, 0, 0], [0.7, 0, 0]], 12, linear_density=0.05, stretch_damping=0.002)
    load = rope_world.ball("load", [0.7, 0, 0], 0.5)
    return rope_world.world(
        cord, objects=[load], attachments=[rope_world.held("start"), rope_world.held("end", "load")]
    )


def cloth() -> World:
    """A flag in the wind."""
    sheet = {"kind": "sheet", "corner": (0, 0, 0), "edge_u": (0.6, 0, 0), "edge_v": (0, 0.4, 0), "divisions": (6, 4)}
    flag = {"name": "flag", "representation": "cloth", "geometry": sheet, "bending_stiffness": 1e-4}
    pole = {"name": "pole", "object": "flag", "nodes": [0, 4]}
    parts = {"deformables": [flag], "attachments": [pole], "environment": {"wind": (1.0, 0.5, 0.0)}}
    return World.model_validate(parts)


def soft() -> World:
    """A soft ball that is thrown on a floor."""
    shape, place = {"kind": "sphere", "radius": 0.1}, {"position": (0.0, 0.0, 0.12), "velocity": (0, 0, -3)}
    jelly = {
        "name": "ball",
        "representation": "soft",
        "shape": shape,
        "youngs_modulus": 5e4,
        "resolution": 0.07,
        **place,
    }
    return World.model_validate({"deformables": [jelly], "statics": [FLOOR]})


def fluid() -> World:
    """A column of water that breaks down beside oil."""
    oil = pool("oil", (0.3, 0), (0.6, 0.1), density=800.0)
    return plane_world(pool("water", (0, 0), (0.2, 0.3)), oil, size=(0.6, 0.5), cell=0.03)


# World, values of its three variants, and how long it runs [s].
CASES: dict[str, Callable[[], Made]] = {
    "planar": lambda: (crowd(), {"objects.o0.velocity.x": [-2.0, 0.5, 2.0], "objects.o1.restitution": [0.0, 0.5, 1.0],
                                 "effects.air.coefficient": [0.0, 0.5, 1.0],
                                 "time.seconds_per_frame": [0.02, 0.04, 0.06]}, 2.0),
    "spatial": lambda: (six_body_world(planar=False), {"objects.cube_a.friction": [0.1, 0.3, 0.6],
                                                       "objects.ball_a.velocity.y": [1.0, 2.0, 3.0]}, 2.0),
    "planar joints": lambda: (double_pendulum(0.8, 0.4), {"environment.gravity.z": [-9.81, -5.0, -1.62],
                                                          "objects.upper.mass": [2.0, 1.0, 3.0]}, 1.0),
    "spatial joints": lambda: (two_rods(1.2, 2.0, 0.002), {"objects.upper.mass": [1.0, 2.0, 3.0],
                                                           "objects.lower.velocity.y": [0.0, 0.3, 0.0]}, 0.5),
    "motors": lambda: (wheel(limit=0.04), {"joints.axle.motor.delay": [0.0, 0.2, 0.4]}, 0.6),
    "statics": lambda: (flight(SHAPES["wall"], "rigid_spatial"), {"statics.wall.rotation.z": [-0.3, 0.0, 0.3]}, 1.0),
    "contact laws": lambda: (bouncing(ball(velocity=(2.0, 0.0, 0.0), friction=0.2), effects=(law("spin_coupling"),)),
                             {"effects.law.restitution": [-0.8, 0.1, 0.8]}, 0.6),
    "rope": lambda: (rope(), {"objects.rope.linear_density": [0.02, 0.05, 0.5], "objects.load.mass": [5.0, 0.5, 0.1],
                              "objects.rope.bending_stiffness": [1e-3, 0.0, 1e-2]}, 0.4),
    "cloth": lambda: (cloth(), {"objects.flag.stretch_stiffness": [100.0, 500.0, 3000.0],
                                "objects.flag.stretch_damping": [0.0, 0.01, 0.2]}, 0.2),
    "soft": lambda: (soft(), {"objects.ball.youngs_modulus": [3e4, 1e5, 5e4], "objects.ball.damping": [0.0, 0.02, 0.0],
                              "objects.ball.yield_stress": [1e12, 3e3, 1e3]}, 0.05),
    "fluid": lambda: (fluid(), {"objects.water.density": [1000.0, 1400.0, 1000.0],
                                "objects.water.viscosity": [0.001, 5.0, 0.1],
                                "objects.water.surface_tension": [0.0, 2.0, 0.0]}, 0.2),
}  # fmt: skip


def outcome(found: BatchTrajectory, w: int) -> list[bytes]:
    """All numbers of one world of a batch."""
    rows = [getattr(found, name)[w].tobytes() for name in FIELDS]
    for motion in found.deformables.values():
        rows += [motion.points[w].tobytes(), motion.velocities[w].tobytes()]
    return [*rows, repr(found.events[w]).encode()]


@pytest.mark.parametrize("case", CASES)
def test_a_world_moves_alike_alone_and_anywhere_in_a_batch_for_any_number_of_threads(case: str) -> None:
    world, values, end = CASES[case]()
    given = {path: np.array(v) for path, v in values.items()}
    times = np.linspace(0.0, end, 6)
    together = simulator(world, times, n_worlds=3, record_events=True, threads=2).run(given)
    machine = simulator(world, times, n_worlds=3, record_events=True, threads=1)
    machine.run()  # of which nothing is left
    back = machine.run({path: v[::-1] for path, v in given.items()})
    for w in range(3):
        alone = simulator(world, times, record_events=True).run({path: v[w : w + 1] for path, v in given.items()})
        assert outcome(together, w) == outcome(alone, 0) == outcome(back, 2 - w)
    assert outcome(together, 0) != outcome(together, 1) != outcome(together, 2)
