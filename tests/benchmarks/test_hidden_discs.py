"""The generator of colliding discs against closed forms."""

# ruff: noqa: ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.scenes.ball import Patch
from tests.scenes.discs import Discs, Started, slide

TIMES = np.arange(91) / 60.0


def discs(n: int, *, friction: float = 0.0, restitution: float = 0.8, **laws: object) -> Discs:
    """Unlike discs."""
    masses, radii = 0.5 + 0.25 * np.arange(n), 0.1 + 0.05 * np.arange(n)
    return Discs(masses, radii, np.full(n, friction), restitution, **laws)  # type: ignore[arg-type]


def started(positions: list[list[float]], velocities: list[list[float]], spins: list[float]) -> Started:
    """Arrays from lists."""
    return Started(np.array(positions), np.array(velocities), np.array(spins))


def test_disc_without_spin_stops_where_coulomb_says() -> None:
    path = slide(discs(1, friction=0.2), started([[0.0, 0.0]], [[2.0, 0.0]], [0.0]), TIMES)
    assert path[-1, 0, 0] == pytest.approx(4.0 / (2.0 * 0.2 * 9.81), abs=1e-6)
    assert np.linalg.norm(path[-1, 0, 3:]) < 1e-12


def test_disc_that_only_spins_is_braked_by_the_moment_of_its_patch() -> None:
    path = slide(discs(1, friction=0.2), started([[0.0, 0.0]], [[0.0, 0.0]], [60.0]), TIMES)
    rate = 0.2 * 9.81 * (2.0 / 3.0 * 0.1) / (0.5 * 0.1**2)  # mu m g r / I
    np.testing.assert_allclose(path[:, 0, 5], np.maximum(60.0 - rate * TIMES, 0.0), atol=3e-3)


def test_speed_and_spin_of_a_sliding_disc_end_together() -> None:
    path = slide(discs(1, friction=0.2), started([[0.0, 0.0]], [[1.0, 0.0]], [20.0]), TIMES)
    moving = (path[:, 0, 3] > 1e-3) | (np.abs(path[:, 0, 5]) > 1e-2)
    last = int(np.flatnonzero(moving)[-1])
    assert path[last, 0, 3] > 1e-3
    assert path[last, 0, 5] > 1e-2


def test_head_on_impact_keeps_momentum_and_restitution() -> None:
    begin = started([[0.0, 0.0], [1.0, 0.0]], [[2.0, 0.0], [0.0, 0.0]], [0.0, 0.0])
    path = slide(discs(2), begin, TIMES)
    va, vb = path[-1, 0, 3], path[-1, 1, 3]
    assert 0.5 * va + 0.75 * vb == pytest.approx(1.0)
    assert vb - va == pytest.approx(1.6)


def test_oblique_impact_with_friction_keeps_both_momenta() -> None:
    begin = started([[0.0, 0.0], [1.0, 0.1]], [[2.0, 0.0], [-0.5, 0.0]], [3.0, -2.0])
    set_up = Discs(np.array([0.5, 0.75]), np.array([0.1, 0.15]), np.array([0.3, 0.3]), 0.8, gravity=0.0)
    path = slide(set_up, begin, TIMES)

    def momenta(s: np.ndarray) -> np.ndarray:
        m, i = set_up.masses, set_up.inertias
        linear = (m[:, None] * s[:, 3:5]).sum(axis=0)
        angular = (m * (s[:, 0] * s[:, 4] - s[:, 1] * s[:, 3])).sum() + (i * s[:, 5]).sum()
        return np.array([*linear, angular])

    np.testing.assert_allclose(momenta(path[-1]), momenta(path[0]), atol=1e-9)
    assert abs(path[-1, 0, 5] - 3.0) > 0.1


@pytest.mark.parametrize("deep", [1e-2, 1e-3, 1e-5])
def test_a_graze_however_brief_is_an_impact(deep: float) -> None:
    set_up = Discs(np.array([0.5, 0.75]), np.array([0.1, 0.15]), np.zeros(2), 0.8, gravity=0.0)
    aside = 0.25 - deep
    path = slide(set_up, started([[-0.5, 0.0], [0.0, aside]], [[4.0, 0.0], [0.0, 0.0]], [0.0, 0.0]), TIMES)
    # Along the line of centres at touch, with sine aside / 0.25: momentum, and 1.8 times the approach.
    push = 1.8 * 4.0 * math.sqrt(1.0 - (aside / 0.25) ** 2) / (1.0 / 0.5 + 1.0 / 0.75)
    assert np.linalg.norm(path[-1, 1, 3:5]) == pytest.approx(push / 0.75, rel=1e-5)
    assert path[-1, 1, 4] == pytest.approx(push / 0.75 * aside / 0.25, rel=1e-5)


def test_wall_sticks_to_a_slow_rim() -> None:
    set_up = Discs(np.array([0.5]), np.array([0.1]), np.array([0.9]), 0.5, gravity=0.0, walls=((-1.0, 0.0, -1.0),))
    path = slide(set_up, started([[0.0, 0.0]], [[2.0, 0.3]], [0.0]), TIMES)
    # Sticking: the rim's speed along the wall ends at zero; a disc keeps 2/3 of it.
    assert path[-1, 0, 3] == pytest.approx(-1.0)
    assert path[-1, 0, 4] == pytest.approx(0.2)
    assert path[-1, 0, 4] + 0.1 * path[-1, 0, 5] == pytest.approx(0.0, abs=1e-9)


def test_disc_crosses_a_patch_with_the_energy_left() -> None:
    set_up = discs(1, patches=(Patch(1.0, 0.0, 0.25, 0.3),))
    path = slide(set_up, started([[0.0, 0.0]], [[3.0, 0.0]], [0.0]), TIMES)
    assert path[-1, 0, 3] == pytest.approx(math.sqrt(9.0 - 2.0 * 0.3 * 9.81 * 0.5), abs=1e-6)


def test_tilted_plane_holds_a_disc_below_the_critical_slope() -> None:
    push = 0.1 * 9.81
    held = discs(1, friction=0.2, forces=(lambda t, x, v, w: np.array([[0.5 * push, 0.0]]),))
    path = slide(held, started([[0.0, 0.0]], [[0.0, 0.0]], [0.0]), TIMES)
    assert np.all(path[:, 0, :2] == 0.0)
