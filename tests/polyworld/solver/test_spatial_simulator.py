"""The spatial simulator as a forward model: replays, batches, threads, overrides, events, errors."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.model import model_of
from polyworld.solver.rollout import rollout, simulator
from polyworld.solver.spatial.simulator import SpatialSimulator
from polyworld.world import Effect, StaticObject, World
from polyworld.world.shapes import Box, Cylinder, Sphere, Wall
from tests.verification.spatial_world import FLOOR, GRAVITY, body, make_world, run

TIMES = np.arange(0.0, 2.001, 0.04)


def test_gravity_and_friction_overrides_act() -> None:
    """Slide lengths v^2 / 2 mu g of three variants of one world."""
    world = make_world(body("b", Box(half_extents=(0.1, 0.1, 0.1)), (0, 0, 0.1), velocity=(1, 0, 0)))
    mu = np.array([0.2, 0.4, 0.4])
    g = np.array([-GRAVITY, -GRAVITY, -2.0])
    out = run(world, 2.0, n_worlds=3, overrides={"objects.b.friction": mu, "environment.gravity.z": g})
    assert out.positions[:, -1, 0, 0] == pytest.approx(1 / (2 * mu * -g), rel=1e-3)


def test_static_coefficients_mix_by_geometric_mean_and_default_to_the_bodys_own() -> None:
    floor = FLOOR.model_copy(update={"friction": 0.1, "restitution": 0.25})
    slider = body("b", Box(half_extents=(0.1, 0.1, 0.1)), (0, 0, 0.1), velocity=(1, 0, 0), friction=0.4)
    out = run(make_world(slider, statics=(floor,)), 2.0)
    assert out.positions[0, -1, 0, 0] == pytest.approx(1 / (2 * 0.2 * GRAVITY), rel=1e-3)
    ball = body("b", Sphere(radius=0.1), (0, 0, 1.1), restitution=1.0)
    bounced = run(make_world(ball, statics=(floor,)), 0.6)
    assert bounced.events[0][0].impulse == pytest.approx(1.5 * np.sqrt(2 * GRAVITY), rel=1e-3)


def test_a_cylinder_rolls_down_a_ramp_whose_quaternion_was_rounded() -> None:
    """At 2/3 g sin(tilt), however many digits its orientation was given with."""
    tilt, radius, time = 0.284704, 0.05, 0.5
    normal = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    ramp = StaticObject(name="ramp", shape=Box(half_extents=(1.0, 0.3, 0.02)), orientation=(0.9899, 0.0, 0.1419, 0.0))
    lain = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
    shape = Cylinder(radius=radius, half_height=0.05)
    roller = body("roller", shape, normal * (0.02 + radius), orientation=lain, restitution=0.0)
    trajectory = rollout(make_world(roller, statics=(ramp,)), time).trajectory
    way = np.linalg.norm(trajectory.positions[-1, 0] - trajectory.positions[0, 0])
    assert way == pytest.approx(GRAVITY * np.sin(tilt) * time**2 / 3.0, rel=0.01)
    assert abs(trajectory.positions[-1, 0, 1]) < 1e-4


def test_heavier_rolling_resistance_of_the_two_counts() -> None:
    """A ball without rolling resistance of its own, pressed by nothing else, rolls on for ever."""
    free = body("b", Sphere(radius=0.1), (0, 0, 0.1), velocity=(1, 0, 0), angular_velocity=(0, 10, 0))
    out = run(make_world(free), 3.0)
    assert out.velocities[0, -1, 0, 0] == pytest.approx(1.0, abs=1e-9)


def test_contact_episode_runs_from_first_touch_to_last_and_bridges_rattling() -> None:
    """A ball that bounces lower and lower ends with one lasting contact; a weak rattle makes no extra events."""
    ball = body("ball", Sphere(radius=0.1), (0, 0, 0.3), restitution=0.5)
    out = run(make_world(ball), 3.0)
    begins = [e for e in out.events[0] if e.kind == "contact_begin"]
    ends = [e for e in out.events[0] if e.kind == "contact_end"]
    assert begins[0].time == pytest.approx(np.sqrt(0.4 / GRAVITY), abs=1e-4)
    assert len(begins) == len(ends) + 1  # the last one lasts
    gaps = [b.time - e.time for b, e in zip(begins[1:], ends, strict=True)]
    assert min(gaps) > 0.05
    speed = np.sqrt(2 * GRAVITY * 0.2)
    for k, begin in enumerate(begins[:3]):
        assert begin.speed == pytest.approx(speed * 0.5**k, rel=1e-3)


def test_resting_contact_carries_the_weight() -> None:
    """The impulse of a contact that lasts from the push to the lift is the weight times the time."""
    lid = body("box", Box(half_extents=(0.1, 0.1, 0.1)), (0, 0, 0.1), velocity=(2, 0, 0), friction=0.0)
    ledge = StaticObject(name="ledge", shape=Box(half_extents=(1, 1, 0.1)), position=(0, 0, -0.1))
    out = run(make_world(lid, statics=(ledge,)), 1.0)
    end = next(e for e in out.events[0] if e.kind == "contact_end")
    assert end.participants == ("box", "ledge")
    tips = 0.5  # centre over the edge
    assert end.impulse == pytest.approx(GRAVITY * tips, rel=0.15)


def test_pairs_of_objects_and_statics_are_reported_by_name() -> None:
    wall = StaticObject(name="a-wall", shape=Wall(start=(1, -1, 0), end=(1, 1, 0)))
    ball = body("ball", Sphere(radius=0.1), (0, 0, 0.1), velocity=(2, 0, 0), friction=0.0)
    out = run(make_world(ball, statics=(FLOOR, wall)), 1.0)
    hit = next(e for e in out.events[0] if e.participants == ("a-wall", "ball") and e.kind == "contact_begin")
    assert hit.speed == pytest.approx(2.0, rel=1e-6)
    assert hit.position == pytest.approx((0.99, 0.0, 0.1), abs=1e-4)


def test_object_joins_at_its_start_time_and_only_then_collides() -> None:
    late = body("late", Sphere(radius=0.1), (0.5, 0, 0), start_time=1.0, restitution=1.0)
    early = body("early", Sphere(radius=0.1), (0, 0, 0), velocity=(0.4, 0, 0), restitution=1.0)
    gone = body("gone", Sphere(radius=0.1), (0, 0.5, 0), velocity=(1, 0, 0))
    crossing = body("crossing", Sphere(radius=0.1), (0.5, 0.5, 0), start_time=1.5)
    out = run(make_world(late, early, gone, crossing, statics=(), gravity=(0, 0, 0)), 2.0)
    begins = [e for e in out.events[0] if e.kind == "contact_begin"]
    assert [e.participants for e in begins] == [("early", "late")]
    assert begins[0].time == pytest.approx(1.0, abs=1e-6)  # they overlap by then: the push begins at once


def test_divergence_is_reported_with_time_and_object() -> None:
    world = make_world(
        body("calm", Sphere(radius=0.1), (0, 0, 0)),
        body("wild", Sphere(radius=0.1), (5, 0, 0)),
        statics=(),
        gravity=(0, 0, 0),
        effects=(Effect(name="push", kind="uniform_acceleration", parameters={"x": 1e4}, objects=("wild",)),),
    )
    out = run(world, 200.0, samples=11)
    assert out.diverged[0]
    assert out.diverged_object[0] == 1
    assert 90.0 < out.diverged_time[0] < 110.0
    assert np.isnan(out.positions[0, -1]).all()
    assert len(out.world(0).times) == 5


@pytest.mark.parametrize("spin", [1e60, 1e120])
def test_a_spin_that_no_number_can_follow_is_lost(spin: float) -> None:
    """Its quaternion would be all zeros, or stay as it was."""
    wild = body("wild", Box(half_extents=(0.1, 0.2, 0.3)), (0, 0, 0), angular_velocity=(spin, 0.5 * spin, 0))
    empty = make_world(statics=(), gravity=(0, 0, 0))  # a world refuses such a spin, but a fit or effect may reach it
    out = run(empty.model_copy(update={"objects": (wild,)}), 0.1)
    assert out.diverged[0]
    assert np.isnan(out.orientations[0, -1]).all()


def test_world_without_objects_runs() -> None:
    out = SpatialSimulator(model_of(World(statics=(FLOOR,))), TIMES).run()
    assert out.positions.shape == (1, len(TIMES), 0, 3)


def test_rollout_of_a_spatial_world_has_trajectory_and_events() -> None:
    can = body("can", Cylinder(radius=0.1, half_height=0.1), (0, 0, 0.1), velocity=(1, 0, 0), friction=0.5)
    result = rollout(make_world(can), 1.0)
    assert result.status == "completed"
    assert result.trajectory.times[-1] == pytest.approx(1.0)
    assert {e.kind for e in result.events} == {"contact_begin", "rest"}
    assert simulator(make_world(can), TIMES).names == ("can",)
