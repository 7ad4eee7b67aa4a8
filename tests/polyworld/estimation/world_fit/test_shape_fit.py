"""Fits to shapes: a string's stiffness and damping are found from each kind of readout, within what is claimed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import ObservedTracks, shapes_only
from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    Objective,
    SearchSettings,
    Unknown,
    accuracy,
    default_unknowns,
    fit,
    refine,
)
from polyworld.estimation.world_fit.determinable import reasons_undeterminable
from polyworld.probing.readouts import (
    Centreline,
    Curve,
    Front,
    ImageOccupancy,
    Markers,
    Outline,
    Readout,
    Tension,
    read,
)
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.camera import Camera
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Sphere
from tests.polyworld.estimation.world_fit.closed_string import LENGTH, ClosedString
from tests.polyworld.synthetic import camera_above

Array = NDArray[np.float64]
STIFFNESS, DAMPING = 437.0, 0.6
FRAMES = np.arange(40)
SIDE = Camera(  # looks along +y at the plane of the motion, from 4 m
    **{
        **camera_above(),
        "rotation": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
        "translation": (-1.0, 0.0, 4.0),
    }
)


def string(segments: int = 24, **fields: Any) -> World:
    rope = Rope(
        name="string",
        points=((0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)),
        segments=segments,
        radius=0.02,
        **{"stretch_stiffness": 150.0, "linear_damping": 0.2, **fields},
    )
    return World(deformables=(rope,), time=TimeBase(seconds_per_frame=0.02), camera=SIDE)


def observed(readout: Readout, sigma: float, seed: int = 2, values: Array | None = None) -> ObservedTracks:
    """Return observations of a string of finer division, with noise."""
    truth = string(61, stretch_stiffness=STIFFNESS, linear_damping=DAMPING)
    batch = ClosedString(truth, FRAMES * 0.02, n_worlds=1).run()
    exact = read(readout, truth, batch, values)[0]
    noisy = exact + sigma * np.random.default_rng(seed).normal(size=exact.shape)
    shape = exact.shape[:2]
    series = ShapeSeries(readout, noisy, np.full(shape, sigma), np.ones(shape))
    return shapes_only((series,), FRAMES, 0.02)


UNKNOWNS = [
    Unknown("EA", ("objects.string.stretch_stiffness",), "", 300.0, 10.0, 1e4, 1.2, scale="log"),
    Unknown("c", ("objects.string.linear_damping",), "", 0.5, 0.0, 2.0, 0.4),
]
SETTINGS = SearchSettings(generations=16, cem=CemSettings(population=32, elites=8), seed=1)


@pytest.mark.parametrize(
    ("readout", "sigma"),
    [
        (Markers(object="string", at=((0.5, 0.0, 0.0), (1.013, 0.0, 0.0))), 0.005),
        (Markers(object="string", at=((0.7, 0.0, 0.0),), view="image"), 1.0),
        (Centreline(object="string", count=9), 0.005),
        (Centreline(object="string", count=9, view="image"), 1.0),
        (Outline(object="string", directions=((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)), view="image"), 1.0),
        (Front(object="string"), 0.005),
        (ImageOccupancy(object="string", columns=20, rows=15), 0.05),
    ],
)
def test_hidden_parameters_are_found_within_three_standard_errors(readout: Readout, sigma: float) -> None:
    tracks = observed(readout, sigma)
    world = string()
    found = fit(FitProblem(world, tracks, UNKNOWNS, make_simulator=ClosedString), SETTINGS)
    start = found.by_name
    polished = refine(FitProblem(world, tracks, UNKNOWNS, make_simulator=ClosedString), start)
    best = polished if polished.loss < found.loss else found
    assert best.undetermined == ()
    stiffness, damping = best.value("EA"), best.value("c")
    assert abs(stiffness.value - STIFFNESS) < max(3.0 * stiffness.standard_error, 0.004 * STIFFNESS)
    assert abs(damping.value - DAMPING) < max(3.0 * damping.standard_error, 0.02)
    assert stiffness.standard_error < 0.1 * STIFFNESS
    assert best.loss == pytest.approx(1.0, abs=0.45)  # of one series of 40 numbers: two standard deviations


def test_a_parameter_that_no_readout_shows_is_said_to_be_undetermined() -> None:
    unknowns = [
        *UNKNOWNS,
        Unknown("EI", ("objects.string.bending_stiffness",), "", 1e-3, 1e-6, 1e-1, 2.0, scale="log"),
    ]
    found = fit(
        FitProblem(string(), observed(Front(object="string"), 0.01), unknowns, make_simulator=ClosedString), SETTINGS
    )
    assert [u.parameters for u in found.undetermined] == [("EI",)]
    assert "no observation" in found.undetermined[0].reason


def test_frames_held_out_are_judged_by_their_shapes() -> None:
    tracks = observed(Centreline(object="string", count=9), 0.01)
    found = fit(
        FitProblem(string(), tracks, UNKNOWNS, holdout_from=25, make_simulator=ClosedString),
        SearchSettings(generations=14, cem=CemSettings(population=32, elites=8)),
    )
    assert found.accuracy_start is not None
    assert found.held_out is not None
    assert found.fitted_frames == (0, 24)
    # Per component noise is 0.01 m, of three components.
    assert found.held_out.shape_by_readout["string"]["centreline"] == pytest.approx(0.01 * np.sqrt(3.0), rel=0.2)
    assert found.held_out.shape_score == pytest.approx(1.0, abs=0.15)
    assert found.accuracy_start.shape_score > 3.0


def test_a_centreline_without_direction_may_be_observed_from_either_end() -> None:
    line = Centreline(object="string", count=5)
    tracks = observed(line, 0.01)
    series = tracks.shapes[0]
    turned = series.values.copy()
    turned[::2] = turned[::2, ::-1]  # and not even the same one in every frame
    batch = ClosedString(string(stretch_stiffness=STIFFNESS, linear_damping=DAMPING), FRAMES * 0.02, n_worlds=2).run()

    def loss(readout: Centreline, values: Array) -> float:
        one = ShapeSeries(readout, values, series.sigma, series.confidence)
        return float(Objective(string(), shapes_only((one,), FRAMES, 0.02)).losses(batch)[1])

    free = line.model_copy(update={"directed": False})
    assert loss(free, turned) == pytest.approx(loss(line, series.values), rel=1e-9)
    assert loss(line, turned) > 100.0


def test_a_part_of_a_curve_is_compared_by_nearest_points() -> None:
    truth = string(61, stretch_stiffness=STIFFNESS, linear_damping=DAMPING)
    batch = ClosedString(truth, FRAMES * 0.02, n_worlds=1).run()
    part = read(Centreline(object="string", count=21), truth, batch)[0, :, 4:9]  # a fifth of it was seen
    tracks = observed(Curve(object="string", count=5), 0.005, values=part)
    objective = Objective(string(), tracks)
    right = ClosedString(string(stretch_stiffness=STIFFNESS, linear_damping=DAMPING), FRAMES * 0.02, n_worlds=1).run()
    wrong = ClosedString(string(stretch_stiffness=2.0 * STIFFNESS), FRAMES * 0.02, n_worlds=1).run()
    assert objective.losses(right)[0] < 1.2
    assert objective.losses(wrong)[0] > 5.0


def test_readouts_that_do_not_fit_the_world_are_refused_with_what_does() -> None:
    scalar = observed(Tension(object="string"), 0.1)
    ball = World(objects=(RigidObject(name="string", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.0)),))
    with pytest.raises(KeyError, match="unknown deformable object"):
        Objective(ball, scalar)
    blind = string().model_copy(update={"camera": None})
    with pytest.raises(ValueError, match="no camera"):
        Objective(blind, observed(ImageOccupancy(object="string", columns=4, rows=4), 0.1))


def test_default_unknowns_suit_the_material_and_loads_on_a_rope_have_masses_to_fit() -> None:
    loads = tuple(
        RigidObject(name=n, shape=Sphere(radius=0.05), position=(x, 0.0, 0.0), representation="rigid_spatial")
        for n, x in (("left", 0.0), ("right", LENGTH))
    )
    ties = (
        Attachment(name="tie_left", object="string", end="start", to="left"),
        Attachment(name="tie_right", object="string", end="end", to="right"),
    )
    world = string().model_copy(update={"objects": loads, "attachments": ties})
    count = len(FRAMES)
    tracks = ObservedTracks(
        names=("left", "right"),
        frames=FRAMES,
        seconds_per_frame=0.02,
        positions=np.tile([[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]], (count, 1, 1)),
        position_sigma=np.full((count, 2), 0.01),
        orientations=np.full((count, 2, 4), np.nan),
        confidence=np.ones((count, 2)),
        orientation_confidence=np.zeros((count, 2)),
        symmetry=(0, 0),
    )
    names = [p.name for p in default_unknowns(world, tracks, initial_conditions=False)]
    assert "string.bending_stiffness" in names
    assert "string.linear_damping" in names
    assert "right.mass" in names
    assert "left.mass" not in names  # the unit
    scales = {p.name: p.scale for p in default_unknowns(world, tracks)}
    assert scales["string.bending_stiffness"] == "log"
    assert "objects.right.mass" not in reasons_undeterminable(world, tracks)
    chosen = default_unknowns(world, tracks, materials=("stretch_stiffness",), each=(), shared=())
    assert [p.name for p in chosen if p.name.startswith("string")] == ["string.stretch_stiffness"]
    with pytest.raises(ValueError, match="choices"):
        default_unknowns(world, tracks, materials=("colour",))


def test_accuracy_of_shapes_is_in_their_own_unit() -> None:
    tracks = observed(Tension(object="string", at=0.5), 0.05)
    right = string(stretch_stiffness=STIFFNESS)
    batch = ClosedString(right, FRAMES * 0.02, n_worlds=1).run()
    found = accuracy(right, tracks, batch.world(0))
    assert found.shape_by_readout["string"]["tension"] == pytest.approx(0.05, rel=0.3)
    assert found.samples == 0
    assert found.to_dict()["position_rmse"] is None


def test_a_tracked_soft_body_beside_a_rigid_one_takes_part_in_the_default_unknowns() -> None:
    ball = Soft(name="ball", representation="soft_planar", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.5))
    stone = RigidObject(name="stone", representation="rigid_planar", shape=Sphere(radius=0.1), position=(1.0, 0.0, 0.5))
    world = World(
        objects=(stone,),
        deformables=(ball,),
        environment=Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False)),
    )
    time = 0.04 * FRAMES
    fall = 0.5 - 0.5 * 9.81 * time**2
    places = np.stack([np.stack([x + 0.3 * time, 0.0 * time, fall], axis=1) for x in (0.0, 1.0)], axis=1)
    count = len(FRAMES)
    tracks = ObservedTracks(
        names=("ball", "stone"),
        frames=FRAMES,
        seconds_per_frame=0.04,
        positions=places + 0.001 * np.random.default_rng(0).normal(size=places.shape),
        position_sigma=np.full((count, 2), 0.001),
        orientations=np.full((count, 2, 4), np.nan),
        confidence=np.ones((count, 2)),
        orientation_confidence=np.zeros((count, 2)),
        symmetry=(0, 0),
    )
    names = {p.name for p in default_unknowns(world, tracks)}
    assert {"ball.youngs_modulus", "ball.damping", "ball.shift.x", "ball.velocity.z", "stone.velocity.x"} <= names
    assert not {n for n in names if n.endswith(".y")}  # across the plane
