"""Work of rollouts, and how many fit a budget."""

from __future__ import annotations

import pytest

from polyworld.solver.work import LEAST, affordable, work_of
from polyworld.world import World
from tests.polyworld.solver.fluid.scenes import plane_world, pool


def test_work_is_points_and_cells_times_steps() -> None:
    """Water of 0.4 m by 0.2 m in cells of 0.02 m has 800 particles, two along an edge; its box has 1250 cells."""
    world = plane_world(pool("water", (0, 0), (0.4, 0.2)), size=(1, 0.5), cell=0.02).with_substep(0.004)
    assert work_of(world, 0.8) == pytest.approx((800 + 1250) * 200)
    assert work_of(World(), 0.8) == 0.0


def test_as_many_rollouts_are_made_as_fit_and_no_fewer_than_intervals_need() -> None:
    assert affordable([0.0, 0.0], 1e6, 64) == 64
    assert affordable([2e4, 1e4], 1e6, 64) == 33
    assert affordable([1e9], 1e6, 64) == LEAST
    assert affordable([1e9], 1e6, 10) == 10
