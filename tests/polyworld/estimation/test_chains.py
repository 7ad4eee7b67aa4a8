"""Chains of segments: where runs are cut, what continuity is, and the normal equations against dense slopes."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from polyworld.estimation.continuity import jumps
from polyworld.estimation.least_squares import FIRST_STEP, Chains, NormalEquations, Point
from polyworld.estimation.noise import Correlation, measured_noise, refined_noise
from polyworld.estimation.problem import apart, problem_of
from polyworld.estimation.segment_forward import Forward, Settings
from polyworld.estimation.segments import SegmentSettings
from polyworld.estimation.shooting import Fit, set_scales
from polyworld.recording import Recording
from tests.polyworld.gap_scenes import Bouncing, ball_recording, ball_world, launches


@pytest.fixture(scope="module")
def recording() -> Recording:
    rng = np.random.default_rng(4)
    return ball_recording(Bouncing(), launches(rng, 3), rng, 0.002, duration=0.9, rate=80.0)


def test_every_measurement_belongs_to_one_segment(recording: Recording) -> None:
    problem = problem_of(ball_world(), recording)
    for run, chain in enumerate(problem.chains):
        assert len(chain) > 3
        entries = np.concatenate([problem.segments[k].own for k in chain])
        assert sorted(entries.tolist()) == list(range(problem.whole.runs[run].length))


def test_segments_end_where_the_next_ones_begin(recording: Recording) -> None:
    problem = problem_of(ball_world(), recording, SegmentSettings(samples=12, most=4))
    for chain in problem.chains:
        for one, other in itertools.pairwise(chain):
            first, second = problem.segments[one], problem.segments[other]
            assert first.layout.run.times[-1] == second.layout.run.times[0]
            assert np.all(np.isnan(first.layout.run.positions[-1]))


def test_one_trajectory_has_no_jumps(recording: Recording) -> None:
    """Segments that begin where a rollout of the whole run passes are continued by each other."""
    world = ball_world()
    problem = problem_of(world, recording)
    whole = apart(problem_of(world, recording, SegmentSettings(most=1)))
    states = list(problem.guess)
    for run, chain in enumerate(problem.chains):
        state = whole.guess[run]
        for k in chain:
            forward = Forward(problem, world, ())
            states[k] = state
            (found,) = forward.outcomes([Settings(k, np.zeros((1, 0)), state[None])])
            labels = problem.segments[k].layout.labels
            place, speed = found.end.position[0, 0], found.end.velocity[0, 0]
            state = np.array([(place if ".position." in label else speed)["xyz".index(label[-1])] for label in labels])
    chains = Chains(Forward(problem, world, ()), measured_noise(problem.whole))
    settings = [Settings(s.index, np.zeros((1, 0)), states[s.index][None]) for s in problem.segments]
    found_jumps = jumps(chains.continuity, chains.forward.outcomes(settings), [s.states for s in settings])
    for jump in found_jumps:
        assert np.max(np.abs(jump)) < 1e-9


@pytest.mark.parametrize("phi", [0.0, 0.6])
def test_normal_equations_are_those_of_dense_slopes(recording: Recording, phi: float) -> None:
    """Blocks, correlated noise across cuts included, against slopes of all residuals by all states at once."""
    world = ball_world()
    problem = problem_of(world, recording, SegmentSettings(samples=12, most=4))
    noise = measured_noise(problem.whole)
    if phi:
        residuals = [np.random.default_rng(r.index).normal(size=r.length) * 0.002 for r in problem.whole.runs]
        noise = refined_noise(problem.whole, noise, residuals)
        rho = tuple(np.where(p == np.arange(len(p)), 0.0, phi) for p in noise.previous)
        noise = replace(noise, rho=rho, correlation={"position": Correlation(phi, 0.01, 1.0 / 80.0)})
    chains = Chains(Forward(problem, world, ()), noise)
    own = tuple(FIRST_STEP * s.layout.typical for s in problem.segments)
    at = Point(np.zeros(0), problem.guess)
    linear = chains.linearise(at, np.zeros(0), own)
    normal = NormalEquations(chains, linear, 1.0)
    run = 1
    dense = _dense_slopes(chains, at, own, run)
    residual = np.concatenate([linear.r[run], *[linear.jump[i] for i in _boundaries(chains, run)]])
    np.testing.assert_allclose(normal.h[run], dense.T @ dense, rtol=1e-6, atol=1e-6 * np.abs(normal.h[run]).max())
    np.testing.assert_allclose(normal.v[run], dense.T @ residual, rtol=1e-6, atol=1e-6 * np.abs(normal.v[run]).max())


def _boundaries(chains: Chains, run: int) -> list[int]:
    return [i for i, b in enumerate(chains.continuity.boundaries) if chains.problem.segments[b.after].run == run]


def _dense_slopes(chains: Chains, at: Point, own: tuple[np.ndarray, ...], run: int) -> np.ndarray:
    base = _all_residuals(chains, at, run)
    columns = []
    for k in chains.problem.chains[run]:
        for i, step in enumerate(own[k]):
            states = list(at.states)
            states[k] = states[k].copy()
            states[k][i] += step
            columns.append((_all_residuals(chains, Point(at.values, tuple(states)), run) - base) / step)
    return np.array(columns).T


def _all_residuals(chains: Chains, at: Point, run: int) -> np.ndarray:
    problem = chains.problem
    settings = [Settings(s.index, at.values[None], at.states[s.index][None]) for s in problem.segments]
    outcomes = chains.forward.outcomes(settings)
    raw = np.empty(problem.whole.runs[run].length)
    for k in problem.chains[run]:
        raw[problem.segments[k].own] = outcomes[k].residual[0]
    found = jumps(chains.continuity, outcomes, [s.states for s in settings])
    return np.concatenate([chains.noise.whiten(run, raw), *[found[i][0] for i in _boundaries(chains, run)]])


def test_a_chain_of_the_true_world_fits_to_the_noise_at_any_tolerance(recording: Recording) -> None:
    world = ball_world()
    problem = problem_of(world, recording)
    chains = Chains(Forward(problem, world, ()), measured_noise(problem.whole))
    fit = Fit(chains, Point(np.zeros(0), problem.guess))
    set_scales(chains, fit.at)
    count = sum(r.length for r in problem.whole.runs)
    costs = [fit.stage(tolerance, 8, 0.1).cost / count for tolerance in (3.0, 1.0, 0.1, 0.01)]
    assert costs == sorted(costs)  # less freedom explains less
    assert costs[0] < costs[-1] < 1.2


def test_runs_with_missing_rows_are_simulated_together_and_alike(recording: Recording) -> None:
    rng = np.random.default_rng(2)
    thinned = Recording(tuple(r.rows(rng.random(len(r.times)) > 0.1) for r in recording.runs))
    problem = problem_of(ball_world(), thinned, SegmentSettings(most=1))
    together = Forward(problem, ball_world(), ())
    settings = [Settings(s.index, np.zeros((1, 0)), problem.guess[s.index][None]) for s in problem.segments]
    found = together.outcomes(settings)
    assert len(together._batches) == 1
    for run, outcome in zip(thinned.runs, found, strict=True):
        alone = problem_of(ball_world(), Recording((run,)), SegmentSettings(most=1))
        (expected,) = Forward(alone, ball_world(), ()).outcomes([Settings(0, np.zeros((1, 0)), alone.guess[0][None])])
        np.testing.assert_allclose(outcome.residual, expected.residual, atol=1e-9)
