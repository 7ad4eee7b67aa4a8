"""Two to six discs that slide on a plane and collide, as a video shows them: 30 Hz, 2 mm, no spin measured.

The data come from an independent integrator, from event to event (SciPy), in `tests.scenes.discs`.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.catalogue import catalogue
from polyworld.gap.examine import fitted_base
from polyworld.gap.stepping import coarsened
from tests.polyworld.estimation.colliding_discs import FRICTION, RESTITUTION, SIGMA, recordings, scene, world
from tests.scenes.discs import Discs, Started, slide

Array = NDArray[np.float64]

OFFERED = ("quadratic_drag", "linear_drag", "tilt", "restitution_error", "friction_error", "mass_error", "magnus_lift")


def found(hidden: Discs, discs: Discs, starts: list[Started], seed: int) -> GapReport:
    data, held_out = recordings(hidden, starts, seed)
    offered = [catalogue()[n] for n in OFFERED]
    settings = GapSettings(null_control=False, experiment=False)
    return find_gap(world(discs, starts[0]), data, held_out=held_out, candidates=offered, settings=settings)


@pytest.mark.parametrize("count", [2, 6])
def test_base_fit_finds_spins_that_nobody_measured(count: int) -> None:
    """The spins show in how far each disc slides, and their signs only in how it leaves a collision."""
    discs, starts = scene(count, 1)
    data, _ = recordings(discs, starts, 1)
    described = world(discs, starts[0])
    plan = design(coarsened(described, data), data)
    base = fitted_base(plan, ())
    assert base.chi2 < 1.1 * plan.length
    assert base.passes


def test_collisions_without_anything_hidden_are_explained() -> None:
    discs, starts = scene(3, 2)
    report = found(discs, discs, starts, 2)
    assert report.verdict.kind == "nothing_missing"


def test_an_impact_two_samples_after_the_start_is_found() -> None:
    """The first samples are those behind the impact, but for two: taken for the start, no slope leads back."""
    rng = np.random.default_rng(0)
    discs = Discs(np.array([0.5, 0.8]), np.array([0.1, 0.08]), np.full(2, FRICTION), RESTITUTION)
    times = np.arange(61) / 60.0
    explained = 0
    for _ in range(8):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        speeds = np.array([rng.uniform(1.0, 2.0) * along, -rng.uniform(0.5, 2.0) * along])
        begin = Started(np.array([np.zeros(2), 0.18 * along]) - speeds * 1.9 / 60.0, speeds, rng.uniform(-5.0, 5.0, 2))
        flat = slide(discs, begin, times)
        places = np.zeros((len(times), 2, 3))
        places[..., :2] = flat[..., :2] + rng.normal(0.0, SIGMA, (len(times), 2, 2))
        half = 0.5 * (flat[..., 2] + rng.normal(0.0, 0.01, (len(times), 2)))
        turns = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1)
        described = world(discs, begin)
        plan = design(described, Recording((Run("r", ("disc0", "disc1"), times, places, turns),)))
        base = fitted_base(plan, ())
        explained += base.chi2 < 1.15 * plan.length
    assert explained >= 7
