"""Frames that a fit down-weights are named; frames of a fit that is off altogether are not called outlying."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    FitProblem,
    FitResult,
    Outlying,
    Unknown,
    default_unknowns,
    outlying_frames,
    refine,
)
from polyworld.world import World
from tests.polyworld.estimation.world_fit.closed_form import ClosedForm, observe, thrown_ball

SIGMA = 0.01  # [m]


def fitted(tracks: ObservedTracks, unknowns: list[Unknown] | None = None) -> tuple[FitProblem, FitResult]:
    world = thrown_ball()
    wanted = unknowns or default_unknowns(world, tracks, each=())
    problem = FitProblem(world, tracks, wanted, make_simulator=ClosedForm)
    return problem, refine(problem)


def displaced(tracks: ObservedTracks, rows: list[int], by: float) -> ObservedTracks:
    positions = tracks.positions.copy()
    positions[rows, 0, 1] += by
    return replace(tracks, positions=positions)


@pytest.mark.parametrize("seed", range(3))
def test_frames_that_are_wrong_are_named_with_their_distance_in_sigmas(seed: int) -> None:
    wrong = [7, 15, 16]
    tracks = displaced(observe(thrown_ball(), sigma=SIGMA, seed=seed), wrong, 0.3)
    tracks = replace(tracks, frames=tracks.frames + 100)
    (found,) = outlying_frames(*fitted_from(tracks))
    assert (found.object, found.frames) == ("ball", tuple(100 + row for row in wrong))
    assert found.worst == pytest.approx(0.3 / SIGMA, abs=5.0)


def fitted_from(tracks: ObservedTracks) -> tuple[FitProblem, FitResult]:
    """The fit of a ball that enters with the first frame."""
    world = thrown_ball(start_time=float(tracks.frames[0]) * tracks.seconds_per_frame)
    problem = FitProblem(world, tracks, default_unknowns(world, tracks, each=()), make_simulator=ClosedForm)
    return problem, refine(problem)


def test_noise_alone_has_no_outlying_frames() -> None:
    assert outlying_frames(*fitted(observe(thrown_ball(), sigma=SIGMA))) == ()


def test_a_fit_that_is_off_in_most_frames_has_no_outlying_ones() -> None:
    """With its damping held at a wrong value it misses nearly everywhere: that is no matter of single frames."""
    tracks = observe(thrown_ball(velocity=(1.0, 1.0, 1.0)), sigma=SIGMA)
    only = Unknown("d", ("objects.ball.angular_damping",), "1/s", 0.3, 0.0, 1.0, 0.1)
    assert outlying_frames(*fitted(tracks, [only])) == ()


def test_each_body_is_judged_by_its_own_frames() -> None:
    one = thrown_ball()
    two = one.objects[0].model_copy(update={"name": "other", "position": (5.0, 0.0, 1.0)})
    world = World(objects=(*one.objects, two), time=one.time)
    tracks = observe(world, sigma=SIGMA)
    positions = tracks.positions.copy()
    positions[[3, 20], 1] += 0.2
    tracks = replace(tracks, positions=positions)
    problem = FitProblem(world, tracks, default_unknowns(world, tracks, each=()), make_simulator=ClosedForm)
    found = outlying_frames(problem, refine(problem))
    assert [(o.object, o.frames) for o in found] == [("other", (3, 20))]
    assert isinstance(found[0], Outlying)
    assert np.isclose(found[0].worst, np.sqrt(3.0) * 0.2 / SIGMA, atol=5.0)
