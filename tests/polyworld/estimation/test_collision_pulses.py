"""Pulses that carry what a collision exchanged beyond its law: exact in momentum, and gone with the collision."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.edits.removal import without
from polyworld.solver.rollout import rollout
from polyworld.world import Effect, Environment, MotionPlane, TimeBase, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder

MASS, RADIUS, SIDE = 1.7, 0.1, 0.08
IMPULSE, TURN = np.array([0.9, -0.4, 0.7]), np.array([0.011, 0.02, -0.03])


def pulse(name: str, *objects: str, time: float = 0.2, duration: float = 0.03, planar: bool = False) -> Effect:
    axes = "xy" if planar else "xyz"
    numbers = {f"impulse_{a}": float(IMPULSE["xyz".index(a)]) for a in axes}
    numbers |= {f"turn_{a}": float(TURN["xyz".index(a)]) for a in ("z" if planar else "xyz")}
    return Effect(
        name=name, kind="collision_slack", parameters={**numbers, "time": time, "duration": duration}, objects=objects
    )


def planar(*effects: Effect, substep: float = 0.004, names: tuple[str, ...] = ("puck",)) -> World:
    pucks = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=Cylinder(radius=RADIUS, half_height=0.05),
            mass=MASS,
            position=(float(i), 0.0, 0.05),
            velocity=(0.3, 0.1, 0.0),
            friction=0.0,
        )
        for i, name in enumerate(names)
    )
    time = TimeBase(seconds_per_frame=0.05, substep=substep)
    return World(objects=pucks, environment=Environment(motion_plane=MotionPlane()), time=time, effects=effects)


@pytest.mark.parametrize(("substep", "share"), [(0.001, 1e-6), (0.005, 1e-6), (0.01, 1e-6), (0.0039, 0.005)])
@pytest.mark.parametrize("time", [0.2, 0.2031, 0.2177])
def test_momentum_changes_by_the_impulse_whatever_the_phase_of_the_steps(
    substep: float, share: float, time: float
) -> None:
    """To rounding where steps divide the pulse, into three or more; else to a percent from four on."""
    end = rollout(planar(pulse("slack", "puck", time=time, planar=True), substep=substep), 0.5).trajectory
    gained = MASS * (end.velocities[-1, 0, :2] - [0.3, 0.1])
    assert gained == pytest.approx(IMPULSE[:2], rel=share)
    assert end.angular_velocities[-1, 0, 2] * 0.5 * MASS * RADIUS**2 == pytest.approx(TURN[2], rel=share)


def test_a_cube_in_space_takes_both_vectors() -> None:
    turned = tuple(geometry.rotation_quaternion(np.array([0.4, -0.2, 0.9])).tolist())
    shape = Box(half_extents=(SIDE,) * 3)
    cube = RigidObject(name="cube", shape=shape, mass=MASS, position=(0.0, 0.0, 0.0), orientation=turned)
    weightless = Environment(gravity=(0.0, 0.0, 0.0))
    world = World(objects=(cube,), environment=weightless, effects=(pulse("slack", "cube"),))
    end = rollout(world, 0.5).trajectory
    assert MASS * end.velocities[-1, 0] == pytest.approx(IMPULSE, rel=1e-5)
    assert 2.0 / 3.0 * MASS * SIDE**2 * end.angular_velocities[-1, 0] == pytest.approx(TURN, rel=1e-3)


def test_the_collision_of_a_removed_body_leaves_no_pulse_and_others_stay() -> None:
    """a met b at 0.2 s, and c met d at 0.4 s: without b, a goes straight on, and c and d are struck as before."""
    met = [pulse(f"slack_1_{n}", n, planar=True) for n in "ab"] + [
        pulse(f"slack_2_{n}", n, time=0.4, planar=True) for n in "cd"
    ]
    world = planar(*met, names=("a", "b", "c", "d"))
    left = without(world, "b")
    assert [e.name for e in left.effects] == ["slack_2_c", "slack_2_d"]
    before, after = rollout(world, 0.8).trajectory, rollout(left, 0.8).trajectory
    assert after.velocities[-1, 0] == pytest.approx((0.3, 0.1, 0.0), abs=1e-12)
    for name in "cd":
        row, same = before.names.index(name), after.names.index(name)
        assert after.positions[-1, same] == pytest.approx(before.positions[-1, row], abs=1e-12)
