"""Contacts between stretches of a body's motion, against rebounds in closed form; what obstacles hide of the floor."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.flight.contacts import Equations, Side, joined, landed, rebound
from atw_mcp.perception.flight.evidence import Motion, energy_gains, flight, sliding
from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.surfaces import is_covered, surfaces_of

Floats = NDArray[np.float64]
G = np.array([0.0, 0.0, -9.81])
UP = np.array([0.0, 0.0, 1.0])
RADIUS, FRAME = 0.1, 1.0 / 30.0
SETTINGS = FlightSettings()
USUAL = 3.0
(FLOOR,) = surfaces_of(0.0, {})


def through(motion: Motion, time: float, place: Floats, velocity: Floats) -> Floats:
    """Unknowns (6,) of the flight that has a place and a velocity at a time."""
    drift = motion.drift
    return np.concatenate([place - motion.origin - velocity * time + 0.5 * drift * time**2, velocity - drift * time])


def bounce(
    contact: float, restitution: float, kept: float, height: float = RADIUS, apart: float = 0.0
) -> tuple[Equations, Floats, Floats]:
    """A ball's flights before and after a contact with the floor at a time, and the equations at the middle of a frame.

    height [m]: of the contact. apart [m]: by how much the second flight begins elsewhere.
    """
    motion = flight(G, np.zeros(3), 1.0, USUAL)
    before = np.array([1.2, -0.4, -3.0])
    after = np.array([kept * before[0], kept * before[1], -restitution * before[2]])
    place = np.array([0.3, 0.2, height])
    a = through(motion, contact, place, before)
    b = through(motion, contact, place + np.array([apart, 0.0, 0.0]), after)
    sides = Side.of(motion, a, 0.0), Side.of(motion, b, 0.0)
    return rebound(*sides, FRAME, FLOOR, (RADIUS, RADIUS), USUAL, SETTINGS), a, b


@pytest.mark.parametrize("contact", [-0.4 * FRAME, 0.0, 0.4 * FRAME])
def test_a_rebound_fulfils_its_equations_whenever_it_happens_within_a_frame(contact: float) -> None:
    """Its cost is that of the density at most a deviation away from the mode."""
    equations, a, b = bounce(contact, 0.6, 0.8)
    assert equations.cost(a, b) - equations.cost(None, None) < 1.5


@pytest.mark.parametrize(
    ("changes", "least"),
    [
        ({"restitution": 2.0}, 5.0),  # it would gain energy
        ({"kept": -1.5}, 5.0),  # it would be thrown back by the floor
        ({"height": 4 * RADIUS}, 5.0),  # in mid air
        ({"apart": 0.1}, 20.0),  # in two places at once
    ],
)
def test_what_is_no_rebound_costs_more(changes: dict[str, float], least: float) -> None:
    equations, a, b = bounce(**{"contact": 0.0, "restitution": 0.6, "kept": 0.8, **changes})
    assert equations.cost(a, b) - equations.cost(None, None) > least


def test_the_time_of_a_contact_makes_places_uncertain_along_the_change_of_velocity_alone() -> None:
    motion = flight(G, np.zeros(3), 1.0, USUAL)
    a = through(motion, 0.0, np.zeros(3), np.array([0.0, 0.0, -3.0]))
    b = through(motion, 0.0, np.zeros(3), np.array([0.0, 0.0, 2.0]))
    equations = joined(Side.of(motion, a, 0.0), Side.of(motion, b, 0.0), FRAME, 0.0, SETTINGS)
    spread = np.sqrt(np.diag(equations.covariance))
    np.testing.assert_allclose(spread[:2], SETTINGS.joint)
    assert spread[2] == pytest.approx(5.0 * FRAME / np.sqrt(12.0), rel=0.03)


def test_normal_equations_lead_to_the_most_probable_unknowns() -> None:
    """With the flight before held, the flight after has the expected restitution, and begins where the other ends."""
    equations, a, _ = bounce(0.0, SETTINGS.restitution, SETTINGS.kept)
    matrix, right = equations.normal()
    found = np.linalg.solve(matrix[6:, 6:] + 1e-9 * np.eye(6), right[6:] - matrix[6:, :6] @ a)
    motion = flight(G, np.zeros(3), 1.0, USUAL)
    velocity = motion.velocities(np.zeros(1), found[None])[0]
    expected = [SETTINGS.kept * 1.2, -SETTINGS.kept * 0.4, SETTINGS.restitution * 3.0]
    np.testing.assert_allclose(velocity, expected, rtol=1e-6)
    np.testing.assert_allclose(motion.places(np.zeros(1), found[None])[0], [0.3, 0.2, RADIUS], atol=1e-6)


def test_a_landed_body_goes_on_as_it_came() -> None:
    air = flight(G, np.zeros(3), 1.0, USUAL)
    floor = sliding("floor", RADIUS * UP, np.eye(3)[:2], G, 0.3, 1.0, USUAL)
    a = through(air, 0.0, np.array([0.0, 0.0, RADIUS]), np.array([1.5, 0.0, -2.0]))
    costs = []
    for velocity in ((1.3, 0.0), (0.0, 1.5)):
        b = np.array([0.0, 0.0, *velocity, 0.0, 0.0])
        equations = landed(Side.of(air, a, 0.0), Side.of(floor, b, 0.0), FRAME, FLOOR, USUAL, SETTINGS)
        costs.append(equations.cost(a, b))
    assert costs[1] - costs[0] > 5.0


def test_only_gravity_makes_a_body_faster() -> None:
    """A flight and a fall along a slope gain what they lose in height; on a level floor nothing may be gained."""
    ends = np.array([[-0.2, 0.2]])
    air = flight(G, np.zeros(3), 1.0, USUAL)
    flown = through(air, 0.0, np.zeros(3), np.array([1.0, 0.0, 0.0]))
    assert energy_gains(air, ends, flown[None], G, SETTINGS)[0] == pytest.approx(0.0, abs=1e-12)
    angle = np.deg2rad(25.0)
    axes = np.array([[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0]])
    slope = sliding("ramp", np.zeros(3), axes, G, 0.3, 1.0, USUAL)
    pull = 9.81 * np.sin(angle)
    slid = np.array([0.0, 0.0, 1.0, 0.0, pull, 0.0])
    assert energy_gains(slope, ends, slid[None], G, SETTINGS)[0] == pytest.approx(0.0, abs=1e-12)
    floor = sliding("floor", np.zeros(3), np.eye(3)[:2], G, 0.3, 1.0, USUAL)
    slowing, faster = (np.array([0.0, 0.0, 1.0, 0.0, rate, 0.0]) for rate in (-2.0, 2.0))
    assert energy_gains(floor, ends, slowing[None], G, SETTINGS)[0] == 0.0
    turning = np.array([0.0, 0.0, 1.0, 0.0, 0.0, -10.0])  # from 2 m/s along y to -2 m/s, past none
    for motion, gained in ((faster, 1.4 - 0.6), (turning, np.hypot(1.0, 2.0) - 1.0)):
        found = energy_gains(floor, ends, motion[None], G, SETTINGS)[0]
        assert found == pytest.approx(0.5 * (gained / SETTINGS.gain) ** 2)


def test_what_an_obstacle_hides_cannot_be_on_the_floor() -> None:
    """A wall 1 m in front of a camera at a height of 1 m, 0.5 m high, hides the floor from 1 to 2 m and no more."""
    wall = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (1.0, 1.02) for z in (0.0, 0.5)])
    centre = np.array([0.0, 0.0, 1.0])
    seen = np.array([[0.0, y, 0.0] for y in (0.9, 1.5, 1.9, 2.2, 5.0)] + [[3.0, 1.5, 0.0]]) - centre
    rays = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    found = is_covered(rays, centre, FLOOR, 0.0, {"wall": wall})
    assert found.tolist() == [False, True, True, False, False, False]
