"""Pulleys: Atwood's machine, belt friction, bearings, tackles, a swinging load."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld import World
from polyworld.model.rope import threading
from polyworld.solver.energy_sources import masses_of, stored_energy
from polyworld.solver.energy_watch import balance
from tests.verification.rope_world import Array, G, ball, held, rope, run, world

RADIUS = 0.1
DENSITY = 0.01


def atwood(m1: float, m2: float, segments: int = 30, density: float = DENSITY, **pulley: Any) -> World:
    """Two loads on a rope over a wheel at the origin; both begin 1 m below it."""
    loads = [ball("left", [-RADIUS, 0, -1], m1), ball("right", [RADIUS, 0, -1], m2)]
    cord = rope(
        [[-RADIUS, 0, -1], [RADIUS, 0, -1]],
        segments,
        linear_density=density,
        stretch_stiffness=1e5,
        stretch_damping=0.005,
    )
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": RADIUS, "after": 0, **pulley}
    return world(cord, objects=loads, attachments=[held("start", "left"), held("end", "right")], pulleys=[wheel])


def fall(m1: float, m2: float, horizon: float, extra: float = 0.0, push: float = 0.0) -> float:
    """Descent of the right load with the rope's own weight: (m1 + m2 + rho L + extra) x'' = (m2 - m1) g + 2 rho g x
    - push.
    """
    mass = m1 + m2 + DENSITY * (2.0 + np.pi * RADIUS) + extra

    def motion(_: float, y: Array) -> list[float]:
        return [y[1], ((m2 - m1) * G + 2 * DENSITY * G * y[0] - push) / mass]

    solved = solve_ivp(motion, (0.0, horizon), [0.0, 0.0], rtol=1e-9, atol=1e-12)
    return float(solved.y[0, -1])


@pytest.mark.parametrize(("segments", "tolerance"), [(30, 0.005), (15, 0.01)])
def test_atwood_machine(segments: int, tolerance: float) -> None:
    """a = (m2 - m1) g/(m1 + m2) and T = 2 m1 m2 g/(m1 + m2) for a light rope; here with the rope's weight, to 0.5%."""
    m1, m2, horizon = 1.0, 1.5, 0.6
    trajectory, motion = run(atwood(m1, m2, segments), horizon)
    assert -1.0 - trajectory.positions[-1, 1, 2] == pytest.approx(fall(m1, m2, horizon), rel=tolerance)
    assert trajectory.positions[-1, 0, 2] + 1.0 == pytest.approx(fall(m1, m2, horizon), rel=tolerance)
    tension = motion.quantities["tension"][-1]
    acceleration = (m2 - m1) * G / (m1 + m2 + DENSITY * 2.3)
    assert tension[0] == pytest.approx(m1 * (G + acceleration), rel=0.01)
    assert tension[-1] == pytest.approx(m2 * (G - acceleration), rel=0.01)


def test_turning_wheel_counts_with_its_inertia() -> None:
    """(m1 + m2 + I/R^2) a = (m2 - m1) g, to 0.5%."""
    inertia = 0.005
    trajectory, _ = run(atwood(1.0, 1.5, inertia=inertia), 0.6)
    expected = fall(1.0, 1.5, 0.6, extra=inertia / RADIUS**2)
    assert -1.0 - trajectory.positions[-1, 1, 2] == pytest.approx(expected, rel=0.005)


def test_dry_bearing_slows_and_holds() -> None:
    """(m1 + m2 + I/R^2) a = (m2 - m1) g - tau/R while it turns; it does not turn where (m2 - m1) g R < tau."""
    trajectory, _ = run(atwood(1.0, 1.5, bearing_friction=0.2, inertia=0.005), 0.6)
    expected = fall(1.0, 1.5, 0.6, extra=0.5, push=0.2 / RADIUS)
    assert -1.0 - trajectory.positions[-1, 1, 2] == pytest.approx(expected, rel=0.01)
    trajectory, _ = run(atwood(1.0, 1.5, bearing_friction=0.52), 1.0, 0.5)
    assert trajectory.positions[2, 1, 2] == pytest.approx(trajectory.positions[1, 1, 2], abs=1e-6)


def test_viscous_bearing_sets_the_final_speed() -> None:
    """Against the torque b v/R: v = (m2 - m1) g R^2/b at last, to 1%; the rope's weight grows on one side."""
    b = 0.2
    trajectory, _ = run(atwood(1.0, 1.5, bearing_damping=b), 1.2, 0.4)
    drop = -1.0 - trajectory.positions[:, 1, 2]
    final = (0.5 * G + DENSITY * G * (drop[-1] + drop[-2])) * RADIUS**2 / b
    assert (drop[-1] - drop[-2]) / 0.4 == pytest.approx(final, rel=0.01)


def test_belt_friction_follows_euler_and_eytelwein() -> None:
    """T2/T1 = exp(mu pi) while the rope slides over a fixed drum; it holds where m2/m1 is less. To 1%."""
    m1, m2, mu, horizon = 1.0, 1.5, 0.1, 0.6
    trajectory, motion = run(atwood(m1, m2, fixed_wheel=True, friction=mu), horizon)
    ratio = np.exp(mu * np.pi)
    acceleration = (m2 - m1 * ratio) * G / (m2 + m1 * ratio)
    drop = -1.0 - trajectory.positions[-1, 1, 2]
    assert drop == pytest.approx(0.5 * acceleration * horizon**2, rel=0.03)  # the rope's mass: 2%
    tension = motion.quantities["tension"][-1]
    assert tension[-6] / tension[5] == pytest.approx(ratio, rel=0.02)
    trajectory, _ = run(atwood(m1, m2, fixed_wheel=True, friction=0.14), 1.0, 0.5)
    assert trajectory.positions[2, 1, 2] == pytest.approx(trajectory.positions[1, 1, 2], abs=1e-6)


def test_rope_keeps_its_length_as_it_runs_over_a_wheel() -> None:
    """A load falls nearly a metre: the rope runs over the wheel by 15 segments, and stays as long as it was."""
    trajectory, _ = run(atwood(0.5, 1.5), 0.55, 0.05)
    paid_out = -1.0 - trajectory.positions[:, 1, 2]
    taken_in = trajectory.positions[:, 0, 2] + 1.0
    assert paid_out[-1] > 0.7
    # The stretch of 1e5 N under 15 N is 0.3 mm.
    np.testing.assert_allclose(taken_in, paid_out, atol=4e-4)


def tackle(block: float, load: float) -> World:
    """A rope from the ceiling round a movable block's wheel, over a fixed wheel, down to a load."""
    r = RADIUS
    bodies = [ball("block", [0, 0, -1], block), ball("load", [3 * r, 0, -0.6], load)]
    cord = rope(
        [[-r, 0, 0], [r, 0, -0.5], [3 * r, 0, -0.6]],
        45,
        linear_density=0.001,
        stretch_stiffness=1e5,
        stretch_damping=0.002,
    )
    wheels = [
        {
            "name": "movable",
            "rope": "rope",
            "centre": [0, 0, -1],
            "radius": r,
            "after": 0,
            "object": "block",
            "turns_positive": False,
        },
        {"name": "fixed", "rope": "rope", "centre": [2 * r, 0, 0], "radius": r, "after": 1},
    ]
    return world(cord, objects=bodies, attachments=[held("start"), held("end", "load")], pulleys=wheels)


@pytest.mark.parametrize(("block", "load"), [(2.0, 0.8), (2.0, 1.2)])
def test_movable_pulley_halves_the_load(block: float, load: float) -> None:
    """The block moves half as far as the load: a_block = (2 m - M) g/(M + 4 m), T = m (g + 2 a_block), to 1%."""
    horizon = 0.5
    trajectory, motion = run(tackle(block, load), horizon)
    acceleration = (2 * load - block) * G / (block + 4 * load)
    rise = trajectory.positions[-1, 0, 2] + 1.0
    assert rise == pytest.approx(0.5 * acceleration * horizon**2, rel=0.01)
    assert trajectory.positions[-1, 1, 2] + 0.6 == pytest.approx(-acceleration * horizon**2, rel=0.01)
    assert motion.quantities["tension"][-1].mean() == pytest.approx(load * (G - 2 * acceleration), rel=0.01)


def test_movable_pulley_balances_two_to_one() -> None:
    """A block of twice the load stays where it is, within what the rope stretches."""
    trajectory, _ = run(tackle(2.0, 1.0), 1.0)
    assert trajectory.positions[-1, 0, 2] == pytest.approx(-1.0, abs=5e-3)


@pytest.mark.parametrize(("segments", "tolerance"), [(40, 0.01), (20, 0.02)])
def test_swinging_atwood_machine(segments: int, tolerance: float) -> None:
    """(M + m) r'' = m r theta'^2 - M g + m g cos theta, r theta'' + 2 r' theta' + g sin theta = 0 (Tufillaro 1984),
    integrated by SciPy; the rope runs through two eyes, so that the loads hang apart. Places after 1.2 s to 2 cm.
    """
    heavy, light, reach, angle, horizon = 1.2, 1.0, 1.0, 1.2, 1.2

    def motion(_: float, y: Array) -> list[float]:
        r, rate, theta, spin = y
        pull = (light * r * spin**2 - heavy * G + light * G * np.cos(theta)) / (heavy + light)
        return [rate, pull, spin, -(2 * rate * spin + G * np.sin(theta)) / r]

    exact = solve_ivp(motion, (0.0, horizon), [reach, 0.0, angle, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    start = [reach * np.sin(angle), 0.0, -reach * np.cos(angle)]
    cord = rope(
        [start, [0, 0.5, 0], [0, 1, -1]], segments, linear_density=0.002, stretch_stiffness=2e4, stretch_damping=0.002
    )
    bodies = [ball("light", start, light), ball("heavy", [0, 1, -1], heavy)]
    eyes = [{"name": f"eye-{k}", "rope": "rope", "centre": [0, float(k), 0], "radius": 0.0, "after": k} for k in (0, 1)]
    scene = world(cord, objects=bodies, attachments=[held("start", "light"), held("end", "heavy")], pulleys=eyes)
    trajectory, _ = run(scene, horizon)
    place = [exact[0] * np.sin(exact[2]), 0.0, -exact[0] * np.cos(exact[2])]
    np.testing.assert_allclose(trajectory.positions[-1, 0], place, atol=2.0 * tolerance)
    assert trajectory.positions[-1, 1, 2] == pytest.approx(-1.0 - (reach - exact[0]), abs=2.0 * tolerance)


def test_loose_end_runs_off_the_wheel() -> None:
    """A rope with nothing on one side runs off its wheel; then its load falls freely."""
    cord = rope([[-RADIUS, 0, -0.3], [RADIUS, 0, -0.5]], 12, linear_density=0.05, stretch_damping=0.002)
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": RADIUS, "after": 0}
    scene = world(
        cord, objects=[ball("load", [RADIUS, 0, -0.5], 1.0)], attachments=[held("end", "load")], pulleys=[wheel]
    )
    trajectory, motion = run(scene, 1.5, 0.5)
    speeds = trajectory.velocities[:, 0, 2]
    assert speeds[3] - speeds[2] == pytest.approx(-0.5 * G, rel=1e-3)
    assert motion.points[-1, :, 2].max() < 0.0


def test_load_that_comes_to_the_wheel_stops_there() -> None:
    """The heavier load pulls the other up to the wheel, which it does not pass; both then hang still."""
    trajectory, _ = run(atwood(1.0, 1.5), 3.0, 1.5)
    np.testing.assert_allclose(trajectory.positions[1:, 0], [[-RADIUS, 0, 0]] * 2, atol=0.02)
    np.testing.assert_allclose(trajectory.positions[1:, 1], [[RADIUS, 0, -2]] * 2, atol=0.02)
    np.testing.assert_allclose(trajectory.positions[2], trajectory.positions[1], atol=1e-3)


def test_taut_rope_over_a_wheel_stays_at_rest() -> None:
    """Stretched by 5% between two fixed ends it is in equilibrium: tension 0.05 EA, and nothing but its weight moves.

    Its waves need more inner steps from the first one on than loads at rest would.
    """
    around = 2.0 + np.pi * RADIUS
    stiffness = 1e6
    cord = rope([[-RADIUS, 0, -1], [RADIUS, 0, -1]], 20, stretch_stiffness=stiffness, length=around / 1.05)
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, 0], "radius": RADIUS, "after": 0}
    motion = run(world(cord, attachments=[held("start"), held("end")], pulleys=[wheel]), 0.1)[1]
    assert motion.quantities["tension"][-1] == pytest.approx(0.05 * stiffness, rel=1e-3)
    assert np.abs(motion.velocities).max() < 0.005


def test_rope_thrown_off_its_wheel_comes_back_without_gaining_energy() -> None:
    cord = rope([[-0.5, 0, -0.1], [0.5, 0, -0.1]], 20, stretch_stiffness=50.0, velocity=[0, 0, 1.0])
    wheel = {"name": "wheel", "rope": "rope", "centre": [0, 0, -0.05], "radius": RADIUS, "after": 0, "inertia": 1e-4}
    motion = run(world(cord, attachments=[held("start"), held("end")], pulleys=[wheel]), 0.4, 0.005)[1]
    energy = 0.5 * (motion.velocities**2).sum(axis=-1) + G * motion.points[..., 2]
    energy = energy[:, 1:-1].mean(axis=1)
    assert np.ptp(motion.points[:, 10, 2]) > 0.03
    assert energy.max() < energy[0] + 0.1  # of the 0.5 J/kg that it was thrown with


@pytest.mark.parametrize(("count", "strain", "bending"), [(1, 0.06, 0.0), (2, 0.06, 0.0), (3, 0.0, 1.0)])
def test_rope_over_pulleys_gains_no_energy(count: int, strain: float, bending: float) -> None:
    """Two loads on a rope over one to three pulleys: thrown up as it starts stretched, or on a stiff rope."""
    places = {1: [(0.0, 1.0)], 2: [(-0.3, 1.0), (0.3, 1.1)], 3: [(-0.5, 1.0), (0.0, 0.6), (0.5, 1.0)]}[count]
    wheels = [
        {
            "name": f"wheel-{k}",
            "rope": "rope",
            "centre": [x, 0, z],
            "radius": 0.05,
            "after": k,
            "turns_positive": count < 3 or k != 1,
        }
        for k, (x, z) in enumerate(places)
    ]
    between = {1: [], 2: [[0.0, 0, 1.1]], 3: [[-0.25, 0, 0.8], [0.25, 0, 0.8]]}[count]
    points = [[places[0][0] - 0.06, 0, 0.2], *between, [places[-1][0] + 0.06, 0, 0.3]]
    more: dict[str, Any] = {"linear_density": 0.05, "stretch_stiffness": 1e4, "bending_stiffness": bending}
    parts: dict[str, Any] = {
        "objects": [ball("left", points[0], 1.0), ball("right", points[-1], 1.5)],
        "attachments": [held("start", "left"), held("end", "right")],
        "pulleys": wheels,
    }
    scene = world(rope(points, 40, **more), **parts)
    length = float(threading(scene, scene.of_form("line")[0]).rest.sum()) / (1.0 + strain)
    stored = 0.5 * 1e4 * strain**2 * length
    scene = world(rope(points, 40, length=length, **more), **parts)
    kinetic, excess, _ = balance(scene, run(scene, 0.6, 0.01)[0], masses_of(scene))
    gained = excess + stored_energy(scene) - stored
    assert gained.max() < 0.02 * (stored + kinetic.sum(axis=1).max())
