"""Markers on deformable bodies: a recording by SciPy or a closed form is what the world's forward model says it is."""

from collections.abc import Callable

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.design import design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.unknown import Unknown
from tests.scenes.fluids import filling, filling_case, sinking_case, swaying_case
from tests.scenes.materials import Case, falling_case, rope_case, strip_case, swinging_case

Draw = Callable[[np.random.Generator, str | None], Case]


def residuals(case: Case) -> np.ndarray:
    """Simulated less recorded (m,) [m], without noise."""
    turns = np.full((*case.paths.shape[:2], 4), np.nan)
    plan = design(case.world, Recording((Run("run", case.markers, case.times, case.paths, turns),)))
    states = profile.start_states(plan)[0]
    return Forward(plan, case.world, ()).residuals([Settings(0, np.zeros((1, 0)), states[None])])[0][0]


def test_markers_of_a_rope_move_as_a_chain_of_masses_on_springs() -> None:
    assert np.abs(residuals(rope_case(np.random.default_rng(0), None))).max() < 5e-4


def test_markers_of_a_hanging_sheet_move_as_waves_along_a_strip() -> None:
    """Six squares along the length carry the lowest waves; of the 8 cm it sags, higher ones are half a millimetre."""
    assert np.abs(residuals(strip_case(np.random.default_rng(0), None))).max() < 1e-3


@pytest.mark.parametrize("truth", ["air_drag", "stretch_stiffness", "material_damping", "bending_stiffness"])
def test_wrong_number_of_a_rope_shows_beyond_the_noise(truth: str) -> None:
    case = rope_case(np.random.default_rng(0), truth)
    assert float(np.sqrt(np.mean(residuals(case) ** 2))) > 1.5 * case.sigma


@pytest.mark.parametrize(
    ("case", "share"),
    [(falling_case, 1.0), (swinging_case, 0.5), (sinking_case, 0.3), (swaying_case, 0.5), (filling_case, 0.6)],
)
def test_errors_of_a_scene_without_a_hidden_effect_stay_below_its_noise(case: Draw, share: float) -> None:
    described = case(np.random.default_rng(0), None)
    assert float(np.sqrt(np.mean(residuals(described) ** 2))) < share * described.sigma


def test_slope_by_the_rate_of_a_tap_shows_through_the_splashes() -> None:
    """Along the closed form's own slope, of the height of the centre by the rate, within 30%."""
    case = filling_case(np.random.default_rng(0), None)
    turns = np.full((len(case.times), 1, 4), np.nan)
    plan = design(case.world, Recording((Run("run", case.markers, case.times, case.paths, turns),)))
    noise = measured_noise(plan)
    rate = Unknown("rate", ("emitters.tap.rate",), "m^2/s", case.value, 0.0, 1.0, 0.3 * case.value)
    forward = Forward(plan, case.world, (rate,))
    slope = profile.linearise(forward, noise, np.array([case.value]), profile.start_states(plan)).a[0][:, 0]
    box = {"width": 0.3, "depth": 0.09, "height": 0.25}
    low, high = (filling(case.times, rate=q, speed=q / 0.06, **box) for q in (0.019, 0.021))
    described = noise.whiten(0, ((high - low) / 0.002)[None])[0]
    assert float(slope @ described / (described @ described)) == pytest.approx(1.0, abs=0.3)
