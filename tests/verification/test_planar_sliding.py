"""Free motion, damping and sliding friction of the planar solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.solver.rollout import simulator
from polyworld.world import Effect, MotionPlane, World
from polyworld.world.shapes import Box, Cylinder, Sphere
from tests.verification.planar_scenes import G, body, disc, run, side_view, top_view


def test_free_fall_holds_at_every_sample() -> None:
    """x = x0 + v0 t - g t^2 / 2; tolerance: rounding of 2,500 additions of numbers near 100."""
    fall = run(side_view(body("ball", Sphere(radius=0.1), (0.0, 0.0, 200.0), velocity=(3.0, 0.0, 2.0))), 5.0)
    t = fall.times[0]
    np.testing.assert_allclose(fall.positions[0, :, 0, 2], 200.0 + 2.0 * t - 0.5 * G * t**2, atol=1e-11)
    np.testing.assert_allclose(fall.positions[0, :, 0, 0], 3.0 * t, atol=1e-11)
    np.testing.assert_allclose(fall.velocities[0, :, 0, 2], 2.0 - G * t, atol=1e-11)


@pytest.mark.parametrize("substep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize(("mu", "speed"), [(0.5, 3.0), (0.1, 1.0)])
def test_slide_on_a_table_ends_after_v2_over_2_mu_g(mu: float, speed: float, substep: float) -> None:
    """Coulomb: length v^2 / 2 mu g, time v / mu g; 1e-9 m, and at rest to the bit afterwards."""
    thrown = body("disc", disc(), (0.0, 0.0, 0.2), velocity=(0.6 * speed, 0.8 * speed, 0.0), friction=mu)
    slide = run(top_view(thrown, substep=substep), 2.0)
    length = np.linalg.norm(slide.positions[0, -1, 0, :2])
    assert length == pytest.approx(speed**2 / (2 * mu * G), abs=1e-9)
    stopped = slide.times[0] > speed / (mu * G) + substep
    assert np.all(slide.velocities[0, stopped] == 0.0)
    assert np.all(slide.positions[0, stopped] == slide.positions[0, -1])


def test_box_slides_on_a_floor_seen_from_the_side() -> None:
    """The same length where friction acts at two contact points and not on the motion plane: 1e-6 m."""
    mu, speed = 0.5, 3.0
    box = body("box", Box(half_extents=(0.3, 0.2, 0.1)), (0.0, 0.0, 0.1), velocity=(speed, 0.0, 0.0), friction=mu)
    slide = run(side_view(box), 2.0)
    assert slide.positions[0, -1, 0, 0] == pytest.approx(speed**2 / (2 * mu * G), abs=1e-5)
    np.testing.assert_allclose(slide.positions[0, :, 0, 2], 0.1, atol=1e-6)


@pytest.mark.parametrize("view", ["side", "top"])
def test_below_the_critical_slope_nothing_creeps(view: str) -> None:
    """tan(theta) = 0.9 mu for 2 s: no motion to the last bit the position has (1e-12 m)."""
    mu = 0.5
    slope = float(np.arctan(0.9 * mu))
    run_ = run(_on_slope(view, slope, mu), 2.0)
    moved = np.linalg.norm(run_.positions[0, :, 0] - run_.positions[0, 0, 0], axis=-1)
    assert moved.max() < 1e-12


@pytest.mark.parametrize("view", ["side", "top"])
def test_above_the_critical_slope_it_slides_as_coulomb_says(view: str) -> None:
    """tan(theta) = 1.1 mu: a = g (sin - mu cos), distance a t^2 / 2 after 2 s; relative 1e-6."""
    mu = 0.5
    slope = float(np.arctan(1.1 * mu))
    run_ = run(_on_slope(view, slope, mu), 2.0)
    distance = np.linalg.norm(run_.positions[0, -1, 0] - run_.positions[0, 0, 0])
    assert distance == pytest.approx(0.5 * G * (np.sin(slope) - mu * np.cos(slope)) * 4.0, rel=1e-6)


def _on_slope(view: str, slope: float, mu: float) -> World:
    if view == "side":
        return side_view(body("box", Box(half_extents=(0.3, 0.2, 0.1)), (0.0, 0.0, 0.1), friction=mu), slope=slope)
    tilted = MotionPlane(normal=(float(np.sin(slope)), 0.0, float(np.cos(slope))))
    return top_view(body("box", Box(half_extents=(0.2, 0.2, 0.2)), (0.0, 0.0, 0.2), friction=mu), motion_plane=tilted)


def test_the_plane_may_have_its_own_friction() -> None:
    """Coefficient of a pair: the geometric mean, here sqrt(0.2 x 0.8) = 0.4."""
    thrown = body("disc", disc(), (0.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0), friction=0.2)
    slide = run(top_view(thrown, motion_plane=MotionPlane(friction=0.8)), 1.0)
    assert slide.positions[0, -1, 0, 0] == pytest.approx(4.0 / (2 * 0.4 * G), abs=1e-9)


def test_a_spinning_disc_stops_when_the_moment_has_used_up_its_spin() -> None:
    """Uniform pressure: M = 2/3 mu m g R, I = m R^2 / 2, so t = 3 R omega / 4 mu g; one sample of 1 ms."""
    radius, mu, omega = 0.2, 0.3, 20.0
    spin = body("disc", disc(radius), (0.0, 0.0, 0.2), angular_velocity=(0.0, 0.0, omega), friction=mu)
    motion = run(top_view(spin), 2.0, interval=0.001)
    expected = 3 * radius * omega / (4 * mu * G)
    rate = motion.angular_velocities[0, :, 0, 2]
    stop = motion.times[0][np.argmax(rate == 0.0)]
    assert stop == pytest.approx(expected, abs=0.002)
    deceleration = omega / expected
    early = motion.times[0] < expected - 0.002
    np.testing.assert_allclose(rate[early], omega - deceleration * motion.times[0][early], atol=1e-9)


@pytest.mark.parametrize("substep", [0.001, 0.004])
def test_sliding_and_spinning_together_follow_the_limit_surface(substep: float) -> None:
    """d(v, omega)/dt on the elliptic limit surface, integrated by SciPy's DOP853: 1e-5 m and 1e-4 rad."""
    mu, r = 0.3, 2.0 / 3.0 * 0.2
    k = r**2 / (0.5 * 0.2**2)  # m r^2 / I
    v0, omega0 = 1.5, 12.0

    def rate(_: float, y: np.ndarray) -> list[float]:
        sigma = float(np.hypot(np.hypot(y[2], y[3]), r * y[5])) + 1e-300
        c = mu * G / sigma
        return [y[2], y[3], -c * y[2], -c * y[3], y[5], -c * k * y[5]]

    def nearly_at_rest(_: float, y: np.ndarray) -> float:
        return float(np.hypot(y[2], r * y[5])) - 1e-3

    nearly_at_rest.terminal = True
    reference = solve_ivp(
        rate,
        (0.0, 3.0),
        [0.0, 0.0, v0, 0.0, 0.0, omega0],
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
        events=nearly_at_rest,
        dense_output=True,
    )
    thrown = body(
        "disc",
        disc(0.2),
        (0.0, 0.0, 0.2),
        velocity=(v0, 0.0, 0.0),
        angular_velocity=(0.0, 0.0, omega0),
        friction=mu,
    )
    motion = run(top_view(thrown, substep=substep), 2.0)
    t = motion.times[0]
    known = t < reference.t[-1]
    y = reference.sol(t[known])
    np.testing.assert_allclose(motion.positions[0, known, 0, 0], y[0], atol=1e-5)
    np.testing.assert_allclose(motion.angular_velocities[0, known, 0, 2], y[5], atol=1e-2 * substep / 0.004)
    assert np.all(motion.velocities[0, t > reference.t[-1] + 0.02] == 0.0)


def test_damping_is_the_exact_exponential() -> None:
    """v = v0 exp(-c t), x = v0 (1 - exp(-c t)) / c, and terminal speed g / c; rounding only."""
    c, spin = 0.7, 1.3
    thrown = body(
        "ball",
        Cylinder(radius=0.1, half_height=0.1),
        (0.0, 0.0, 0.1),
        velocity=(2.0, 0.0, 0.0),
        angular_velocity=(0.0, 0.0, 5.0),
        linear_damping=c,
        angular_damping=spin,
    )
    motion = run(top_view(thrown), 3.0)
    t = motion.times[0]
    np.testing.assert_allclose(motion.velocities[0, :, 0, 0], 2.0 * np.exp(-c * t), rtol=1e-11)
    np.testing.assert_allclose(motion.positions[0, :, 0, 0], 2.0 * (1 - np.exp(-c * t)) / c, rtol=1e-11, atol=1e-15)
    np.testing.assert_allclose(motion.angular_velocities[0, :, 0, 2], 5.0 * np.exp(-spin * t), rtol=1e-11)
    falling = run(side_view(body("ball", Sphere(radius=0.1), (0.0, 0.0, 500.0), linear_damping=c)), 20.0, 0.1)
    t = falling.times[0]
    np.testing.assert_allclose(falling.velocities[0, :, 0, 2], -G / c * (1 - np.exp(-c * t)), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(("shape", "gyration"), [("ball", 0.4), ("disc", 0.5)])
def test_a_ball_and_a_disc_roll_down_an_incline(shape: str, gyration: float) -> None:
    """a = g sin(theta) / (1 + k), k = I / m r^2: 2/5 for a ball, 1/2 for a disc; relative 1e-6."""
    slope = 0.2
    solid = Sphere(radius=0.1) if shape == "ball" else Cylinder(radius=0.1, half_height=0.05)
    # A cylinder's axis is body z: turned by 90 degrees about x it lies along the side view's normal.
    turn = (1.0, 0.0, 0.0, 0.0) if shape == "ball" else (float(np.sqrt(0.5)), float(np.sqrt(0.5)), 0.0, 0.0)
    world = side_view(body("wheel", solid, (0.0, 0.0, 0.1), orientation=turn, friction=0.6), slope=slope)
    rolled = run(world, 2.0)
    acceleration = G * np.sin(slope) / (1 + gyration)
    assert rolled.positions[0, -1, 0, 0] == pytest.approx(0.5 * acceleration * 4.0, rel=1e-6)
    # Rolling: v = omega r; about world y, a wheel that goes to +x turns by the right-hand rule forwards.
    np.testing.assert_allclose(rolled.angular_velocities[0, :, 0, 1], rolled.velocities[0, :, 0, 0] / 0.1, atol=1e-6)


def test_rolling_resistance_stops_a_ball() -> None:
    """Moment b N on a rolling ball: v' = -(b g / r) / (1 + k), length v^2 (1 + k) r / (2 b g); relative 1e-4."""
    lever, radius, speed = 0.005, 0.1, 1.0
    ball = body(
        "ball",
        Sphere(radius=radius),
        (0.0, 0.0, radius),
        velocity=(speed, 0.0, 0.0),
        angular_velocity=(0.0, speed / radius, 0.0),
        friction=0.8,
        rolling_resistance=lever,
    )
    rolled = run(side_view(ball), 6.0)
    expected = speed**2 * 1.4 * radius / (2 * lever * G)
    assert rolled.positions[0, -1, 0, 0] == pytest.approx(expected, rel=1e-4)
    assert np.all(np.abs(rolled.velocities[0, -1, 0]) < 1e-12)


@pytest.mark.parametrize("share", [0.0, 0.3, 3.0])
def test_where_a_disc_comes_to_rest_depends_on_its_start_without_jumps(share: float) -> None:
    """Steps of 17 ms, in which a slow disc stops at once or after a few. Without spin the way is v^2 / 2 mu g, 1e-12 m;
    with r omega = share v it is as SciPy's, 4e-5 m, and differs for neighbours as theirs does, 1e-6 m."""
    mu, radius, step = 0.15, 0.1, 1.0 / 60.0
    r = 2.0 / 3.0 * radius
    speeds = np.linspace(0.002, 0.3, 1200)
    thrown = body("disc", disc(radius), (0.0, 0.0, 0.2), friction=mu)
    times = np.linspace(0.0, 1.0, 61)
    rolled = simulator(top_view(thrown, substep=step), times, n_worlds=len(speeds)).run(
        {"objects.disc.velocity.x": speeds, "objects.disc.angular_velocity.z": share * speeds / r}
    )
    ways = rolled.positions[:, -1, 0, 0]
    if share == 0.0:
        np.testing.assert_allclose(ways, speeds**2 / (2 * mu * G), atol=1e-12)
        return
    # In units of v^2 / mu g and v / mu g all these motions are one.
    k = r**2 / (0.5 * radius**2)

    def rate(_: float, y: np.ndarray) -> list[float]:
        sigma = float(np.hypot(y[1], y[2])) + 1e-300
        return [y[1], -y[1] / sigma, -k * y[2] / sigma]

    def at_rest(_: float, y: np.ndarray) -> float:
        return float(np.hypot(y[1], y[2])) - 1e-4

    at_rest.terminal = True
    end = solve_ivp(rate, (0.0, 10.0), [0.0, 1.0, share], rtol=1e-9, atol=1e-11, events=at_rest).y[0, -1]
    exact = end * speeds**2 / (mu * G)
    np.testing.assert_allclose(ways, exact, atol=4e-5)
    np.testing.assert_allclose(np.diff(ways), np.diff(exact), atol=1e-6)


@pytest.mark.parametrize("push", [1.0, 1.4, 1.47])
def test_where_a_disc_stops_that_slides_uphill_depends_on_its_start_without_jumps(push: float) -> None:
    """Pushed back by less than friction, 1.4715 m/s^2, holds; steps of 17 ms: v^2 / 2 (p + mu g) to 1e-9 m."""
    speeds = np.linspace(0.002, 0.5, 1200)
    thrown = body("disc", disc(0.1), (0.0, 0.0, 0.2), friction=0.15)
    pushed = top_view(thrown, substep=1.0 / 60.0).model_copy(
        update={"effects": (Effect(name="push", kind="uniform_acceleration", parameters={"x": -push}),)}
    )
    rolled = simulator(pushed, np.linspace(0.0, 0.5, 31), n_worlds=len(speeds)).run({"objects.disc.velocity.x": speeds})
    exact = speeds**2 / (2.0 * (push + 0.15 * G))
    np.testing.assert_allclose(rolled.positions[:, -1, 0, 0], exact, atol=1e-9)
