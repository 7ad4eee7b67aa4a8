"""Attachments: what they hold stays held, moves as it is led, and momentum goes where it should."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.world import World
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Sphere
from tests.verification.coupled_world import GRAVITY, VACUUM, WEIGHTLESS, Run, pinned_corners, sheet

BAR = {
    "shape": Box(half_extents=(0.1, 0.025, 0.025)),
    "resolution": 0.05,
    "youngs_modulus": 1e5,
    "poisson_ratio": 0.3,
    "damping": 0.002,
}
RIGHT_END = Region(lower=(0.099, -1, -1), upper=(0.101, 1, 1))


def test_led_boundary_goes_exactly_where_it_is_led_and_drags_the_cloth() -> None:
    n = (4, 4)
    motion = ((0.0, 0.0, 0.0, 0.0), (0.2, 0.1, 0.0, 0.0), (0.4, 0.1, 0.05, 0.0))
    cloth = sheet("cloth", (0, 0, 0), 0.4, 0.4, n, stretch_damping=0.02, linear_damping=1.0)
    pins = tuple(a.model_copy(update={"motion": motion}) for a in pinned_corners("cloth", n))
    run = Run(World(environment=WEIGHTLESS, deformables=(cloth,), attachments=pins), 1.5, samples=16)
    corner = run.points("cloth")[:, 0]
    assert corner[1] == pytest.approx((0.05, 0.0, 0.0), abs=1e-12)
    assert corner[3] == pytest.approx((0.1, 0.025, 0.0), abs=1e-12)
    assert corner[-1] == pytest.approx((0.1, 0.05, 0.0), abs=1e-12)
    assert run.points("cloth")[-1].mean(axis=0) == pytest.approx((0.3, 0.25, 0.0), abs=2e-3)


@pytest.mark.parametrize("mass", [0.005, 5.0])
def test_bar_fastened_to_a_light_or_heavy_body_keeps_momentum_and_stays_on(mass: float) -> None:
    """A hundredth, and ten times, of the bar's mass; the whole spins in space."""
    body = RigidObject(
        name="body", shape=Sphere(radius=0.03), mass=mass, position=(0.14, 0, 0), angular_velocity=(0, 0, 3.0)
    )
    bar = Soft.model_validate({"name": "bar", "position": (0, 0, 0), "velocity": (0, 0.3, 0.1), **BAR})
    hold = Attachment(name="hold", object="bar", region=RIGHT_END, to="body")
    run = Run(World(environment=WEIGHTLESS, objects=(body,), deformables=(bar,), attachments=(hold,)), 1.0)
    momentum = run.momentum()
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * np.abs(momentum[0]).max()
    held = np.abs(run.points("bar")[0, :, 0] - 0.1) < 1e-6
    assert held.sum() > 4
    distance = np.linalg.norm(run.points("bar")[:, held] - run.trajectory.positions[0, :, 0, None], axis=2)
    assert distance == pytest.approx(np.broadcast_to(distance[0], distance.shape), abs=5e-4)


def test_weight_on_a_hanging_bar_stretches_it_by_its_force_over_e_a() -> None:
    """Held by one end, drawn by a body at the other, along x: strain F / E A and the body's own equation of motion."""
    body = RigidObject(name="body", shape=Sphere(radius=0.02), mass=0.2, position=(0.125, 0, 0), linear_damping=15.0)
    bar = Soft.model_validate({**BAR, "name": "bar", "position": (0, 0, 0), "poisson_ratio": 0.0, "density": 100.0})
    world = World(
        environment=VACUUM.model_copy(update={"gravity": (GRAVITY, 0.0, 0.0)}),
        objects=(body,),
        deformables=(bar,),
        attachments=(
            Attachment(name="hold", object="bar", region=RIGHT_END, to="body"),
            Attachment(name="wall", object="bar", region=Region(lower=(-0.101, -1, -1), upper=(-0.099, 1, 1))),
        ),
    )
    run = Run(world, 1.5, samples=4)
    forces = run.shard.attachments.forces()
    assert forces["hold"][0, 0] == pytest.approx(0.2 * GRAVITY, rel=5e-3)
    assert forces["wall"][0, 0] == pytest.approx(-(0.2 + 0.05) * GRAVITY, rel=0.015)
    stretch = run.along("body", (1, 0, 0))[-1] - 0.125
    # E A = 250 N; a strain of 0.8% of a bar of 0.2 m, and half as much from its own weight
    assert stretch == pytest.approx((0.2 + 0.025) * GRAVITY / 250.0 * 0.2, rel=0.03)


def test_cloth_sewn_to_cloth_stays_on_it_and_keeps_momentum() -> None:
    one = sheet("one", (0.0, 0.0, 0.0), 0.3, 0.3, (5, 5), stretch_damping=0.01, velocity=(0.0, 0.0, 0.5))
    two = sheet("two", (0.3, 0.02, 0.0), 0.2, 0.25, (4, 6), stretch_damping=0.01, areal_density=1.0)
    seam = Attachment(name="seam", object="two", region=Region(lower=(0.299, -1, -1), upper=(0.301, 1, 1)), to="one")
    run = Run(World(environment=WEIGHTLESS, deformables=(one, two), attachments=(seam,)), 0.5)
    momentum = run.momentum()
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * np.abs(momentum[0]).max()
    sewn = np.flatnonzero(np.abs(run.points("two")[0, :, 0] - 0.3) < 1e-9)
    border = np.flatnonzero(np.abs(run.points("one")[0, :, 0] - 0.3) < 1e-9)
    line = run.points("one")[:, border]
    where = (run.points("two")[0, sewn, 1] - 0.0) / 0.06
    low = np.minimum(where.astype(int), 4)
    part = (where - low)[:, None]
    on_line = line[:, low] * (1 - part) + line[:, low + 1] * part
    assert np.abs(run.points("two")[:, sewn] - on_line).max() < 1e-3


def test_release_lets_go_at_its_time_and_strength_at_its_force() -> None:
    n = (3, 3)
    cloth = sheet("cloth", (0, 0, 1), 0.3, 0.3, n, linear_damping=0.0)
    every = tuple(range(16))
    timed = Attachment(name="timed", object="cloth", nodes=every, release=0.1)
    run = Run(World(environment=VACUUM, deformables=(cloth,), attachments=(timed,)), 0.5, samples=6)
    height = run.points("cloth")[:, :, 2].mean(axis=1)
    assert height[1] == pytest.approx(1.0, abs=1e-12)
    assert height[-1] == pytest.approx(1.0 - 0.5 * GRAVITY * 0.4**2, abs=0.02)
    assert [(e.kind, e.participants) for e in run.trajectory.events[0]] == [("release", ("cloth",))]
    assert run.trajectory.events[0][0].time == pytest.approx(0.1, abs=1e-6)
    weight = 0.2 * 0.09 * GRAVITY
    for strength, stays in ((1.1 * weight, True), (0.9 * weight, False)):
        held = Attachment(name="held", object="cloth", nodes=every, strength=strength)
        run = Run(World(environment=VACUUM, deformables=(cloth,), attachments=(held,)), 0.2, samples=3)
        assert bool(run.points("cloth")[-1, :, 2].min() > 0.999) is stays


def test_pins_of_a_hanging_rope_carry_its_weight() -> None:
    rope = Rope(name="rope", points=((0, 0, 0), (0.8, 0, 0)), length=1.0, segments=20, linear_damping=3.0)
    pins = (Attachment(name="a", object="rope", end="start"), Attachment(name="b", object="rope", end="end"))
    run = Run(World(environment=VACUUM, deformables=(rope,), attachments=pins), 3.0, samples=4)
    a, b = run.shard.attachments.forces().values()
    assert a[0] + b[0] == pytest.approx((0.0, 0.0, 0.05 * GRAVITY), abs=0.01 * 0.05 * GRAVITY)
    assert a[0, 0] < 0.0 < b[0, 0]  # the rope draws its ends together
