"""Real motion: a scene of CLEVRER by its annotations, made by another engine, and a cube tossed on a table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from polyworld.data.initial_states import with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fit import FitOptions, fit
from polyworld.world import StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane
from tests.polyworld.synthetic import of_one
from tests.scenes.clevrer_data import default_folder, default_world, read_scene
from tests.scenes.clevrer_events import score_collisions, simulated_collisions

CLEVRER, SCENE = default_folder(), "06000"
TOSSES = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "cube_toss"
UNIT = 0.0524  # [m], the data's unit of length: half the cube's width


@pytest.mark.skipif(not (CLEVRER / f"annotation_{SCENE}.json").exists(), reason="no CLEVRER data beside the repository")
def test_three_quarters_of_a_scene_are_followed_and_the_last_quarter_is_predicted() -> None:
    scene = read_scene(CLEVRER, SCENE)
    found = fit(of_one(default_world(scene.tracks, scene.kinds), scene.tracks), FitOptions(holdout=96)).runs[0]
    assert found.accuracy is not None
    assert found.held_out is not None
    # Published for another engine, fitted by CEM on all frames of such scenes: 0.0077 m at the median.
    assert found.accuracy.position < 0.0077
    assert found.held_out.position < 0.05
    score = score_collisions(simulated_collisions(found.world, 95), [c for c in scene.collisions if c.frame <= 95])
    assert (score.precision, score.recall) == (1.0, 1.0)


@pytest.mark.skipif(not (TOSSES / "cube_tosses.npz").exists(), reason="no cube_toss data beside the repository")
def test_a_tossed_cube_is_followed_in_position_and_rotation_and_gives_its_friction() -> None:
    rows = np.load(TOSSES / "cube_tosses.npz")["toss_000"]
    published = json.loads((TOSSES / "experiment.json").read_text())
    step, count = float(published["dt"]), len(rows)
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
    found = fit(of_one(with_initial_states(world, tracks), tracks), FitOptions(share=0.0))
    accuracy = found.runs[0].accuracy
    assert accuracy is not None
    # A tenth of the cube's width, through several impacts on corners and edges.
    assert accuracy.position < 0.2 * UNIT
    assert accuracy.rotation < 0.2
    assert found.constant("friction of cube").value == pytest.approx(published["mu"], abs=0.06)
