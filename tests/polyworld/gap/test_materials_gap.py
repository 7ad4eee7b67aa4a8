"""Markers on deformable bodies: a recording by SciPy or a closed form is what the world's forward model says it is."""

from collections.abc import Callable

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.noise import RunNoise
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.ground import Ground
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.report import effects_of
from tests.scenes.fluids import filling_case, sinking_case
from tests.scenes.materials import Case, falling_case, rope_case, strip_case, swinging_case

Draw = Callable[[np.random.Generator, str | None], Case]


def residuals(case: Case) -> np.ndarray:
    """Simulated less recorded (m,) [m], without noise."""
    count = len(case.markers)
    run = Run("run", case.markers, case.times, case.paths, np.full((len(case.times), count, 4), np.nan))
    metre = RunNoise(*(np.ones((count, 3)) for _ in range(3)))
    problem = Ground(case.world, Recording((run,)), GapSettings(), (metre,)).problem(Hypothesis(case.world))
    found: np.ndarray = problem.linearised(problem.start(), 1.0)[0].residuals
    return found


def test_markers_of_a_rope_move_as_a_chain_of_masses_on_springs() -> None:
    assert np.abs(residuals(rope_case(np.random.default_rng(0), None))).max() < 5e-4


def test_markers_of_a_hanging_sheet_move_as_waves_along_a_strip() -> None:
    """Six squares along the length carry the lowest waves; of the 8 cm it sags, higher ones are half a millimetre."""
    assert np.abs(residuals(strip_case(np.random.default_rng(0), None))).max() < 1e-3


@pytest.mark.parametrize("truth", ["air_drag", "bending_stiffness"])
def test_wrong_number_of_a_rope_shows_beyond_the_noise(truth: str) -> None:
    case = rope_case(np.random.default_rng(0), truth)
    assert float(np.sqrt(np.mean(residuals(case) ** 2))) > 1.5 * case.sigma


@pytest.mark.parametrize(
    ("case", "share"),
    [(falling_case, 1.0), (swinging_case, 0.5), (sinking_case, 0.3), (filling_case, 0.6)],
)
def test_errors_of_a_scene_without_a_hidden_effect_stay_below_its_noise(case: Draw, share: float) -> None:
    described = case(np.random.default_rng(0), None)
    assert float(np.sqrt(np.mean(residuals(described) ** 2))) < share * described.sigma


@pytest.mark.benchmark  # ten seconds; `gaps materials` does it of every material
def test_stiffness_of_a_rope_is_found() -> None:
    case = rope_case(np.random.default_rng(0), "stretch_stiffness")
    recording, _ = case.recordings(np.random.default_rng(1))
    offered = named(["stretch_stiffness", "gravity_error"])
    early = Recording(tuple(r.rows(r.times < 0.6) for r in recording.runs))
    report = find_gap(case.world, early, candidates=offered)
    assert (report.verdict.kind, report.names) == ("identified", ("stretch_stiffness",))
    (unknown,) = effects_of(report.verdict.best)[0]["unknowns"].values()
    low, high = unknown["interval95"]
    assert abs(unknown["value"] - case.value) < high - low
