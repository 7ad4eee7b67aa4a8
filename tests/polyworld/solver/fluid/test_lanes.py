"""Liquids move alike in any number of lanes a world."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.solver.fluid import lanes
from polyworld.solver.rollout import simulator
from polyworld.world import StaticObject, World
from polyworld.world.representations.fluid import Emitter
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.polyworld.solver.fluid.scenes import Run, plane_world, pool

Array = NDArray[np.float64]

CELL = 0.03
DURATION = 0.02
VALUES = {"viscosity": (0.001, 5.0), "surface_tension": (0.0, 2.0)}


def _splash() -> World:
    """A disc falls into water beside a step, under a tap."""
    disc = RigidObject(
        name="disc",
        representation="rigid_planar",
        shape=Sphere(radius=0.06),
        density=700.0,
        position=(0.41, 0.0, 0.19),
        velocity=(0.5, 0.0, -1.0),
    )
    step = StaticObject(name="step", shape=Box(half_extents=(0.1, 0.2, 0.033)), position=(0.1, 0.0, 0.033))
    tap = Emitter(name="tap", fluid="water", position=(0.3, 0.0, 0.4), direction=(0, 0, -1), radius=0.04, rate=0.2)
    water = pool("water", (0.2, 0.0), (0.6, 0.155), velocity=(0.1, 0.0, 0.0))
    return plane_world(water, size=(0.6, 0.5), cell=CELL, objects=(disc,), statics=(step,), emitters=(tap,))


def _roll() -> tuple[Array, Array, Array]:
    """Positions and velocities of water and disc in two worlds, from particles that lie between the cells' faces.

    Where one lies on a face, rounding would decide to which cell it belongs.
    """
    run = Run(_splash(), n_worlds=2)
    run.fluid.write({"water": {name: np.array(pair) for name, pair in VALUES.items()}})
    run.fluid.reset()
    x = run.fluid.records.particles.x.numpy()
    x += 0.02 * CELL * np.random.default_rng(0).uniform(-1.0, 1.0, x.shape) * [1.0, 0.0, 1.0]
    run.run(DURATION)
    return *run.fluid.particles()[:2], run.bodies.numpy()["v"]


def test_motion_does_not_depend_on_the_number_of_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    """To rounding where all have several; to the accuracy of the solvers, 1% of a cell in ten steps, where one has one.

    Lanes of a CPU run one after the other, each number in another order.
    """
    found = []
    for number in (lanes.Lanes(64, 8), lanes.Lanes(8, 2), lanes.Lanes(1, 1)):
        monkeypatch.setattr(lanes, "ON_CPU", number)
        found.append(_roll())
    many, few, one = found
    for ours, theirs in zip(many, few, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(many[0], one[0], rtol=0.0, atol=1e-2 * CELL)


def test_rollouts_in_lanes_are_those_of_one_lane(monkeypatch: pytest.MonkeyPatch) -> None:
    """With bodies and a tap, replayed as graphs: 1% of a cell in ten steps."""
    times = np.array([0.0, DURATION])
    alone = simulator(_splash(), times, threads=1).run()
    monkeypatch.setattr(lanes, "ON_CPU", lanes.Lanes(64, 8))
    many = simulator(_splash(), times, threads=1).run()
    np.testing.assert_allclose(many.positions, alone.positions, rtol=0.0, atol=1e-2 * CELL)
    ours, theirs = many.deformables["water"], alone.deformables["water"]
    np.testing.assert_allclose(ours.points, theirs.points, rtol=0.0, atol=1e-2 * CELL)
