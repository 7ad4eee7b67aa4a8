"""Runs cut into segments: where they begin, when they cannot be cut, and that they lead to what whole runs hide."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.candidate import Candidate
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue import catalogue
from polyworld.gap.contest import Contest
from polyworld.gap.examine import fitted_base
from polyworld.gap.segment_context import segment_context
from polyworld.gap.settings import SearchSettings
from polyworld.gap.stepping import coarsened
from polyworld.world import World
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches
from tests.scenes.ball import Ball, Launch, fly

AIR = np.array([4.0, -3.0, 0.0])
COEFFICIENT = 0.05


def in_wind(_t: float, _x: np.ndarray, v: np.ndarray, _w: np.ndarray) -> np.ndarray:
    past = v - AIR
    return -COEFFICIENT / MASS * np.linalg.norm(past) * past


def seen(ball: Bouncing, sigma: float = 0.001, runs: int = 4, seed: int = 3) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, runs), rng, sigma)


@pytest.mark.parametrize("sigma", [0.001, 0.01])
def test_segments_cover_each_run_and_do_not_begin_at_an_impact(sigma: float) -> None:
    recording, clear = (seen(Bouncing(), noise, runs=20, seed=5) for noise in (sigma, 1e-9))
    plan = design(ball_world(), recording)
    cut = segment_context(FitContext(plan, measured_noise(plan), 1), 4)
    assert cut is not None
    pieces = cut.context.design.recording.runs
    assert len(pieces) == 80
    assert [sum(len(p.times) for p in pieces[4 * r : 4 * r + 4]) for r in range(20)] == [
        len(r.times) for r in recording.runs
    ]
    for index, piece in enumerate(pieces):
        run = clear.runs[index // 4]
        begin = int(np.flatnonzero(run.times == piece.times[0])[0])
        rising = np.diff(run.positions[begin : begin + 4, 0, 2]) / np.diff(run.times[begin : begin + 4])
        # A rebound would add at least its own speed; where a run begins is not for segments to choose.
        assert begin == 0 or np.all(np.diff(rising) < 1.0)


def test_wind_that_whole_runs_hide_is_found_on_segments_and_leads_to_the_whole_fit() -> None:
    plan = design(ball_world(), seen(Bouncing(acceleration=in_wind)))
    context = fitted_base(plan, ()).context
    nothing = Hypothesis(plan.world, ())
    whole = context.fit(nothing, np.zeros(0), profile.start_states(plan))
    cut = segment_context(context, 4)
    assert cut is not None
    ground = cut.fit_base(nothing, np.zeros(0))
    assert ground.chi2 / cut.context.observations < 0.1 * whole.chi2 / context.observations
    (wind,) = (
        h for h in extended(nothing, catalogue()["wind"], plan.recording) if "along" in h.parts[-1].variant.label
    )
    start = np.array([0.02, 2.0, -2.0])
    there = cut.context.fit(wind, start, ground.fit.states)
    assert there.values == pytest.approx([COEFFICIENT, *AIR[:2]], rel=0.1)
    begin = cut.start(there.fit)
    fitted = context.fit(wind, begin.values, begin.states)
    assert fitted.values == pytest.approx([COEFFICIENT, *AIR[:2]], rel=0.01)
    assert fitted.chi2 < 1.2 * context.observations


def test_forcing_keeps_its_phase_from_segment_to_segment() -> None:
    turn = 2.0 * np.pi * 1.7
    ball = Bouncing(acceleration=lambda t, _x, _v, _w: np.array([2.0 * np.sin(turn * t + 0.6), 0.0, 0.0]))
    plan = design(ball_world(), seen(ball))
    cut = segment_context(fitted_base(plan, ()).context, 4)
    assert cut is not None
    nothing = Hypothesis(plan.world, ())
    (forcing,) = extended(nothing, catalogue()["periodic_forcing"], plan.recording)
    names = [u.name for u in forcing.unknowns]
    true = {"amplitude_x": 2.0, "frequency": 1.7, "phase": 0.6}
    start = np.array([true.get(n, 0.0) for n in names])
    there = cut.context.fit(forcing, start, cut.fit_base(nothing, np.zeros(0)).fit.states)
    assert there.chi2 < 1.2 * cut.context.observations


@pytest.mark.parametrize("lacking", ["a stretch that was not seen", "turns where there is friction"])
def test_what_a_segment_could_not_know_keeps_runs_whole(lacking: str) -> None:
    recording = seen(Bouncing())
    world = ball_world()
    if lacking == "a stretch that was not seen":
        run = recording.runs[0]
        places = run.positions.copy()
        places[45:140] = np.nan
        recording = Recording((replace(run, positions=places), *recording.runs[1:]))
    else:
        world = World.model_validate(
            {**world.model_dump(), "objects": [{**world.objects[0].model_dump(), "friction": 0.3}]}
        )
    assert segment_context(fitted_base(design(world, recording), ()).context, 4) is None


def test_a_base_unknown_stays_shared_by_all_segments() -> None:
    free = Unknown("restitution", ("objects.ball.restitution",), "1", 0.8, 0.0, 1.0, 0.1)
    recording = seen(Bouncing(after=lambda speed, along: (0.7 * speed, along)))
    plan = design(ball_world(), recording)
    cut = segment_context(fitted_base(plan, (free,)).context, 4)
    assert cut is not None
    assert cut.fit_base(Hypothesis(plan.world, (free,)), np.array([0.8])).values == pytest.approx([0.7], abs=0.005)


def test_friction_far_less_than_what_grips_is_found_from_other_strengths() -> None:
    """In the world most impacts grip, so that no slope by its friction shows what half of it does."""
    true, rng, times = 0.05, np.random.default_rng(1), np.arange(193) / 120.0
    runs = []
    for k, begin in enumerate(launches(rng)):
        path = fly(Ball(friction=true), Launch(*(tuple(x) for x in (begin.place, begin.velocity, begin.spin))), times)
        places = path.positions + rng.normal(0.0, 0.03, path.positions.shape)
        turns = path.orientations + rng.normal(0.0, 0.015, path.orientations.shape)
        turns /= np.linalg.norm(turns, axis=1, keepdims=True)
        runs.append(Run(f"run{k}", ("ball",), times, places[:, None], turns[:, None]))
    data, base_world = Recording(tuple(runs)), ball_world()
    rough = World.model_validate(
        {**base_world.model_dump(), "objects": [{**base_world.objects[0].model_dump(), "friction": 0.3}]}
    )
    plan = design(coarsened(rough, data), data)
    context = FitContext(plan, measured_noise(plan), 2)
    base = context.fit(Hypothesis(plan.world, ()), np.zeros(0), profile.start_states(plan), iterations=0)
    cut = segment_context(context, 2)
    assert cut is not None
    friction = catalogue()["friction_error"]

    def best(friction: Candidate) -> FittedHypothesis:
        contest = Contest(cut.context, cut, SearchSettings(), lambda _step, _figures: None)
        parent = cut.fit_base(base.hypothesis, base.values)
        predictions = contest.predict([parent], lambda t: list(extended(t.hypothesis, friction, data)))
        return contest.fit(predictions, 1, parent.chi2)[0]

    right = best(friction)
    assert right.chi2 < 1.05 * cut.context.observations
    assert right.values[0] == pytest.approx(true, rel=0.01)
    assert best(replace(friction, further=None)).chi2 > 2.0 * cut.context.observations
