"""Parameters of deformable bodies found in data of a finer model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.readout import tracks_readout
from polyworld.estimation.unknown import Unknown
from polyworld.pictures.render import look_at
from polyworld.probing.readouts import ImageOccupancy, Tension
from polyworld.solver.rollout import simulator
from polyworld.world import World
from tests.polyworld.synthetic import of_one
from tests.scenes.material_parameters import Scene, scenes

SCENES = {scene.name: scene for scene in scenes()}


def shorter(name: str, frames: int, start: float) -> Scene:
    """A scene of fewer frames, whose first unknown starts elsewhere."""
    scene = SCENES[name]
    return replace(scene, frames=frames, unknowns=[replace(scene.unknowns[0], start=start), *scene.unknowns[1:]])


@pytest.mark.parametrize(
    ("name", "frames", "start", "tolerance"),
    [
        ("rope", 20, 3e-5, 0.1),  # two decades off; 16 segments against 48
        pytest.param("rope over a pulley", 20, 0.4, 0.05, marks=pytest.mark.benchmark),
        pytest.param("cloth", 40, 15.0, 0.15, marks=pytest.mark.benchmark),
        pytest.param("soft body", 40, 4.2e4, 0.08, marks=pytest.mark.benchmark),
        pytest.param("viscous fluid", 24, 0.5, 0.1, marks=pytest.mark.benchmark),
        pytest.param("floating disc", 24, 3500.0, 0.1, marks=pytest.mark.benchmark),
        pytest.param("tap", 30, 0.25, 0.1, marks=pytest.mark.benchmark),
    ],
)
def test_hidden_parameters_are_found_though_the_model_is_coarser_than_the_data(
    name: str, frames: int, start: float, tolerance: float
) -> None:
    scene = shorter(name, frames, start)
    options = FitOptions(share=0.0, states=False, members=8, edit=lambda _: list(scene.unknowns))
    found = fit(of_one(scene.build(False), scene.observed(seed=0)), options)
    for constant in found.constants:
        assert constant.value == pytest.approx(scene.hidden[constant.unknown.paths[0]], rel=tolerance)
        assert constant.informed > 0.9
    assert found.cost < 0.1 * found.cost_start


def test_unknowns_by_default_are_those_of_the_material_and_keep_their_range_where_nothing_shows() -> None:
    scene = replace(SCENES["rope"], frames=3, readouts=[(Tension(object="rope", at=0.5), 1e5)])
    names: list[str] = []

    def noted(unknowns: list[Unknown]) -> list[Unknown]:
        names.extend(u.name for u in unknowns)
        return [u for u in unknowns if u.name == "rope.bending_stiffness"]

    options = FitOptions(share=0.0, states=False, edit=noted)
    (found,) = fit(of_one(scene.build(False), scene.observed(seed=0)), options).constants
    assert {"rope.bending_stiffness", "rope.linear_damping"} <= set(names)
    assert found.unknown.scale == "log"
    assert found.informed < 0.5
    assert found.interval[1] > 100.0 * found.interval[0]


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
    batch = simulator(seen(False), np.arange(12) * column.seconds_per_frame, n_worlds=5).run({path: hidden * factors})
    readout = tracks_readout(seen(False), masks.observed(seed=0), np.zeros(0))
    losses = (readout.residuals(batch, 12) ** 2).sum(axis=1) / readout.size
    assert int(np.argmin(losses)) == 2
    assert losses[2] < 1.1
    assert losses[[0, 4]].min() > losses[2] + 0.2
