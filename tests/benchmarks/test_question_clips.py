"""Drawn scenes against closed forms, and their answers against programs run on their annotations."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks import question_clips
from tests.benchmarks.clevrer_programs import answer_choice, answer_words
from tests.benchmarks.question_clips.ask import Asker
from tests.benchmarks.question_clips.camera import homography, project
from tests.benchmarks.question_clips.pulleys import BELOW, RATE, Group, Part, simulate
from tests.benchmarks.question_clips.solids import draw
from tests.benchmarks.question_clips.solids import simulate as simulate_solids
from tests.benchmarks.question_clips.write_solids import FUTURE, LONGEST, annotation_of, cut
from tests.benchmarks.question_worlds import annotated

G = 9.81


def test_nothing_of_the_project_makes_the_scenes() -> None:
    for path in Path(question_clips.__file__).parent.glob("*.py"):
        assert not re.search(r"^(from|import) (polyworld|atw_mcp|evidence_store|tests)", path.read_text(), re.M)


def test_the_cameras_map_places_points_where_the_camera_does() -> None:
    points = np.array([[-1.0, 0.5, 0.2], [1.0, -0.7, 0.2]])
    u, v, depth = homography(0.2) @ np.column_stack([points[:, :2], np.ones(2)]).T
    np.testing.assert_allclose(np.column_stack([u / depth, v / depth]), project(points)[0], atol=1e-9)


def test_two_loads_over_a_wheel_fall_as_atwoods_machine() -> None:
    wheel = Part("pulley", "gray", (0.0, 2.0), 0.1)
    left, right = Part("cube", "red", (-0.1, 1.0), mass=0.5), Part("sphere", "blue", (0.1, 1.0), mass=0.6)
    run = simulate([Group("black", (left, wheel, right))], 16)
    fall = 0.5 * G * (0.1 / 1.1) * (15 / RATE) ** 2
    assert run.heights["blue sphere"][-1] - 1.0 == pytest.approx(-fall, rel=0.01)
    assert run.heights["red cube"][-1] - 1.0 == pytest.approx(fall, rel=0.01)
    assert run.turns["gray pulley"] == pytest.approx(fall / 0.1, rel=0.01)  # clockwise: the right side sinks


def test_a_load_under_a_movable_wheel_falls_half_as_fast_as_the_other_rises() -> None:
    under = Part("cube", "red", (0.1, 1.3 - BELOW), mass=1.4)
    loop = Part("movable", "pink", (0.1, 1.3), 0.1, load=under.name)
    parts = (Part("fixed", "brown", (0.0, 2.0)), loop, Part("pulley", "gray", (0.3, 2.0), 0.1))
    last = Part("sphere", "blue", (0.4, 1.0), mass=0.5)
    run = simulate([Group("black", (*parts, last), (under,))], 16)
    fall = 0.5 * G * (1.4 - 2 * 0.5) / (1.4 + 4 * 0.5) * (15 / RATE) ** 2
    assert run.heights["red cube"][-1] - run.heights["red cube"][0] == pytest.approx(-fall, rel=0.01)
    assert run.heights["blue sphere"][-1] - 1.0 == pytest.approx(2 * fall, rel=0.01)
    assert run.turns["pink pulley"] > 0.0 > run.turns["gray pulley"]


def test_what_collides_in_a_clip_is_in_view() -> None:
    clips = 0
    for seed in (4, 18):  # first draws of which had a collision out of view
        rng = np.random.default_rng([seed, 30])
        for _ in range(10):
            run = simulate_solids(*draw(rng), LONGEST + FUTURE)
            frames = cut(rng, run)
            if frames is not None:
                clips += 1
                assert all(run.visible[c.frame, list(c.pair)].all() for c in run.collisions if c.frame < frames)
    assert clips


def test_programs_on_the_annotation_give_the_answers_that_the_simulation_gave() -> None:
    frames, count = 100, 0
    for seed in range(3):
        rng = np.random.default_rng([seed, 30])
        solids, restitution = draw(rng)
        run = simulate_solids(solids, restitution, frames)
        known = annotated(annotation_of(seed, solids, run, frames))
        asker = Asker(rng, solids, restitution, run, frames)
        for question in [*asker.descriptive(), *asker.explanatory()]:
            count += 1
            if question["question_type"] == "descriptive":
                assert answer_words(question["program"], known) == question["answer"], question["question"]
            for choice in question.get("choices", []):
                said = answer_choice(question["program"], choice["program"], known)
                assert said == (choice["answer"] == "correct"), (question["question"], choice["choice"])
    assert count >= 9
