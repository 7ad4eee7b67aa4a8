"""A real toss: an acrylic cube thrown on a table, by motion capture, with published friction and restitution."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from polyworld.data.initial_states import with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    FitProblem,
    ObjectiveSettings,
    SearchSettings,
    default_unknowns,
    fit,
    refine,
)
from polyworld.world import StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane

FOLDER = Path(__file__).resolve().parents[4].parent / "shared" / "data" / "cube_toss"
UNIT = 0.0524  # [m], the data's unit of length: half the cube's width


@pytest.mark.skipif(not (FOLDER / "cube_tosses.npz").exists(), reason="no cube_toss data beside the repository")
def test_a_tossed_cube_is_followed_in_position_and_rotation_and_gives_its_friction() -> None:
    rows = np.load(FOLDER / "cube_tosses.npz")["toss_000"]
    published = json.loads((FOLDER / "experiment.json").read_text())
    step = float(published["dt"])
    count = len(rows)
    tracks = ObservedTracks(
        names=("cube",),
        frames=np.arange(count),
        seconds_per_frame=step,
        positions=rows[:, None, :3] * UNIT,
        position_sigma=np.full((count, 1), 0.001),
        orientations=rows[:, None, 3:7],
        confidence=np.ones((count, 1)),
        orientation_confidence=np.ones((count, 1)),
        symmetry=(1,),
    )
    cube = RigidObject(name="cube", shape=Box(half_extents=(UNIT,) * 3), mass=published["mass"], position=(0, 0, 0.3))
    world = World(
        objects=(cube,),
        statics=(StaticObject(name="table", shape=Plane()),),
        time=TimeBase(seconds_per_frame=step, substep=step / 2),
    )
    world = with_initial_states(world, tracks)
    parameters = default_unknowns(world, tracks, shared=(), each=("friction", "restitution"))
    objective = ObjectiveSettings(position_tolerance=0.005)
    found = fit(FitProblem(world, tracks, parameters, objective=objective), SearchSettings(generations=24))
    result = refine(FitProblem(world, tracks, parameters, objective=objective), found.by_name)
    assert result.accuracy is not None
    # A tenth of the cube's width, through several impacts on corners and edges.
    assert result.accuracy.position < 0.2 * UNIT
    assert result.accuracy.rotation < 0.2
    assert result.value("cube.friction").value == pytest.approx(published["mu"], abs=0.06)
