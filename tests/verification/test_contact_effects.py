"""Laws of contact as effects, against formulas derived by hand and SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Effect, Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Box, Plane, Sphere

Array = NDArray[np.float64]
R = 0.1
G = 9.81
SIDE_VIEW = MotionPlane(normal=(0.0, -1.0, 0.0))  # x and z
KINDS = ("rigid_planar", "rigid_spatial")


def ball(representation: Any = "rigid_spatial", name: str = "ball", **fields: Any) -> RigidObject:
    """A ball of 1 kg a metre up, frictionless and elastic by default."""
    given = {"position": (0.0, 0.0, 1.0), "friction": 0.0, "restitution": 1.0, "mass": 1.0, **fields}
    return RigidObject(name=name, representation=representation, shape=fields.pop("shape", Sphere(radius=R)), **given)


def law(kind: str, objects: tuple[str, ...] | None = None, **parameters: float) -> Effect:
    return Effect(name="law", kind=kind, parameters=parameters, objects=objects)


def bouncing(*objects: RigidObject, effects: tuple[Effect, ...] = (), gravity: float = G, **fields: Any) -> World:
    """Objects above a floor that takes friction and restitution of what touches it, seen from the side."""
    return World(
        objects=objects,
        statics=(StaticObject(name="floor", shape=Plane()),),
        environment=Environment(gravity=(0.0, 0.0, -gravity), motion_plane=SIDE_VIEW),
        effects=effects,
        time=TimeBase(substep=0.002),
        **fields,
    )


def run(world: World, end: float, samples: int = 101, **fields: Any) -> BatchTrajectory:
    overrides = fields.pop("overrides", None)
    times = np.linspace(0.0, end, samples)
    return simulator(world, times, record_events=True, **{"threads": 1, **fields}).run(overrides)


def approach_speeds(found: BatchTrajectory) -> list[float]:
    return [e.speed for e in found.events[0] if e.kind == "contact_begin" and e.speed is not None]


# --- restitution that falls with speed --------------------------------------------------------


@pytest.mark.parametrize("representation", KINDS)
def test_each_rebound_follows_e_of_its_own_speed(representation: str) -> None:
    e0, k = 0.9, 0.15
    world = bouncing(ball(representation, restitution=e0), effects=(law("restitution_speed", rate=k),))
    speeds = approach_speeds(run(world, 2.0))
    expected = [np.sqrt(2.0 * G * (1.0 - R))]
    while len(expected) < len(speeds):
        expected.append(e0 * expected[-1] / (1.0 + k * expected[-1]))
    assert len(speeds) >= 3
    np.testing.assert_allclose(speeds, expected, rtol=1e-4)


def test_the_lesser_of_two_speeds_loses_less_also_between_two_balls() -> None:
    e0, k = 0.8, 0.3
    hit = ball(position=(0.0, 0.0, 5.0), velocity=(3.0, 0.0, 0.0), restitution=e0)
    struck = ball(name="struck", position=(1.0, 0.0, 5.0), restitution=e0)
    found = run(bouncing(hit, struck, gravity=0.0, effects=(law("restitution_speed", ("struck",), rate=k),)), 1.0)
    e = e0 / (1.0 + 3.0 * k)
    np.testing.assert_allclose(found.velocities[0, -1, :, 0], [1.5 * (1.0 - e), 1.5 * (1.0 + e)], atol=1e-9)


def test_drops_with_drag_and_falling_restitution_are_those_of_scipy() -> None:
    e0, k, drag = 0.85, 0.1, 0.05
    effects = (
        law("restitution_speed", rate=k),
        Effect(name="air", kind="quadratic_drag", parameters={"coefficient": drag}),
    )
    found = run(bouncing(ball(restitution=e0), effects=effects), 1.6, samples=161)

    def floor(_t: float, y: Array) -> float:
        return float(y[0] - R)

    floor.terminal, floor.direction = True, -1.0  # type: ignore[attr-defined]
    t, y, heights = 0.0, np.array([1.0, 0.0]), np.empty(161)
    times = np.linspace(0.0, 1.6, 161)
    while t < 1.6:
        leg = solve_ivp(
            lambda _t, s: [s[1], -G - drag * abs(s[1]) * s[1]],
            (t, 1.6),
            y,
            events=floor,
            dense_output=True,
            rtol=1e-10,
            atol=1e-12,
            first_step=1e-3,
        )
        inside = (times >= t) & (times <= leg.t[-1])
        heights[inside] = leg.sol(times[inside])[0]
        t, speed = float(leg.t[-1]), -float(leg.y[1, -1])
        y = np.array([R, e0 * speed / (1.0 + k * speed)])
    np.testing.assert_allclose(found.positions[0, :, 0, 2], heights, atol=2e-5)


# --- friction that knows no spin --------------------------------------------------------------


@pytest.mark.parametrize("representation", KINDS)
def test_every_bounce_takes_its_share_of_the_sliding_speed_and_leaves_the_spin(representation: str) -> None:
    share = 0.2
    thrown = ball(representation, velocity=(2.0, 0.0, 0.0), angular_velocity=(0.0, 7.0, 0.0), restitution=0.9)
    found = run(bouncing(thrown, effects=(law("bounce_friction", share=share),)), 2.0)
    bounces = len(approach_speeds(found))
    assert bounces >= 2
    np.testing.assert_allclose(found.velocities[0, -1, 0, 0], 2.0 * (1.0 - share) ** bounces, rtol=1e-12)
    np.testing.assert_allclose(found.angular_velocities[0, -1, 0], [0.0, 7.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("representation", KINDS)
def test_the_share_is_of_what_coulomb_friction_leaves(representation: str) -> None:
    share, mu, e = 0.3, 0.1, 0.8
    thrown = ball(representation, velocity=(3.0, 0.0, 0.0), restitution=e, friction=mu)
    found = run(bouncing(thrown, effects=(law("bounce_friction", share=share),)), 0.5)
    impulse = mu * (1.0 + e) * np.sqrt(2.0 * G * (1.0 - R))
    np.testing.assert_allclose(found.velocities[0, -1, 0, 0], (3.0 - impulse) * (1.0 - share), rtol=1e-6)
    np.testing.assert_allclose(found.angular_velocities[0, -1, 0, 1], impulse * R / (0.4 * R**2), rtol=5e-5)


@pytest.mark.parametrize("representation", KINDS)
def test_two_balls_that_graze_keep_their_momentum(representation: str) -> None:
    a = ball(representation, position=(0.0, 0.0, 5.0), velocity=(3.0, 0.0, 0.0), mass=2.0)
    b = ball(representation, "other", position=(0.8, 0.0, 5.1))
    world = bouncing(a, b, gravity=0.0, effects=(law("bounce_friction", share=0.5),))
    found = run(world, 0.6)
    n = np.array([np.sqrt(3.0) / 2.0, 0.0, 0.5])  # the centres are 2 R apart, R of it up
    u = np.array([3.0, 0.0, 0.0])
    change = (2.0 / 3.0) * (2.0 * (u @ n) * n + 0.5 * (u - (u @ n) * n))  # reduced mass times what is lost
    np.testing.assert_allclose(found.velocities[0, -1, 0], u - change / 2.0, atol=2e-4)
    np.testing.assert_allclose(found.velocities[0, -1, 1], change, atol=2e-4)
    np.testing.assert_allclose(2.0 * found.velocities[0, -1, 0] + found.velocities[0, -1, 1], 2.0 * u, atol=1e-12)


# --- impacts that grip ------------------------------------------------------------------------


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("e_t", [-0.5, 0.0, 0.6, 1.0])
@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_a_superball_exchanges_spin_and_speed(representation: str, e_t: float, mu: float) -> None:
    spin, speed = -25.0, 1.5
    thrown = ball(
        representation, velocity=(speed, 0.0, 0.0), angular_velocity=(0.0, spin, 0.0), friction=mu, restitution=0.8
    )
    found = run(bouncing(thrown, effects=(law("spin_coupling", restitution=e_t),)), 0.6)
    u = speed - R * spin  # of the lowest point
    change = -(2.0 / 7.0) * (1.0 + e_t) * u  # solid ball: 1 / (1 / m + R^2 / I) = 2 m / 7
    np.testing.assert_allclose(found.velocities[0, -1, 0, 0], speed + change, rtol=5e-5)
    np.testing.assert_allclose(found.angular_velocities[0, -1, 0, 1], spin - change * R / (0.4 * R**2), rtol=5e-5)


@pytest.mark.parametrize("representation", KINDS)
def test_a_partial_grip_is_the_mean_of_both_laws(representation: str) -> None:
    mu, e, e_t, grip, speed = 0.1, 0.8, 0.5, 0.25, 3.0
    thrown = ball(representation, velocity=(speed, 0.0, 0.0), friction=mu, restitution=e)
    found = run(bouncing(thrown, effects=(law("spin_coupling", restitution=e_t, grip=grip),)), 0.5)
    rubbed = mu * (1.0 + e) * np.sqrt(2.0 * G * (1.0 - R))
    impulse = (1.0 - grip) * rubbed + grip * (2.0 / 7.0) * (1.0 + e_t) * speed
    np.testing.assert_allclose(found.velocities[0, -1, 0, 0], speed - impulse, rtol=5e-5)
    np.testing.assert_allclose(found.angular_velocities[0, -1, 0, 1], impulse * R / (0.4 * R**2), rtol=5e-5)


@pytest.mark.parametrize("representation", KINDS)
def test_an_ideal_superball_keeps_its_energy_for_good(representation: str) -> None:
    thrown = ball(representation, velocity=(1.0, 0.0, 0.0), angular_velocity=(0.0, 30.0, 0.0))
    found = run(bouncing(thrown, effects=(law("spin_coupling", restitution=1.0),)), 10.0)
    v, w = found.velocities[0, :, 0], found.angular_velocities[0, :, 0]
    energy = 0.5 * (v**2).sum(axis=1) + 0.2 * R**2 * (w**2).sum(axis=1) + G * found.positions[0, :, 0, 2]
    np.testing.assert_allclose(energy, energy[0], rtol=2e-4)
    assert len(approach_speeds(found)) > 10


def test_two_superballs_keep_momentum_and_angular_momentum() -> None:
    a = ball(position=(0.0, 0.0, 5.0), velocity=(3.0, 0.4, 0.0), angular_velocity=(3.0, -20.0, 9.0), mass=2.0)
    b = ball(name="other", position=(0.8, 0.0, 5.1), angular_velocity=(0.0, 5.0, -30.0))
    found = run(bouncing(a, b, gravity=0.0, effects=(law("spin_coupling", restitution=0.7),)), 0.6)
    mass = np.array([2.0, 1.0])[:, None]
    x, v, w = found.positions[0], found.velocities[0], found.angular_velocities[0]
    assert np.abs(w[-1] - w[0]).max() > 1.0
    np.testing.assert_allclose((mass * v[-1]).sum(axis=0), (mass * v[0]).sum(axis=0), atol=1e-12)
    turning = [(np.cross(x[t], mass * v[t]) + 0.4 * R**2 * mass * w[t]).sum(axis=0) for t in (0, -1)]
    np.testing.assert_allclose(turning[1], turning[0], atol=1e-10)


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("e_t", [-0.4, 0.3, 1.0])
def test_tumbling_boxes_never_gain_energy(representation: str, e_t: float) -> None:
    half = (0.3, 0.1, 0.05)
    thrown = RigidObject(
        name="box",
        representation=representation,  # type: ignore[arg-type]
        shape=Box(half_extents=half),
        mass=1.0,
        friction=0.3,
        restitution=0.3,
        position=(0.0, 0.0, 1.0),
        velocity=(2.0, 0.0, 0.0),
        angular_velocity=(0.0, 9.0, 0.0),
    )
    found = run(bouncing(thrown, effects=(law("spin_coupling", restitution=e_t, grip=0.7),)), 2.0, samples=401)
    v, w = found.velocities[0, :, 0], found.angular_velocities[0, :, 0]
    moment = (half[0] ** 2 + half[2] ** 2) / 3.0  # it turns about y alone
    energy = 0.5 * (v**2).sum(axis=1) + 0.5 * moment * w[:, 1] ** 2 + G * found.positions[0, :, 0, 2]
    assert np.diff(energy).max() < 2e-4 * energy[0]
    assert energy[-1] < energy[0]


# --- a patch of another friction --------------------------------------------------------------


def sliding(representation: str, speed: float, mu: float, effects: tuple[Effect, ...], y: float = 0.0) -> World:
    """A flat block on a table: in a planar world its plane, else a static one."""
    block = RigidObject(
        name="block",
        representation=representation,  # type: ignore[arg-type]
        shape=Box(half_extents=(0.05, 0.05, 0.01)),
        mass=1.0,
        friction=mu,
        restitution=0.0,
        position=(-1.0, y, 0.01),
        velocity=(speed, 0.0, 0.0),
    )
    statics = () if representation == "rigid_planar" else (StaticObject(name="table", shape=Plane()),)
    return World(objects=(block,), statics=statics, effects=effects, time=TimeBase(substep=0.002))


@pytest.mark.parametrize("representation", KINDS)
def test_a_patch_takes_the_work_of_its_friction_over_its_width(representation: str) -> None:
    added, radius, speed = 0.3, 0.25, 2.0
    world = sliding(representation, speed, 0.0, (law("friction_patch", radius=radius, friction=added),))
    found = run(world, 1.2)
    expected = np.sqrt(speed**2 - 2.0 * added * G * 2.0 * radius)
    np.testing.assert_allclose(found.velocities[0, -1, 0], [expected, 0.0, 0.0], atol=1e-5)


@pytest.mark.parametrize("representation", KINDS)
@pytest.mark.parametrize("added", [0.4, -0.3])
def test_a_block_that_crosses_a_patch_off_its_centre_moves_as_scipy_says(representation: str, added: float) -> None:
    mu, radius, speed, y = 0.1, 0.4, 2.4, 0.15
    world = sliding(representation, speed, mu, (law("friction_patch", radius=radius, friction=added, x=-0.1),), y)
    found = run(world, 1.2, samples=61)

    def rate(_t: float, s: Array) -> list[float]:
        friction = max(mu + added, 0.0) if np.hypot(s[0] + 0.1, y) < radius else mu
        return [s[1], -friction * G if s[1] > 0.0 else 0.0]

    times = np.linspace(0.0, 1.2, 61)
    exact = solve_ivp(rate, (0.0, 1.2), [-1.0, speed], t_eval=times, rtol=1e-9, atol=1e-11, max_step=5e-4).y
    np.testing.assert_allclose(found.positions[0, :, 0, 0], exact[0], atol=2e-5)
    np.testing.assert_allclose(found.velocities[0, :, 0, 0], exact[1], atol=1e-4)


@pytest.mark.parametrize("representation", KINDS)
def test_the_path_through_a_patch_has_derivatives_by_its_place(representation: str) -> None:
    world = sliding(representation, 2.0, 0.05, (law("friction_patch", radius=0.3, friction=0.2),))
    steps = np.array([-2e-3, -1e-3, 1e-3, 2e-3])
    for path, value in (("x", 0.0), ("radius", 0.3), ("friction", 0.2)):
        found = run(world, 0.8, n_worlds=4, overrides={f"effects.law.{path}": value + steps})
        end = found.positions[:, -1, 0, 0]
        assert (end[2] - end[1]) / 2e-3 == pytest.approx((end[3] - end[0]) / 4e-3, rel=0.02, abs=1e-3)


@pytest.mark.parametrize("representation", KINDS)
def test_objects_that_meet_over_a_patch_rub_on_each_other_as_elsewhere(representation: str) -> None:
    near = {"representation": representation, "friction": 0.1, "restitution": 0.5, "shape": Sphere(radius=R)}
    first = RigidObject(name="first", position=(-0.3, 0.0, R), velocity=(1.0, 0.0, 0.0), **near)
    second = RigidObject(name="second", position=(0.0, 0.12, R), **near)
    patch = law("friction_patch", radius=5.0, friction=0.5)
    nowhere = Environment(gravity=(0.0, 0.0, 0.0))
    worlds = [World(objects=(first, second), environment=nowhere, effects=e) for e in ((), (patch,))]
    plain, rubbed = (run(w, 0.5) for w in worlds)
    assert np.linalg.norm(plain.angular_velocities[0, -1, 1]) > 0.1
    np.testing.assert_array_equal(rubbed.velocities, plain.velocities)
    np.testing.assert_array_equal(rubbed.angular_velocities, plain.angular_velocities)


# --- whom they concern, and what they cost ----------------------------------------------------


def test_a_law_acts_only_on_contacts_of_the_objects_it_names() -> None:
    a = ball(position=(-1.0, 0.0, 1.0), velocity=(1.0, 0.0, 0.0))
    b = ball(name="other", position=(1.0, 0.0, 1.0), velocity=(1.0, 0.0, 0.0))
    for representation in KINDS:
        both = [o.model_copy(update={"representation": representation}) for o in (a, b)]
        found = run(bouncing(*both, effects=(law("bounce_friction", ("other",), share=0.5),)), 0.6)
        np.testing.assert_allclose(found.velocities[0, -1, :, 0], [1.0, 0.5], atol=1e-12)


def test_rigid_impacts_beside_deformable_objects_follow_the_law_too() -> None:
    rope = Rope(name="rope", points=((5.0, 0.0, 3.0), (5.5, 0.0, 3.0)), radius=0.01)
    thrown = ball(velocity=(2.0, 0.0, 0.0))
    effects = (law("bounce_friction", ("ball",), share=0.5),)
    world = bouncing(thrown, effects=effects, deformables=(rope,))
    found = run(world, 0.5, samples=11)
    np.testing.assert_allclose(found.velocities[0, -1, 0, 0], 1.0, atol=1e-9)
