"""Cloth in air against the closed forms of quadratic drag."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld import World, rollout
from polyworld.trajectory import Trajectory

DENSITY, G, AIR = 0.2, 9.81, 1.2


def centre(edge_v: tuple[float, float, float], seconds: float, **environment: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times and velocity of the centre of a square metre of cloth that starts at rest."""
    trajectory = fallen(edge_v, seconds, **environment)
    return trajectory.times, trajectory.velocities[:, 0]


def fallen(edge_v: tuple[float, float, float], seconds: float, **environment: Any) -> Trajectory:
    """The motion of that cloth."""
    world = World.model_validate(
        {
            "deformables": [
                {
                    "name": "cloth",
                    "representation": "cloth",
                    "geometry": {
                        "kind": "sheet",
                        "corner": (0.0, 0.0, 0.0),
                        "edge_u": (1.0, 0.0, 0.0),
                        "edge_v": edge_v,
                        "divisions": (5, 5),
                    },
                    "areal_density": DENSITY,
                    "drag_normal": 1.2,
                    "drag_tangential": 0.05,
                    "self_contact": False,
                }
            ],
            "environment": {"gravity": (0.0, 0.0, -G), "air_density": AIR, **environment},
        }
    )
    return rollout(world, seconds, sample_interval=seconds / 20).trajectory


@pytest.mark.parametrize(("edge_v", "coefficient"), [((0.0, 1.0, 0.0), 1.2), ((0.0, 0.0, 1.0), 0.05)])
def test_falling_sheet_approaches_its_terminal_speed(edge_v: tuple[float, float, float], coefficient: float) -> None:
    """Flat: u = u_t tanh(g t / u_t), u_t = sqrt(2 rho g / (rho_air C)); edge on the same with the friction
    coefficient. Both within 1% at all times: velocities are those at the end of a step of 1 ms, g h / 2 ahead.
    """
    terminal = np.sqrt(2.0 * DENSITY * G / (AIR * coefficient))
    t, v = centre(edge_v, 3.0 * terminal / G)
    assert -v[1:, 2] == pytest.approx(terminal * np.tanh(G * t[1:] / terminal), rel=0.01)
    assert np.abs(v[:, :2]).max() < 1e-6


def test_flat_sheet_has_fallen_as_far_as_quadratic_drag_lets_it() -> None:
    """u_t^2 / g ln cosh(g t / u_t), within 0.02% of three time constants' fall: no error of first order in the step."""
    terminal = np.sqrt(2.0 * DENSITY * G / (AIR * 1.2))
    fall = fallen((0.0, 1.0, 0.0), 3.0 * terminal / G)
    height = fall.positions[:, 0, 2] - fall.positions[0, 0, 2]
    exact = -(terminal**2) / G * np.log(np.cosh(G * fall.times / terminal))
    assert np.abs(height - exact).max() < 2e-4 * abs(exact[-1])


def test_wind_carries_a_sheet_along() -> None:
    """Speed against the wind falls as u_0 / (1 + k u_0 t), k = rho_air C / (2 rho); within 0.5%."""
    t, v = centre((0.0, 0.0, 1.0), 1.0, gravity=(0.0, 0.0, 0.0), wind=(0.0, 5.0, 0.0))
    k = AIR * 1.2 / (2.0 * DENSITY)
    assert 5.0 - v[1:, 1] == pytest.approx(5.0 / (1.0 + k * 5.0 * t[1:]), rel=0.005)


def test_slanted_sheet_glides_sideways() -> None:
    """At 45 degrees the drag across the sheet outweighs that along it, so that it gains way along its slope."""
    c = np.sqrt(0.5)
    _, v = centre((0.0, c, c), 0.3)
    assert v[-1, 1] < -0.2
    assert v[-1, 2] < -0.5


def test_no_air_no_drag() -> None:
    t, v = centre((0.0, 1.0, 0.0), 0.5, air_density=0.0)
    assert v[:, 2] == pytest.approx(-G * t, abs=1e-9)
