"""A slice of the fuzz of random worlds: one world of some kinds that share their kernels with other tests."""

from dataclasses import replace

import pytest

from polyworld.solver.rollout import rollout
from polyworld.world import World
from tests.benchmarks.fuzz.checks import energy_excess
from tests.benchmarks.fuzz.scenes import KINDS, fuzz
from tests.benchmarks.fuzz.worlds import run

QUICK = ("jointed", "overlapping", "ropes")


@pytest.mark.parametrize("kind", QUICK)
def test_a_random_world_runs_or_is_refused_with_a_reason(kind: str) -> None:
    outcome = run(1600 + list(KINDS).index(kind), 30.0)
    assert outcome.kind == kind
    assert outcome.outcome in ("completed", "diverged", "refused"), outcome.detail


def test_a_seed_makes_the_same_world_every_time() -> None:
    assert fuzz(37) == fuzz(37)
    assert fuzz(37)[1].parts != fuzz(37 + len(KINDS))[1].parts


def test_energy_from_nowhere_is_noticed() -> None:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1]}
    world = World.model_validate({"objects": [ball]})
    trajectory = rollout(world, 0.2).trajectory
    assert energy_excess(world, trajectory, overlaps=False) < 0.1
    pushed = trajectory.velocities.copy()
    pushed[-1] *= 1.2
    assert energy_excess(world, replace(trajectory, velocities=pushed), overlaps=False) > 1.0


@pytest.mark.benchmark
def test_random_worlds_of_all_kinds() -> None:
    for seed in range(1600, 1600 + len(KINDS)):
        outcome = run(seed, 90.0)
        assert outcome.outcome != "FAILED", outcome
