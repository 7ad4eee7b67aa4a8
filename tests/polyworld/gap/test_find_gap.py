"""The gap names what is missing, on motion that SciPy integrates, and on flights that cameras measured."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.data.recording_csv import read_recording
from polyworld.gap import find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.report import effects_of
from polyworld.world import World

Array = NDArray[np.float64]

FLIGHTS = Path(__file__).resolve().parents[4] / "shared" / "data" / "flights" / "tt8spinarc.csv"
MASS, DRAG, NOISE = 0.0027, 4e-4, 0.01  # a table tennis ball: [kg], [kg/m]; noise over the range of motion
TIMES = np.arange(60) / 60.0
WALL, RESTITUTION = 1.2, 0.7  # the wall's distance along x [m]


def thrown(drag: float, wall: float | None = None, seed: int = 1) -> Recording:
    """Six throws through air, of speeds that differ fourfold, which bounce off a wall across x where there is one."""
    rng = np.random.default_rng(seed)
    paths = []
    for k in range(6):
        speed, heading = rng.uniform(2.0, 9.0), rng.uniform(-0.5, 0.5) if wall else rng.uniform(-np.pi, np.pi)
        velocity = [speed * np.cos(heading), speed * np.sin(heading), rng.uniform(1.0, 4.0)]
        paths.append(_path(np.array([*rng.uniform(-0.4, 0.4, 2), 1.0 + 0.1 * k, *velocity]), drag, wall))
    extent = max(float(np.ptp(p, axis=0).max()) for p in paths)
    return _recorded([p + rng.normal(0.0, NOISE * extent, p.shape) for p in paths])


def _path(start: Array, drag: float, wall: float | None) -> Array:
    def rate(_: float, y: Array) -> Array:
        pull = np.array([0.0, 0.0, -9.81]) - drag / MASS * np.linalg.norm(y[3:]) * y[3:]
        return np.concatenate([y[3:], pull])

    def gap(_: float, y: Array) -> float:
        return 1.0 if wall is None else float(wall - 0.02 - y[0])

    gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
    whole = {"rtol": 1e-9, "atol": 1e-10, "dense_output": True}
    found = solve_ivp(rate, (0.0, 1.0), start, events=gap, **whole)
    places: Array = found.sol(TIMES)[:3].T
    if found.status == 1:
        hit, at = float(found.t[-1]), found.y[:, -1] * [1.0, 1.0, 1.0, -RESTITUTION, 1.0, 1.0]
        places[hit < TIMES] = solve_ivp(rate, (hit, 1.0), at, **whole).sol(TIMES[hit < TIMES])[:3].T
    return places


def _recorded(paths: list[Array]) -> Recording:
    turns = np.full((len(TIMES), 1, 4), np.nan)
    return Recording(tuple(Run(f"throw {k}", ("ball",), TIMES, p[:, None], turns) for k, p in enumerate(paths)))


def ball_world(rate: float = 60.0) -> World:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "mass": MASS, "position": [0, 0, 1]}
    return World.model_validate({"objects": [ball], "time": {"seconds_per_frame": 1.0 / rate}})


def test_a_hidden_wall_is_found_at_its_place() -> None:
    report = find_gap(ball_world(), thrown(0.0, WALL), candidates=named(["quadratic_drag", "hidden_wall", "tether"]))
    assert (report.verdict.kind, report.names) == ("identified", ("hidden_wall",))
    found = {u: x["value"] for e in effects_of(report.verdict.best) for u, x in e["unknowns"].items()}
    assert found["offset"] == pytest.approx(WALL, abs=0.02)


@pytest.mark.benchmark
@pytest.mark.skipif(not FLIGHTS.exists(), reason=f"{FLIGHTS} is absent: data kept beside the project")
def test_a_fan_is_never_named_on_flights_with_measured_spins() -> None:
    world = ball_world(143.0)
    report = find_gap(world, read_recording(FLIGHTS, world=world))
    answers = [report.verdict.best, *report.verdict.competitors]
    assert not any("fan" in f.hypothesis.names for f in answers)
    assert "quadratic_drag" in report.names
    drag = next(e for e in effects_of(report.verdict.best) if e["name"] == "quadratic_drag")
    assert 0.14 < drag["unknowns"]["coefficient"]["value"] / MASS < 0.16
