"""Parameters of ropes found by the engine in data of a finer rope; `tests.benchmarks.recovery` has all materials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    Objective,
    SearchSettings,
    fit,
    refine,
)
from polyworld.pictures.render import look_at
from polyworld.probing.readouts import ImageOccupancy
from polyworld.solver.rollout import simulator
from polyworld.world import World
from tests.scenes.material_parameters import scenes

SCENES = {scene.name: scene for scene in scenes()}


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("rope", 0.06),  # 16 segments against 48: 3%
        pytest.param("rope over a pulley", 0.05, marks=pytest.mark.benchmark),
    ],
)
def test_hidden_parameters_are_found_though_the_model_is_coarser_than_the_data(name: str, tolerance: float) -> None:
    scene = SCENES[name]
    world, data = scene.build(False), scene.observed(seed=0)
    search = SearchSettings(generations=5, cem=CemSettings(population=16, elites=4, carried=2), horizon=(0.5, 1.0))
    found = fit(FitProblem(world, data, scene.unknowns), search)
    values = found.by_name
    best = refine(FitProblem(world, data, scene.unknowns), values, iterations=4)
    for value in best.values:
        assert value.value == pytest.approx(scene.hidden[value.paths[0]], rel=tolerance)
    assert not [u for u in best.undetermined if not u.reason.startswith("not fitted")]
    assert best.loss < 0.1 * best.loss_start


def test_masks_of_a_flowing_fluid_determine_its_viscosity() -> None:
    column = SCENES["viscous fluid"]
    camera = look_at(np.array([0.3, -1.2, 0.15]), np.array([0.3, 0.0, 0.1]), focal=400.0, width=320, height=160)

    def seen(fine: bool) -> World:
        return column.build(fine).model_copy(update={"camera": camera})

    masks = replace(
        column, build=seen, frames=12, readouts=[(ImageOccupancy(object="honey", columns=24, rows=12), 0.05)]
    )
    (path, hidden), *_ = column.hidden.items()
    factors = np.array([0.4, 0.7, 1.0, 1.4, 2.5])
    world = seen(False)
    batch = simulator(world, np.arange(12) * column.seconds_per_frame, n_worlds=5).run({path: hidden * factors})
    losses = Objective(world, masks.observed(seed=0)).losses(batch)
    assert int(np.argmin(losses)) == 2
    assert losses[2] < 1.1
    assert losses[[0, 4]].min() > losses[2] + 0.2
