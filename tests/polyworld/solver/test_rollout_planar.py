"""The planar simulator as its callers see it: batches, threads, times, events, divergence."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from polyworld.solver.rollout import MAX_SUBSTEPS, rollout, simulator
from polyworld.world import Effect, Environment, StaticObject, TimeBase, World
from polyworld.world.shapes import Box, Plane, Sphere, Wall
from tests.verification.planar_scenes import G, body, disc, run, side_view, top_view


def crowd() -> World:
    """Discs and boxes that meet within the first second, with everything a world can have."""
    items = [
        body(
            f"o{i}",
            disc() if i % 2 else Box(half_extents=(0.2, 0.15, 0.2)),
            (np.cos(i), np.sin(i), 0.2),
            velocity=(-2.0 * np.cos(i), -2.0 * np.sin(i), 0.0),
            friction=0.2,
            linear_damping=0.1,
        )
        for i in range(5)
    ]
    drag = Effect(name="air", kind="quadratic_drag", parameters={"coefficient": 0.5})
    wall = StaticObject(name="wall", shape=Wall(start=(1.3, -2.0, 0.0), end=(1.3, 2.0, 0.0)))
    return top_view(*items, statics=(wall,), effects=(drag,))


def test_fewer_samples_are_the_beginning_of_more() -> None:
    times = np.arange(50) * 0.04
    machine = simulator(crowd(), times)
    whole, part = machine.run(), machine.run(samples=20)
    assert part.positions.shape[1] == 20
    assert whole.positions[:, :20].tobytes() == part.positions.tobytes()


def test_a_turn_override_turns_the_body_and_what_it_hits() -> None:
    """A square turned by 45 degrees reaches a wall sqrt(2) a from its centre, not a."""
    box = body("box", Box(half_extents=(0.2, 0.2, 0.2)), (-1.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0), restitution=1.0)
    wall = StaticObject(name="wall", shape=Wall(start=(0.01, -2.0, 0.0), end=(0.01, 2.0, 0.0)))
    world = top_view(box, gravity=0.0, statics=(wall,))
    machine = simulator(world, np.arange(101) * 0.01, n_worlds=2, record_events=True)
    batch = machine.run({"objects.box.rotation.z": np.array([0.0, np.pi / 4])})
    begins = [events[0].time for events in batch.events]
    assert begins[0] == pytest.approx(0.8, abs=1e-5)
    assert begins[1] == pytest.approx(1.0 - 0.2 * np.sqrt(2), abs=1e-5)
    np.testing.assert_allclose(batch.orientations[1, 0, 0], [np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)], atol=1e-12)


def test_a_planar_object_cannot_be_tipped_out_of_its_plane() -> None:
    machine = simulator(top_view(body("a", disc(), (0.0, 0.0, 0.2))), np.arange(3) * 0.1)
    with pytest.raises(ValueError, match="motion plane's normal"):
        machine.run({"objects.a.rotation.x": np.array([0.3])})


def test_seconds_per_frame_stretches_the_sample_times() -> None:
    """Two worlds of free fall sampled at other times lie on the same parabola."""
    world = side_view(body("ball", Sphere(radius=0.1), (0.0, 0.0, 50.0)))
    world = world.model_copy(update={"time": TimeBase(seconds_per_frame=0.04)})
    batch = simulator(world, np.arange(20) * 0.04, n_worlds=2).run({"time.seconds_per_frame": np.array([0.04, 0.06])})
    np.testing.assert_allclose(batch.times[1], np.arange(20) * 0.06, rtol=1e-14)
    for w in range(2):
        np.testing.assert_allclose(batch.positions[w, :, 0, 2], 50.0 - 0.5 * G * batch.times[w] ** 2, atol=1e-11)


def test_an_object_joins_at_its_start_time_and_not_before() -> None:
    """Before it joins nothing runs into it; from then on it moves from the state it was given."""
    runner = body("runner", disc(), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0), restitution=1.0)
    late = body("late", disc(), (0.0, 0.0, 0.2), velocity=(0.0, 1.0, 0.0), start_time=1.005)
    motion = run(top_view(runner, late, gravity=0.0), 1.5)
    t = motion.times[0]
    assert not motion.events[0]
    np.testing.assert_allclose(motion.positions[0, :, 0, 0], -1.0 + 2.0 * t, atol=1e-12)
    np.testing.assert_allclose(motion.positions[0, :, 1, 1], np.maximum(0.0, t - 1.005), atol=1e-12)
    assert np.array_equal(motion.active[:, 1], t >= 1.005)


def test_a_runaway_world_stops_alone_and_says_who_and_when() -> None:
    """Negative drag blows one world of two up; the other is as if it had been alone."""
    push = Effect(name="push", kind="uniform_acceleration", parameters={"x": 0.0})
    ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 0.1))
    still = body("still", Sphere(radius=0.1), (0.0, 9.0, 0.1))
    world = top_view(still, ball, effects=(push,))
    world = world.model_copy(update={"effects": (push.model_copy(update={"objects": ("ball",)}),)})
    long = simulator(world, np.arange(1001) * 0.2, n_worlds=2, threads=1)
    batch = long.run({"effects.push.x": np.array([0.0, 1e4])})
    assert batch.diverged.tolist() == [False, True]
    assert batch.diverged_object[1] == 1
    assert batch.diverged_time[1] == pytest.approx(100.0, abs=0.3)  # 1e6 m/s at 1e4 m/s^2
    assert np.all(np.isfinite(batch.positions[0]))
    cut = batch.world(1)
    assert 0 < len(cut.times) < 1001
    assert cut.times[-1] <= batch.diverged_time[1]


@pytest.mark.parametrize(
    ("horizon", "interval", "message"),
    [
        (0.0, None, "horizon must be positive"),
        (-1.0, None, "horizon must be positive"),
        (float("nan"), None, "horizon must be positive"),
        (1e9, None, f"more than {MAX_SUBSTEPS} substeps; the longest is 4000 s"),
        (1.0, 0.0, "sample_interval must be positive"),
        (1000.0, 0.002, "more than 200000 samples: take a sample_interval of at least 0.005 s"),
    ],
)
def test_an_impossible_horizon_is_refused(horizon: float, interval: float | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rollout(top_view(body("a", disc(), (0.0, 0.0, 0.2))), horizon, sample_interval=interval)


def test_bad_sample_times_are_refused() -> None:
    world = top_view(body("a", disc(), (0.0, 0.0, 0.2)))
    for times in ([], [0.0, 0.0], [0.1, 0.05], [-0.1, 0.0], [0.0, float("nan")]):
        with pytest.raises(ValueError, match="sample_times"):
            simulator(world, np.array(times))
    with pytest.raises(ValueError, match="one a world"):
        simulator(world, np.array([0.0, 1.0]), n_worlds=3).run({"objects.a.mass": np.ones(2)})


def test_contact_events_carry_names_time_impulse_and_place() -> None:
    """Head-on, e = 1/2: begin and end at the touch, impulse (1 + e) m v / 2."""
    a = body("zed", disc(), (-1.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0), mass=2.0, restitution=0.5)
    b = body("ann", disc(), (0.0, 0.0, 0.2), mass=2.0, restitution=0.5)
    motion = run(top_view(a, b, gravity=0.0), 1.0)
    begin, end = motion.events[0]
    assert (begin.kind, end.kind) == ("contact_begin", "contact_end")
    assert begin.participants == ("ann", "zed")
    assert begin.time == pytest.approx(0.6, abs=1e-6)
    assert end.time == pytest.approx(0.6, abs=1e-6)
    assert begin.impulse == pytest.approx(1.5, rel=1e-9)
    assert end.impulse == pytest.approx(1.5, rel=1e-9)
    assert begin.speed == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(begin.position, [-0.2, 0.0, 0.2], atol=1e-6)


def test_a_resting_contact_carries_the_weight_until_it_ends() -> None:
    """A ball slides off a ledge at 2 m/s (v^2/r > g: it leaves at the edge): m g t in all, to 1 %."""
    ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 0.1), mass=3.0, velocity=(2.0, 0.0, 0.0), restitution=0.0)
    ledge = StaticObject(name="ledge", shape=Box(half_extents=(0.5, 1.0, 0.1)), position=(0.0, 0.0, -0.1))
    world = side_view(ball).model_copy(update={"statics": (ledge,)})
    begin, end = run(world, 1.0).events[0]
    assert begin.time == 0.0
    assert end.time == pytest.approx(0.25, abs=0.003)
    assert end.impulse == pytest.approx(3.0 * G * 0.25, rel=0.01)


def test_a_contact_that_lasts_to_the_horizon_has_no_end() -> None:
    box = body("box", Box(half_extents=(0.2, 0.2, 0.2)), (0.0, 0.0, 0.2))
    assert [e.kind for e in run(side_view(box), 1.0).events[0]] == ["contact_begin"]


def test_rattling_is_one_contact() -> None:
    """A ball's last bounces, under 0.05 s apart, belong to one contact that lasts."""
    ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 0.2), restitution=0.5)
    events = run(side_view(ball), 2.0).events[0]
    begins = [e.time for e in events if e.kind == "contact_begin"]
    ends = [e.time for e in events if e.kind == "contact_end"]
    assert len(begins) == len(ends) + 1
    assert all(later - earlier > 0.05 for earlier, later in pairwise(begins))
    # Bounces last 2 v e^n / g: the contact begins with the first that is followed by a shorter one than 0.05 s.
    speed = np.sqrt(2 * G * 0.1)
    flights = [2 * speed * 0.5**n / G for n in range(1, 20)]
    assert len(begins) == 1 + sum(f > 0.05 for f in flights)


def test_objects_at_other_heights_pass_over_each_other() -> None:
    low = body("low", disc(), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0))
    high = body("high", disc(), (1.0, 0.0, 0.7), velocity=(-2.0, 0.0, 0.0))
    slab = StaticObject(name="table", shape=Box(half_extents=(3.0, 3.0, 0.5)), position=(0.0, 0.0, -0.5))
    motion = run(top_view(low, high, gravity=0.0, statics=(slab,)), 1.0)
    assert not motion.events[0]
    np.testing.assert_allclose(motion.positions[0, -1, :, 0], [1.0, -1.0], atol=1e-12)


def test_a_static_without_coefficients_leaves_them_to_the_body() -> None:
    for restitution, expected in ((None, 0.8), (0.2, np.sqrt(0.8 * 0.2))):
        ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 1.1), restitution=0.8)
        floor = StaticObject(name="floor", shape=Plane(), restitution=restitution)
        world = side_view(ball).model_copy(update={"statics": (floor,)})
        motion = run(world, 0.6)
        impact = np.sqrt(2 * G)
        rebound = motion.velocities[0, 50, 0, 2] + G * (motion.times[0, 50] - impact / G)
        assert rebound == pytest.approx(expected * impact, rel=1e-6)


def test_drag_matches_the_exact_solution() -> None:
    """Linear drag: v0 exp(-c t / m); quadratic: v0 / (1 + k v0 t / m); relative 1e-5."""
    for kind, exact in (
        ("linear_drag", lambda t: 3.0 * np.exp(-0.8 * t / 2.0)),
        ("quadratic_drag", lambda t: 3.0 / (1 + 0.8 * 3.0 * t / 2.0)),
    ):
        ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 0.1), velocity=(3.0, 0.0, 0.0), mass=2.0)
        effect = Effect(name="air", kind=kind, parameters={"coefficient": 0.8})
        motion = run(top_view(ball, effects=(effect,)), 2.0)
        np.testing.assert_allclose(motion.velocities[0, :, 0, 0], exact(motion.times[0]), rtol=1e-5)


def test_magnus_lift_bends_the_path_in_a_side_view() -> None:
    """F = s omega x v with constant omega: circular motion of rate s omega / m, without gravity; relative 1e-5."""
    ball = body(
        "ball",
        Sphere(radius=0.1),
        (0.0, 0.0, 5.0),
        velocity=(2.0, 0.0, 0.0),
        angular_velocity=(0.0, 3.0, 0.0),
        mass=1.0,
    )
    effect = Effect(name="lift", kind="magnus_lift", parameters={"coefficient": 0.5})
    world = side_view(ball, gravity=0.0).model_copy(update={"effects": (effect,)})
    motion = run(world, 1.0)
    turned = 1.5 * motion.times[0]  # omega along +y turns x towards -z
    np.testing.assert_allclose(motion.velocities[0, :, 0, 0], 2 * np.cos(turned), atol=2e-5)
    np.testing.assert_allclose(motion.velocities[0, :, 0, 2], -2 * np.sin(turned), atol=2e-5)


def test_a_gravity_override_changes_the_load_on_the_table() -> None:
    """Slide length v^2 / 2 mu g for three values of g at once."""
    thrown = body("disc", disc(), (0.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0), friction=0.25)
    g = np.array([1.62, 3.71, 9.81])
    batch = simulator(top_view(thrown), np.array([0.0, 5.0]), n_worlds=3).run({"environment.gravity.z": -g})
    np.testing.assert_allclose(batch.positions[:, -1, 0, 0], 1.0 / (2 * 0.25 * g), rtol=1e-9)


def test_environment_without_support_lets_objects_slide_for_ever() -> None:
    world = top_view(body("disc", disc(), (0.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0), friction=0.25))
    free = world.environment.motion_plane.model_copy(update={"supports": False})
    world = world.model_copy(update={"environment": Environment(motion_plane=free)})
    assert run(world, 2.0).positions[0, -1, 0, 0] == pytest.approx(2.0, abs=1e-12)


def test_a_force_that_overflows_stops_the_world_and_not_the_program() -> None:
    """Quadratic drag far too strong for the step: the speed overflows; another body is near enough to be tested."""
    drag = Effect(name="air", kind="quadratic_drag", parameters={"coefficient": 1e6})
    fast = body("fast", Sphere(radius=0.1), (0.0, 0.0, 0.1), velocity=(1e5, 0.0, 0.0), mass=1e-6)
    near = body("near", Box(half_extents=(0.1, 0.1, 0.1)), (0.21, 0.0, 0.1))
    result = rollout(top_view(fast, near, effects=(drag,)), 1.0)
    assert result.status == "diverged"
    assert result.diverged_object == "fast"
