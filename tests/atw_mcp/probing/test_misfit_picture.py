"""The picture of where and when a world is off shows the measured places, in metres and in standard deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from atw_mcp.looking.plan_view import plan_frame
from atw_mcp.probing.misfit_picture import misfit_figure, misfit_picture
from atw_mcp.probing.misfits import Misfit, misfits
from polyworld.pictures.render import look_at
from polyworld.solver.rollout import rollout
from polyworld.trajectory import Trajectory
from polyworld.world import World
from tests.atw_mcp.two_discs import FRAME, MEETING, two_discs
from tests.atw_mcp.viewer.stores import ASIDE, SIGMA, tracks


@pytest.fixture(scope="module")
def run() -> tuple[World, Trajectory]:
    world = two_discs()
    return world, rollout(world, 1.0).trajectory


@pytest.fixture(scope="module")
def found(run: tuple[World, Trajectory]) -> list[Misfit]:
    world, trajectory = run
    return misfits(world, trajectory, replace(tracks(world), seconds_per_frame=FRAME))


def drawn(run: tuple[World, Trajectory], found: list[Misfit], eye: tuple[float, float, float]) -> Figure:
    camera = look_at(np.array(eye), np.array([0.7, 0.0, 0.0]), focal=350.0, width=320, height=240)
    return misfit_figure(found, plan_frame([run], camera, run[1].names, [50], 480))


def test_map_has_every_measured_place_with_its_size(run: tuple[World, Trajectory], found: list[Misfit]) -> None:
    # From behind, the plan's x points left: coordinates stay those of the world, and the axis is turned.
    for eye, to_the_left in (((0.7, -3.0, 2.0), False), ((0.7, 3.0, 2.0), True)):
        where = drawn(run, found, eye).axes[0]
        assert where.get_xlabel() == "x [m]"
        assert where.xaxis_inverted() == to_the_left
        maps = [c for c in where.collections if isinstance(c, PathCollection)]
        for misfit in found:
            known = np.isfinite(misfit.sigmas)
            matches = [
                m
                for m in maps
                if np.allclose(np.asarray(m.get_offsets())[known], misfit.measured[known, :2])
                and np.allclose(np.asarray(m.get_array())[known], misfit.sigmas[known])
            ]
            assert len(matches) == 1, misfit.name


def test_courses_are_in_metres_and_in_standard_deviations(run: tuple[World, Trajectory], found: list[Misfit]) -> None:
    _, bar, metres, sigmas = drawn(run, found, (0.7, -3.0, 2.0)).axes
    assert bar.get_ylabel() == "distance [σ of the measurement]"
    assert (metres.get_ylabel(), sigmas.get_ylabel(), sigmas.get_xlabel()) == (
        "distance [m]",
        "distance [σ]",
        "time [s]",
    )
    (striker,) = [line for line in metres.lines if line.get_label() == "striker"]
    times, distance = (np.asarray(values, dtype=float) for values in striker.get_data())
    before = times < MEETING - FRAME
    assert distance[before] == pytest.approx(ASIDE, abs=1e-6)
    (same,) = [line for line in sigmas.lines if line.get_color() == striker.get_color()]
    assert np.asarray(same.get_ydata(), dtype=float)[before] == pytest.approx(ASIDE / SIGMA, abs=1e-3)
    assert (
        len({(line.get_color(), line.get_marker()) for line in metres.lines})
        == len({line.get_marker() for line in metres.lines})
        == 2
    )


def test_picture_is_a_thousand_pixels_wide_and_says_where_no_noise_is_stated(
    run: tuple[World, Trajectory], found: list[Misfit]
) -> None:
    camera = look_at(np.array([0.7, -3.0, 2.0]), np.array([0.7, 0.0, 0.0]), focal=350.0, width=320, height=240)
    picture = misfit_picture(found, plan_frame([run], camera, run[1].names, [50], 480))
    assert picture.shape == (460, 1000, 3)
    assert picture.dtype == np.uint8
    unknown = [replace(misfit, sigmas=np.full_like(misfit.sigmas, np.nan)) for misfit in found]
    figure = drawn(run, unknown, (0.7, -3.0, 2.0))
    assert figure.axes[1].get_ylabel() == "distance [m]"
    assert [text.get_text() for text in figure.axes[3].texts] == ["no noise is stated"]
