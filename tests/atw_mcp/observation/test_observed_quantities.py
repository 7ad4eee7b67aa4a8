"""Velocity, energy and period that follow from measured places, through the tools."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.atw_mcp.session import Session

G, SIGMA, STEP = 9.81, 0.002, 0.02


def opened(session: Session, path: Path, place: Callable[[float], tuple[float, float, float]], count: int) -> str:
    """A case of one measured ball of 0.05 m."""
    rng = np.random.default_rng(4)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "object", "x", "y", "z"])
        for k in range(count):
            writer.writerow([k * STEP, "ball", *(np.array(place(k * STEP)) + SIGMA * rng.normal(size=3)).tolist()])
    case = session("OpenCase", data=str(path))["case"]
    session("ImportObservation", case=case, kind="tracks", path=str(path), position_sigma=SIGMA)
    return str(case)


def test_a_measured_swing_has_a_period_with_an_interval(session: Session, tmp_path: Path) -> None:
    case = opened(session, tmp_path / "a.csv", lambda t: (0.1 * np.cos(2.0 * np.pi * t / 1.2), 0.0, 1.0), 200)
    answer = session("InspectObservedMotion", case=case, object="ball", quantities=["speed", "period"])
    (found,) = answer["data"]["derived"]["period"].values()
    assert found["from"] - 0.005 < 1.2 < found["to"] + 0.005
    assert found["cycles"] >= 2.5
    assert "period of x" in answer["summary"]
    assert len(answer["data"]["derived"]["rows"]) == 24


def test_measured_flight_has_g_and_its_energy_within_the_intervals(session: Session, tmp_path: Path) -> None:
    case = opened(session, tmp_path / "b.csv", lambda t: (t, 0.0, 2.0 + 2.0 * t - 0.5 * G * t * t), 40)
    wanted = ["acceleration", "energy", "momentum"]
    refusal = session.refused("InspectObservedMotion", case=case, object="ball", quantities=wanted)
    assert "momentum, energy of 'ball' needs the mass" in refusal
    session(
        "BuildWorld", case=case, objects=[{"name": "ball", "shape": {"kind": "sphere", "radius": 0.05}, "mass": 0.3}]
    )
    answer = session("InspectObservedMotion", case=case, object="ball", quantities=wanted, limit=500)
    derived = answer["data"]["derived"]
    table = {name: [row[i] for row in derived["rows"]] for i, name in enumerate(derived["columns"])}
    whole = 0.5 * 0.3 * 5.0 + 0.3 * G * 2.0
    for name, expected in (("az", -G), ("px", 0.3), ("energy", whole)):
        inside = [low <= expected <= high for _, low, high in table[name]]
        assert np.mean(inside) > 0.7, name  # neighbouring samples share most of their window
    assert derived["mass"] == pytest.approx(0.3)


def test_too_few_places_are_refused(session: Session, tmp_path: Path) -> None:
    case = opened(session, tmp_path / "c.csv", lambda t: (t, 0.0, 1.0), 4)
    assert "needs at least 5" in session.refused(
        "InspectObservedMotion", case=case, object="ball", quantities=["speed"]
    )
