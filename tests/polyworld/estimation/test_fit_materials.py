"""Parameters of deformable bodies found in shapes that were measured of them."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import shapes_only
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.readout import tracks_readout
from polyworld.estimation.study import Study
from polyworld.estimation.unknown import Unknown
from polyworld.pictures.render import look_at
from polyworld.probing.readouts import Centreline, ImageOccupancy, Readout, Tension, read
from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.parameters import with_parameters
from tests.polyworld.solver.fluid.scenes import plane_world, pool
from tests.polyworld.synthetic import of_one
from tests.verification.rope_world import held, rope, world

FRAME = 0.02
BENDING, DAMPING = "objects.rope.bending_stiffness", "objects.rope.linear_damping"
HIDDEN = {BENDING: 3.1e-3, DAMPING: 0.7}


def clamped(segments: int) -> World:
    """A rope that is clamped level at one end and falls."""
    side = {"motion_plane": {"normal": (0.0, -1.0, 0.0), "supports": False}}
    line = [[0, 0, 0], [0.6, 0, 0]]
    item = rope(line, segments, linear_density=0.05, stretch_stiffness=500.0, bending_stiffness=1e-3)
    made = world(item | {"representation": "rope_planar"}, attachments=[held("start", clamped=True)], environment=side)
    return made.model_copy(update={"time": made.time.model_copy(update={"seconds_per_frame": FRAME})})


def study(readout: Readout, described: World, hidden: World, frames: int, sigma: float) -> Study:
    """What a readout shows of the hidden world, with noise, to be explained by the world described."""
    seen = read(readout, hidden, simulator(hidden, np.arange(frames) * FRAME).run())[0]
    noisy = seen + np.random.default_rng(0).normal(0.0, sigma, seen.shape)
    there = np.isfinite(seen).all(axis=-1).astype(float)
    series = ShapeSeries(readout, noisy, np.full(there.shape, sigma), there)
    return of_one(described, shapes_only((series,), np.arange(frames), FRAME))


def logarithmic(path: str, start: float, lower: float, upper: float) -> Unknown:
    return Unknown(path, (path,), "", start, lower, upper, 2.0, scale="log")


def test_stiffness_and_damping_of_a_rope_are_found_though_the_model_is_coarser_than_the_data() -> None:
    """16 segments against 48, from two decades off."""
    unknowns = [logarithmic(BENDING, 3e-5, 1e-5, 1e-1), Unknown(DAMPING, (DAMPING,), "", 1.5, 0.0, 3.0, 0.75)]
    options = FitOptions(share=0.0, states=False, members=8, edit=lambda _: unknowns)
    line = Centreline(object="rope", count=9)
    found = fit(study(line, clamped(16), with_parameters(clamped(48), HIDDEN), 20, 0.002), options)
    for constant in found.constants:
        assert constant.value == pytest.approx(HIDDEN[constant.unknown.paths[0]], rel=0.1)
        assert constant.informed > 0.9
    assert found.cost < 0.1 * found.cost_start


def test_unknowns_by_default_are_those_of_the_material_and_keep_their_range_where_nothing_shows() -> None:
    names: list[str] = []

    def noted(unknowns: list[Unknown]) -> list[Unknown]:
        names.extend(u.name for u in unknowns)
        return [u for u in unknowns if u.name == "rope.bending_stiffness"]

    options = FitOptions(share=0.0, states=False, edit=noted)
    deaf = study(Tension(object="rope", at=0.5), clamped(16), clamped(16), 3, 1e5)
    (found,) = fit(deaf, options).constants
    assert {"rope.bending_stiffness", "rope.linear_damping"} <= set(names)
    assert found.unknown.scale == "log"
    assert found.informed < 0.5
    assert found.interval[1] > 100.0 * found.interval[0]


def test_masks_of_a_flowing_fluid_determine_its_viscosity() -> None:
    honey = pool("honey", (0.0, 0.0), (0.2, 0.2), viscosity=8.3, slip=False)
    fine, coarse = (
        plane_world(honey, size=(0.8, 0.3), cell=cell).model_copy(
            update={"camera": look_at(np.array([0.3, -1.2, 0.15]), np.array([0.3, 0.0, 0.1]), focal=400.0, width=320,
                                      height=160)}
        )
        for cell in (0.0125, 0.02)
    )  # fmt: skip
    factors = np.array([0.4, 0.7, 1.0, 1.4, 2.5])
    masks = study(ImageOccupancy(object="honey", columns=24, rows=12), coarse, fine, 15, 0.05)
    batch = simulator(coarse, np.arange(15) * FRAME, n_worlds=5).run({"objects.honey.viscosity": 8.3 * factors})
    readout = tracks_readout(coarse, masks.runs[0].tracks, np.zeros(0))
    losses = (readout.residuals(batch, 15) ** 2).sum(axis=1) / readout.size
    assert int(np.argmin(losses)) == 2
    assert losses[2] < 1.1
    assert losses[[0, 4]].min() > losses[2] + 0.2
