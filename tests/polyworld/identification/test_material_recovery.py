"""Parameters of ropes found by the engine in data of a finer rope; `tests.benchmarks.recovery` has all materials."""

from __future__ import annotations

import pytest

from polyworld.identification import CemSettings, FitSettings, RefineSettings, fit, refine
from tests.benchmarks.recovery_scenes import scenes

SCENES = {scene.name: scene for scene in scenes()}


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("rope", 0.06),  # 16 segments against 48: 3%
        ("rope over a pulley", 0.05),
    ],
)
def test_hidden_parameters_are_found_though_the_model_is_coarser_than_the_data(name: str, tolerance: float) -> None:
    scene = SCENES[name]
    world, data = scene.build(False), scene.observed(seed=0)
    search = FitSettings(generations=5, cem=CemSettings(population=16, elites=4, carried=2), horizon=(0.5, 1.0))
    found = fit(world, data, scene.unknowns, settings=search)
    values = {value.name: value.value for value in found.values}
    best = refine(world, data, scene.unknowns, values, settings=RefineSettings(iterations=4, batch=16))
    for value in best.values:
        assert value.value == pytest.approx(scene.hidden[value.paths[0]], rel=tolerance)
    assert not [u for u in best.undetermined if not u.reason.startswith("not fitted")]
    assert best.loss < 0.1 * best.loss_start
