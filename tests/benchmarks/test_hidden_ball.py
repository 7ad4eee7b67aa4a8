"""The generator of hidden motions against closed forms."""

# ruff: noqa: ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.hidden_closed_form import base_positions, left_after_refit
from tests.benchmarks.hidden_laws import with_force
from tests.scenes.ball import Ball, Launch, Patch, Plane, fly

TIMES = np.arange(193) / 120.0
BASE = {"radius": 0.1, "friction": 0.3, "restitution": 0.8, "gravity": 9.81}


def test_projectile_flies_a_parabola_and_turns_evenly() -> None:
    path = fly(Ball(), Launch((0.0, 0.0, 20.0), (3.0, -1.0, 2.0), (0.0, 0.0, 7.0)), TIMES)
    expected = np.array([0.0, 0.0, 20.0]) + TIMES[:, None] * [3.0, -1.0, 2.0] - 4.905 * TIMES[:, None] ** 2 * [0, 0, 1]
    np.testing.assert_allclose(path.positions, expected, atol=1e-9)
    np.testing.assert_allclose(path.orientations[:, 3], np.sin(3.5 * TIMES), atol=1e-7)
    assert path.impacts == ()


def test_bounces_come_when_the_geometric_series_says() -> None:
    path = fly(Ball(), Launch((0.0, 0.0, 1.1), (0.0, 0.0, 0.0)), TIMES)
    fall = math.sqrt(2.0 / 9.81)
    expected, t = [], fall
    while t < TIMES[-1]:
        expected.append(t)
        t += 2.0 * fall * 0.8 ** len(expected)
    np.testing.assert_allclose(path.impacts, expected, atol=1e-8)


def test_heights_of_rebounds_fall_by_the_square_of_restitution() -> None:
    times = np.arange(20001) / 10000.0
    heights = fly(Ball(), Launch((0.0, 0.0, 1.1), (0.0, 0.0, 0.0)), times).positions[:, 2] - 0.1
    peaks = heights[1:-1][(heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:])]
    np.testing.assert_allclose(peaks[:2], [0.64, 0.64**2], rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_base_world_moves_as_its_closed_form(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spin = rng.normal(0.0, 15.0, 3)
    launch = Launch((0.0, 0.0, rng.uniform(0.1, 1.5)), tuple(rng.normal(0.0, 2.0, 3)), tuple(spin))
    np.testing.assert_allclose(fly(Ball(), launch, TIMES).positions, base_positions(launch, TIMES, **BASE), atol=1e-6)


def test_sliding_ball_rolls_with_five_sevenths_of_its_speed() -> None:
    path = fly(Ball(friction=0.3), Launch((0.0, 0.0, 0.1), (2.0, 1.0, 0.0)), TIMES)
    np.testing.assert_allclose(path.velocities[-1], [10.0 / 7.0, 5.0 / 7.0, 0.0], atol=2e-5)
    np.testing.assert_allclose(path.spins[-1], [-50.0 / 7.0, 100.0 / 7.0, 0.0], atol=2e-4)
    np.testing.assert_allclose(
        path.positions, base_positions(Launch((0.0, 0.0, 0.1), (2.0, 1.0, 0.0)), TIMES, **BASE), atol=1e-5
    )


def test_linear_drag_decays_exponentially() -> None:
    ball = with_force(Ball(gravity=(0.0, 0.0, 0.0)), lambda t, x, v, w: -0.3 * v)
    path = fly(ball, Launch((0.0, 0.0, 5.0), (4.0, 0.0, 0.0)), TIMES)
    np.testing.assert_allclose(path.velocities[:, 0], 4.0 * np.exp(-0.6 * TIMES), rtol=1e-7)


def test_quadratic_drag_reaches_its_terminal_speed_by_the_hyperbolic_tangent() -> None:
    ball = with_force(Ball(), lambda t, x, v, w: -0.5 * np.linalg.norm(v) * v)
    path = fly(ball, Launch((0.0, 0.0, 50.0), (0.0, 0.0, 0.0)), TIMES)
    terminal = math.sqrt(0.5 * 9.81 / 0.5)
    np.testing.assert_allclose(path.velocities[:, 2], -terminal * np.tanh(9.81 * TIMES / terminal), rtol=1e-6)


def test_magnus_force_bends_the_path_into_a_circle() -> None:
    ball = with_force(Ball(gravity=(0.0, 0.0, 0.0)), lambda t, x, v, w: 0.1 * np.cross(w, v))
    path = fly(ball, Launch((0.0, 0.0, 5.0), (2.0, 0.0, 0.0), (0.0, 0.0, 10.0)), TIMES)
    rate = 0.1 * 10.0 / 0.5
    np.testing.assert_allclose(path.positions[:, 0], 2.0 / rate * np.sin(rate * TIMES), atol=1e-7)
    np.testing.assert_allclose(path.positions[:, 1], 2.0 / rate * (1.0 - np.cos(rate * TIMES)), atol=1e-7)


def test_garwin_impact_returns_the_tangential_velocity_of_the_touching_point() -> None:
    launch = Launch((0.0, 0.0, 0.6), (1.0, -2.0, 0.0), (3.0, 5.0, 1.0))
    path = fly(Ball(tangential=0.6), launch, TIMES[:60])
    before = np.array([1.0 - 0.1 * 5.0, -2.0 + 0.1 * 3.0])
    v, w = path.velocities[-1], path.spins[-1]
    np.testing.assert_allclose([v[0] - 0.1 * w[1], v[1] + 0.1 * w[0]], -0.6 * before, atol=1e-9)
    # The moment about the touching point is kept: m r v + I w.
    kept = 0.5 * 0.1 * v[:2] + 0.4 * 0.5 * 0.01 * np.array([w[1], -w[0]])
    np.testing.assert_allclose(kept, 0.5 * 0.1 * np.array([1.0, -2.0]) + 0.002 * np.array([5.0, -3.0]), atol=1e-12)


def test_impulse_on_a_steep_impact_sticks_and_on_a_flat_one_slides() -> None:
    slow = fly(Ball(friction=0.3), Launch((0.0, 0.0, 0.6), (0.5, 0.0, 0.0)), TIMES[:60])
    assert slow.velocities[-1, 0] == pytest.approx(5.0 / 7.0 * 0.5, abs=1e-9)
    fast = fly(Ball(friction=0.1), Launch((0.0, 0.0, 0.6), (5.0, 0.0, 0.0)), TIMES[:60])
    assert fast.velocities[-1, 0] == pytest.approx(5.0 - 0.1 * 1.8 * math.sqrt(2 * 9.81 * 0.5), abs=1e-9)


def test_rolling_resistance_decelerates_by_its_arm() -> None:
    roll = Launch((0.0, 0.0, 0.1), (2.0, 0.0, 0.0), (0.0, 20.0, 0.0))
    path = fly(Ball(rolling=0.002), roll, TIMES)
    rate = 0.002 * 9.81 / (0.1 * 1.4)  # b g / (r (1 + 2/5)): the moment turns the ball about the touching point
    np.testing.assert_allclose(path.velocities[:, 0], 2.0 - rate * TIMES, atol=1e-5)


def test_ball_rolling_uphill_comes_to_rest_where_energy_says() -> None:
    roll = Launch((0.0, 0.0, 0.1), (0.1, 0.0, 0.0), (0.0, 1.0, 0.0))
    path = fly(Ball(rolling=0.002), roll, TIMES)
    rate = 0.002 * 9.81 / 0.14
    assert path.positions[-1, 0] == pytest.approx(0.1**2 / (2.0 * rate), rel=1e-3)
    assert np.linalg.norm(path.velocities[-1]) < 1e-4


def test_ball_that_has_stopped_rolling_spins_on_about_the_vertical() -> None:
    roll = Launch((0.0, 0.0, 0.1), (0.1, 0.0, 0.0), (0.0, 1.0, 3.0))
    path = fly(Ball(rolling=0.002), roll, TIMES)
    assert np.linalg.norm(path.velocities[-1]) < 1e-4
    late = len(TIMES) // 10
    (a, *u), (b, *v) = path.orientations[-1 - late], path.orientations[-1]
    between = 2.0 * math.acos(min(abs(a * b + float(np.dot(u, v))), 1.0))
    assert between == pytest.approx(3.0 * (TIMES[-1] - TIMES[-1 - late]), rel=1e-6)


def test_patch_acts_inside_its_edge_only() -> None:
    ball = Ball(friction=0.0, patches=(Patch(1.0, 0.0, 0.25, 0.2),))
    path = fly(ball, Launch((0.0, 0.0, 0.1), (4.0, 0.0, 0.0), (0.0, -50.0, 0.0)), TIMES)
    v_out = math.sqrt(16.0 - 2.0 * 0.2 * 9.81 * 0.5)
    assert path.velocities[-1, 0] == pytest.approx(v_out, abs=1e-6)


def test_wall_returns_the_ball() -> None:
    wall = Plane((-1.0, 0.0, 0.0), -2.0)
    ball = replace(Ball(friction=0.0), planes=(Plane(), wall))
    path = fly(ball, Launch((0.0, 0.0, 30.0), (2.0, 0.0, 0.0)), TIMES)
    assert path.impacts == (pytest.approx(0.95),)
    assert path.velocities[-1, 0] == pytest.approx(-1.6)


def test_gravity_error_of_free_flight_alone_is_left_as_a_parabola_less_its_line() -> None:
    launch = Launch((0.0, 0.0, 30.0), (2.0, 0.0, 1.0))
    seen = base_positions(launch, TIMES, **(BASE | {"gravity": 9.91}))
    t = TIMES / TIMES[-1]
    line = np.polyval(np.polyfit(t, t**2, 1), t)
    left = 0.05 * TIMES[-1] ** 2 * (t**2 - line)
    assert left_after_refit(seen, launch, TIMES, **BASE) == pytest.approx(np.mean(left**2) / 3.0, rel=1e-6)


def imported(source: Path) -> set[str]:
    """Modules that a source file imports."""
    nodes = list(ast.walk(ast.parse(source.read_text())))
    names = {a.name for n in nodes if isinstance(n, ast.Import) for a in n.names}
    return names | {n.module for n in nodes if isinstance(n, ast.ImportFrom) and n.module}


def test_generator_imports_nothing_of_the_project() -> None:
    root = Path(__file__).parents[2]
    waiting = ["tests.benchmarks.hidden_generate", "tests.benchmarks.hidden_disc_cases"]
    seen: set[str] = set()
    while waiting:
        module = waiting.pop()
        names = imported(root / f"{module.replace('.', '/')}.py")
        tops = {n.split(".")[0] for n in names}
        assert not tops & {"polyworld", "atw_mcp", "evidence_store", "prompts", "warp"}, module
        seen.add(module)
        own = {n for n in names if n.startswith("tests.")}
        waiting += sorted(own - seen - set(waiting))
    assert "tests.scenes.ball" in seen
