"""Laws with a place, a rhythm or a flow: found where they act, and not named where a plain law does the same."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.recording import Array, Recording, Run
from polyworld.gap import GapReport, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.report import effects_of
from tests.polyworld.gap_scenes import (
    MASS,
    Bouncing,
    G,
    ball_recording,
    ball_world,
    launches,
    puck_recording,
    puck_world,
)

TABLE = puck_world(friction=0.0)
AIR, DRAG = np.array([-4.0, 1.0, 0.0]), 0.05  # [m/s], [kg/m]


def flown(ball: Bouncing, seed: int) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, 5), rng, 0.001, duration=1.0, rate=60.0)


def values(report: GapReport) -> dict[str, float]:
    return {u: x["value"] for e in effects_of(report.verdict.best) for u, x in e["unknowns"].items()}


def test_a_wind_that_blows_is_named() -> None:
    blown = Bouncing(acceleration=lambda _t, _x, v, _w: -DRAG / MASS * np.linalg.norm(v - AIR) * (v - AIR))
    report = find_gap(
        ball_world(), flown(blown, 4), candidates=named(["quadratic_drag", "linear_drag", "wind", "tilt"])
    )
    assert (report.verdict.kind, report.names) == ("identified", ("wind",))
    found = values(report)
    assert np.allclose([found["velocity_x"], found["velocity_y"], found["coefficient"]], [*AIR[:2], DRAG], rtol=0.05)


def test_a_wind_that_is_still_gives_way_to_drag_beside_a_tilt() -> None:
    """Four slides of a puck on a tilted table, in air that drags it by the square of its speed."""
    rng, tilt, times = np.random.default_rng(11), np.array([0.4, -0.3]), np.arange(60) / 60.0

    def slopes(_: float, y: Array) -> Array:
        v = y[2:]
        return np.concatenate([v, tilt - DRAG / 0.2 * np.linalg.norm(v) * v])

    runs = []
    for k in range(4):
        start = [0.0, 0.0, *rng.uniform(-3.0, 3.0, 2)]
        path = solve_ivp(slopes, (0.0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-11).y[:2].T
        places = np.full((60, 1, 3), np.nan)
        places[:, 0, :2] = path + rng.normal(0.0, 1e-3, path.shape)
        runs.append(Run(f"slide{k}", ("puck",), times, places, np.full((60, 1, 4), np.nan)))
    offered = named(["quadratic_drag", "wind", "tilt", "linear_drag", "spring"])
    report = find_gap(TABLE, Recording(tuple(runs)), candidates=offered)
    assert report.verdict.kind == "identified"
    assert set(report.names) == {"tilt", "quadratic_drag"}


def test_a_table_that_shakes_is_found_with_its_rhythm() -> None:
    """Slides without friction at four times of one clock while a = A sin(2 pi f t + phi): twice integrated."""
    amplitude, frequency, phase = np.array([0.24, 0.18]), 1.7, 0.4
    rng, w = np.random.default_rng(1), 2.0 * np.pi * frequency
    runs = []
    for k in range(4):
        times = 0.7 * k + np.arange(80) / 40.0
        swing, speed = -np.sin(w * times + phase) / w**2, -np.cos(w * times[0] + phase) / w
        shift = swing - swing[0] - speed * (times - times[0])
        places = np.full((80, 1, 3), np.nan)
        path = rng.uniform(-0.2, 0.2, 2) + rng.uniform(-0.5, 0.5, 2) * (times - times[0])[:, None]
        places[:, 0, :2] = path + amplitude * shift[:, None] + rng.normal(0.0, 0.001, path.shape)
        runs.append(Run(f"slide{k}", ("puck",), times, places, np.full((80, 1, 4), np.nan)))
    offered = named(["periodic_forcing", "tilt", "spring", "linear_drag"])
    report = find_gap(TABLE, Recording(tuple(runs)), candidates=offered)
    assert (report.verdict.kind, report.names) == ("identified", ("periodic_forcing",))
    assert abs(values(report)["frequency"] - frequency) < 0.05  # a fifth of a cycle in all
    assert report.verdict.after < 1.1


def test_a_rough_patch_of_the_floor_is_found_at_its_place() -> None:
    centre, radius = np.array([0.25, -0.2]), 0.3

    def deceleration(place: Array, _speed: float) -> float:
        return G * (0.3 if np.hypot(*(place - centre)) < radius else 0.1)

    recording = puck_recording(deceleration, np.random.default_rng(5), 0.001, runs=12, duration=0.8, rate=60.0)
    offered = named(["friction_patch", "friction_error", "linear_drag", "tilt"])
    report = find_gap(puck_world(0.1), recording, candidates=offered)
    assert (report.verdict.kind, report.names) == ("identified", ("friction_patch",))
    found = values(report)
    assert np.allclose([found["x"], found["y"], found["radius"]], [*centre, radius], atol=0.02)
    assert abs(found["friction"] - 0.2) < 0.01


@pytest.mark.benchmark
def test_a_tether_that_bends_to_a_pull_of_another_law_is_not_named() -> None:
    """A pull by the cube of the distance, which a tether halves the error of, tenfold above the noise."""
    centre = np.array([0.0, 0.0, 1.0])
    pulled = Bouncing(acceleration=lambda _t, x, _v, _w: -3.0 * np.linalg.norm(x - centre) ** 2 * (x - centre))
    verdict = find_gap(ball_world(), flown(pulled, 4), candidates=named(["tether", "tilt"])).verdict
    assert verdict.kind == "unexplained"
    assert verdict.after < 0.5 * verdict.before
    assert "bends to whatever is left" in verdict.reasons[0]
