"""The generator against closed forms: friction of 0.3 on the floor, and frictionless discs that keep 0.64."""

import math
from pathlib import Path

import numpy as np
import pytest

from .draw import FAMILIES, scenes
from .engines import ENGINES, Body, World
from .write import write

SURFACES, G = {"wood": (0.5, 0.8), "floor": (0.6, 0.9), "ice": (1e-6, 0.8)}, 0.3 * 9.81


def run(engine: str, kind: str, material: str, *moving: tuple[float, float, float], **law: float) -> np.ndarray:
    """Positions along x, 100 a second for 3 s, of bodies given by mass, place and speed."""
    size, still = {"sphere": (0.2,), "box": (0.2,) * 3, "cylinder": (0.2, 0.2)}[kind], np.eye(3)
    rows = [(f"b{i}", material, kind, size, m, x * still[0] + 0.2 * still[2], v) for i, (m, x, v) in enumerate(moving)]
    bodies = tuple(Body(*row[:6], velocity=row[6] * still[0], drag=0.25) for row in rows)
    return ENGINES[engine](World(bodies, SURFACES, **law), 100, 301)[0][..., 0]


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_impulses_and_rolling(engine: str) -> None:
    assert run(engine, "box", "wood", (3, 0, 4))[-1, 0] == pytest.approx(16 / (2 * G), rel=5e-3)
    speeds = np.diff(run(engine, "cylinder", "ice", (3, 0, 3), (6, 1, 0))[::100], axis=0)[-1]
    assert speeds @ [3, 6] == pytest.approx(9, rel=5e-3)
    assert speeds[1] - speeds[0] == pytest.approx(0.64 * 3, rel=0.06)
    if engine != "planar":
        x = run(engine, "sphere", "wood", (3, 0, 4))[:, 0]
        assert [x[40] - x[30], x[-1] - x[-11]] == pytest.approx([0.4 - 0.035 * G, 0.4 * 5 / 7], rel=5e-3)


def test_resistance_beside_coulomb() -> None:
    film, air = 10 * 0.16 / 3, 0.5 * 5 * 0.25 / 3
    stops = [run("planar", "box", "wood", (3, 0, 4), **law)[-1, 0] for law in ({"linear": 10}, {"medium": 5})]
    closed = [4 / film - G / film**2 * math.log(1 + 4 * film / G), math.log(1 + 16 * air / G) / (2 * air)]
    assert stops == pytest.approx(closed, rel=2e-3)


@pytest.mark.benchmark
@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_gives_the_same_bytes(family: str, tmp_path: Path) -> None:
    for part in "ab":
        write(scenes(family, 0), tmp_path / part)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()
