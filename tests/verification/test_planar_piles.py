"""Piles in a box in an upright plane: they come to rest, carried whole, and gain no energy on the way."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.solver.rollout import simulator
from polyworld.world import StaticObject
from polyworld.world.shapes import Plane, Sphere
from tests.verification.planar_scenes import G, body, side_view

RADIUS = 0.1
COLUMNS = 4


@pytest.mark.parametrize("restitution", [0.0, 0.9])
def test_a_pile_comes_to_rest_and_gains_no_energy(restitution: float) -> None:
    """Sixteen balls dropped in a box of 4.6 diameters: overlaps below 1% of a radius and at rest after 4 s, below 1e-4
    of it then; between samples, energy grows by less than 1e-5 of what there was."""
    draw = np.random.default_rng(0)
    balls = [
        body(
            f"b{i}",
            Sphere(radius=RADIUS),
            (0.23 * (i % COLUMNS - 1.5) + draw.uniform(-0.01, 0.01), 0.0, 0.12 + 0.25 * (i // COLUMNS)),
            friction=0.4,
            restitution=restitution,
        )
        for i in range(16)
    ]
    half = 0.46
    walls = tuple(
        StaticObject(name=name, shape=Plane(normal=(x, 0.0, 0.0), offset=-half), friction=0.4)
        for name, x in (("left", 1.0), ("right", -1.0))
    )
    world = side_view(*balls, friction=0.4)
    world = world.model_copy(update={"statics": world.statics + walls})
    out = simulator(world, np.arange(401) * 0.01, threads=1).run()
    x, v = out.positions[0][..., [0, 2]], out.velocities[0][..., [0, 2]]
    spin = out.angular_velocities[0][..., 1]
    apart = np.linalg.norm(x[:, :, None] - x[:, None], axis=-1) + np.eye(16)
    overlap = np.stack(
        [
            (2 * RADIUS - apart).max(axis=(1, 2)),
            (RADIUS - x[..., 1]).max(axis=1),
            (np.abs(x[..., 0]) - half + RADIUS).max(axis=1),
        ]
    ).max(axis=0)
    assert overlap.max() < 0.01 * RADIUS
    assert overlap[-1] < 1e-4 * RADIUS
    energy = (G * x[..., 1] + 0.5 * (v**2).sum(axis=-1) + 0.2 * (RADIUS * spin) ** 2).sum(axis=1)
    assert np.diff(energy).max() < 1e-5 * energy[0]
    assert np.abs(v[-1]).max() < 1e-6
