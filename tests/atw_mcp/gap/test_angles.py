"""A gap of measured angles is stated in radians."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.atw_mcp.session import Session

LENGTH, RADIUS, NOISE = 1.2, 0.03, 0.002  # [m], [m], [rad]


def test_noise_and_gap_of_angles_are_in_radians(tmp_path: Path) -> None:
    # A damped pendulum, of which the world knows no damping.
    equivalent = LENGTH + 0.4 * RADIUS**2 / LENGTH
    times = np.arange(0.0, 4.0, 0.02)
    swing = solve_ivp(
        lambda _, y: [y[1], -9.81 / equivalent * math.sin(y[0]) - 0.05 * y[1]], (0.0, 4.0), [0.6, 0.0], t_eval=times,
        rtol=1e-9,
    )  # fmt: skip
    measured = swing.y[0] + NOISE * np.random.default_rng(1).normal(size=len(times))
    path = tmp_path / "swing.csv"
    path.write_text("t,theta\n" + "".join(f"{t:.4f},{a:.6f}\n" for t, a in zip(times, measured, strict=True)))
    session = Session(tmp_path / "atw.db")
    case = session("OpenCase", data=str(path))["case"]
    bob = {"name": "bob", "shape": {"kind": "sphere", "radius": RADIUS}, "mass": 1.0, "position": [0, 0, 2 - LENGTH]}
    hinge = {"part": "hinge", "name": "hinge", "object": "bob", "anchor": [0, 0, 2], "axis": [0, 1, 0]}
    session("BuildWorld", case=case, objects=[bob], parts=[hinge], floor="none")
    imported = session("ImportObservation", case=case, kind="recording", path=str(path))
    assert "run run" not in imported["summary"]
    found = session("FindDiscrepancy", case=case, patience_seconds=300)
    assert found["data"]["unit"] == "rad"
    assert found["data"]["noise"] == pytest.approx(NOISE, rel=0.15)  # 200 rows: 5% twice over
    assert "run run" not in found["summary"]
    assert "inf" not in found["summary"]
