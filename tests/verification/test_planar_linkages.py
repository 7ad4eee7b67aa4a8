"""Many hinges in one planar world: chains, stars, loops and bodies held twice, solved for together."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, TimeBase, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Cylinder
from tests.verification.planar_scenes import SIDE_VIEW, G, body, run

Array = NDArray[np.float64]

LINK = 0.1  # [m]
BOB = Cylinder(radius=0.01, half_height=0.01)
GYRATION2 = (3 * 0.01**2 + 0.02**2) / 12  # about y over mass [m^2]; the cylinder's axis is upright at the start


def linkage(*objects: RigidObject, joints: tuple[Hinge, ...]) -> World:
    environment = Environment(motion_plane=SIDE_VIEW)
    return World(objects=objects, joints=joints, environment=environment, time=TimeBase(substep=0.002))


def chain(count: int, order: Array, angle: float = 0.5) -> World:
    """Bobs in the middle of massless links; hinges listed in the given order."""
    down = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    bobs = [body(f"b{k}", BOB, tuple((k + 0.5) * LINK * down), mass=1.0) for k in range(count)]
    joints = [
        Hinge(name=f"h{k}", object=f"b{k}", other=f"b{k - 1}" if k else None, anchor=tuple(k * LINK * down))
        for k in range(count)
    ]
    return linkage(*bobs, joints=tuple(joints[k] for k in order))


def energy(motion: BatchTrajectory) -> Array:
    """Energy (T,) of bobs of 1 kg [J]."""
    v, w = motion.velocities[0], motion.angular_velocities[0, :, :, 1]
    kinetic = 0.5 * ((v**2).sum(axis=2) + GYRATION2 * w**2).sum(axis=1)
    total: Array = kinetic + G * motion.positions[0, :, :, 2].sum(axis=1)
    return total


def point(motion: BatchTrajectory, index: int, at: Array) -> Array:
    """World position (T, 2) of the point of a body that was at `at` (x, z) when the run began."""
    x = motion.positions[0][:, index][:, [0, 2]]
    q = motion.orientations[0][:, index]
    angle = 2.0 * np.arctan2(q[:, 2], q[:, 0])
    arm = at - x[0]
    c, s = np.cos(angle), np.sin(angle)
    found: Array = x + np.stack([c * arm[0] + s * arm[1], c * arm[1] - s * arm[0]], axis=1)
    return found


def test_a_chain_of_thirty_links_keeps_its_energy_and_its_joints() -> None:
    """1 s from rest at 0.5 rad: energy to 1e-6 of what it can lose, pivots to 1e-13 m, whatever the hinges' order."""
    count = 30
    motion = run(chain(count, np.arange(count)), 1.0)
    lowest = -G * LINK * sum(k + 0.5 for k in range(count))
    total = energy(motion)
    assert np.abs(total - total[0]).max() < 1e-6 * (total[0] - lowest)
    down = np.array([np.sin(0.5), -np.cos(0.5)])
    for k in range(1, count):
        apart = point(motion, k, k * LINK * down) - point(motion, k - 1, k * LINK * down)
        assert np.abs(apart).max() < 1e-13
    shuffled = run(chain(count, np.random.default_rng(3).permutation(count)), 1.0)
    np.testing.assert_allclose(shuffled.positions, motion.positions, atol=1e-9)


def test_arms_on_one_hub_swing_as_each_would_on_a_fixed_pivot() -> None:
    """Six arms at the point where their hub hinges on the world: as one arm alone to 1e-9 m, until they meet."""
    angles = np.linspace(-1.2, 1.2, 6)
    hub = body("hub", Cylinder(radius=0.02, half_height=0.02), (0.0, 0.0, 0.0), mass=5.0)
    arms = [body(f"a{k}", BOB, (LINK * np.sin(a), 0.0, -LINK * np.cos(a)), mass=1.0) for k, a in enumerate(angles)]
    origin = (0.0, 0.0, 0.0)
    joints = [Hinge(name="post", object="hub", anchor=origin)]
    joints += [Hinge(name=f"h{k}", object=f"a{k}", other="hub", anchor=origin) for k in range(len(angles))]
    together = run(linkage(hub, *arms, joints=tuple(joints)), 0.1)
    alone = run(linkage(arms[1], joints=(Hinge(name="post", object="a1", anchor=origin),)), 0.1)
    np.testing.assert_allclose(together.positions[0, :, 2], alone.positions[0, :, 0], atol=1e-9)
    assert np.abs(together.positions[0, :, 0]).max() < 1e-12


@pytest.mark.parametrize("closed", [False, True])
def test_links_held_more_often_than_they_need_move_as_one(closed: bool) -> None:
    """Two bobs joined by two hinges are one body on its pivot: energy to 4e-4 J, each keeps its place in the other.

    closed: the second hinge's other end is a third bob that is joined to both, a loop that cannot move either.
    """
    bobs = [body(f"b{k}", BOB, (0.1 * (k + 1), 0.0, 0.05 * k * k), mass=1.0) for k in range(2 + closed)]
    spots = [(0.1, 0.0, 0.0), (0.2, 0.0, 0.0), (0.2, 0.0, 0.1), (0.3, 0.0, 0.1), (0.25, 0.0, 0.05)]
    joints = [Hinge(name="pivot", object="b0", anchor=(0.0, 0.0, 0.0))]
    joints += [Hinge(name=f"pair{k}", object="b0", other="b1", anchor=spots[k]) for k in range(2 - closed)]
    if closed:
        joints.append(Hinge(name="second", object="b1", other="b2", anchor=spots[3]))
        joints.append(Hinge(name="third", object="b2", other="b0", anchor=spots[2]))
        joints.append(Hinge(name="fourth", object="b2", other="b0", anchor=spots[4]))
    motion = run(linkage(*bobs, joints=tuple(joints)), 1.0)
    total = energy(motion)
    assert np.ptp(motion.positions[0, :, 0, 2]) > 0.05
    np.testing.assert_allclose(total, total[0], atol=4e-4)
    x = motion.positions[0]
    for k in range(1, len(bobs)):
        start = np.array(bobs[k].position)[[0, 2]]
        apart = x[:, k][:, [0, 2]] - point(motion, 0, start)
        np.testing.assert_allclose(apart, 0.0, atol=1e-11)


def test_a_fast_linkage_with_many_redundant_hinges_keeps_its_energy() -> None:
    """Three bobs on one pivot at 50 rad/s, held in a loop by six hinges where four would do: energy to 1e-4."""
    masses, rate = np.array([1.0, 4.0, 7.0]), 50.0
    spots = [(0.1, 0.0, 0.0), (0.2, 0.0, 0.0), (0.2, 0.0, 0.1), (0.3, 0.0, 0.1)]
    bobs = []
    for k in range(3):
        x, z = 0.1 * (k + 1), 0.05 * k * k
        spun = {"velocity": (rate * z, 0.0, -rate * x), "angular_velocity": (0.0, rate, 0.0)}
        bobs.append(body(f"b{k}", BOB, (x, 0.0, z), mass=float(masses[k]), **spun))
    joints = [Hinge(name="pivot", object="b0", anchor=(0.0, 0.0, 0.0))]
    joints += [Hinge(name=f"p{k}", object="b0", other="b1", anchor=spots[k]) for k in range(3)]
    joints += [Hinge(name=f"q{k}", object="b1", other="b2", anchor=spots[k + 2]) for k in range(2)]
    joints.append(Hinge(name="r", object="b2", other="b0", anchor=spots[0]))
    motion = run(linkage(*bobs, joints=tuple(joints)), 0.5)
    v, w = motion.velocities[0], motion.angular_velocities[0, :, :, 1]
    total = (0.5 * ((v**2).sum(axis=2) + GYRATION2 * w**2) + G * motion.positions[0, :, :, 2]) @ masses
    np.testing.assert_allclose(total, total[0], rtol=1e-4)


def test_a_light_chain_with_a_heavy_end_neither_opens_nor_gains_energy() -> None:
    """Three links of 10 g fall from level with 100 kg at the end, 20 ms a step, 2 s: 1e-12 m, 1e-5 of the energy."""
    links = [(k + 0.5) * LINK for k in range(3)]
    masses = np.array([0.01, 0.01, 100.0])
    bobs = [body(f"b{k}", BOB, (x, 0.0, 0.0), mass=float(masses[k])) for k, x in enumerate(links)]
    joints = [
        Hinge(name=f"h{k}", object=f"b{k}", other=f"b{k - 1}" if k else None, anchor=(k * LINK, 0.0, 0.0))
        for k in range(3)
    ]
    world = linkage(*bobs, joints=tuple(joints))
    motion = run(world.model_copy(update={"time": TimeBase(substep=0.02)}), 2.0, 0.02)
    for k in range(1, 3):
        spot = np.array([k * LINK, 0.0])
        assert np.abs(point(motion, k, spot) - point(motion, k - 1, spot)).max() < 1e-12
    v, w = motion.velocities[0], motion.angular_velocities[0, :, :, 1]
    total = (0.5 * ((v**2).sum(axis=2) + GYRATION2 * w**2) + G * motion.positions[0, :, :, 2]) @ masses
    assert total.max() < total[0] + 1e-5 * G * 100.0 * LINK
