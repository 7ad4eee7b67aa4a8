"""Counts of the foresight benchmark, and how it puts clips to the tools."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from atw_mcp.tools.known_objects import KnownObject
from polyworld.edits.interventions import Intervention, branch
from polyworld.world import World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from tests.benchmarks.foresight.__main__ import calibration_error
from tests.benchmarks.foresight.edits import edits_of
from tests.benchmarks.foresight.run import Answered
from tests.benchmarks.foresight.scene import Clip, video_arguments


def answers(pairs: list[tuple[float, bool]]) -> list[Answered]:
    return [Answered(k, "left", "end", truth, p) for k, (p, truth) in enumerate(pairs)]


def test_stated_probabilities_that_come_true_as_often_have_no_calibration_error() -> None:
    assert calibration_error(answers([(0.75, True)] * 3 + [(0.75, False)])) == pytest.approx(0.0)
    assert calibration_error(answers([(0.25, False)] * 3 + [(0.25, True)])) == pytest.approx(0.0)
    assert calibration_error(answers([(1.0, True)] * 5)) == pytest.approx(0.0)


def test_sure_answers_that_are_wrong_are_off_by_their_share() -> None:
    assert calibration_error(answers([(1.0, True)] * 3 + [(1.0, False)])) == pytest.approx(0.25)
    mixed = answers([(1.0, True)] * 2 + [(1.0, False)] * 2 + [(0.7, True)] * 7 + [(0.7, False)] * 3)
    assert calibration_error(mixed) == pytest.approx(0.5 * 4 / 14)


def clip(kind: str = "floor") -> Clip:
    seen = {
        "name": "A",
        "shape": "sphere",
        "diameter": 0.2,
        "color": "red",
        "pointed_at": {"frame": 7, "pixel": [3, 5]},
    }
    other = {"name": "B", "shape": "box", "size": [0.2, 0.1, 0.1], "color": "blue"}
    known = {
        "video": "clip.mp4",
        "seconds_per_frame": 0.04,
        "objects": [seen, other],
        "camera_points": {"points": [{"position": [0.0, 0.0, 0.0], "pixel": [10.0, 20.0]}]},
    }
    return Clip("00_floor", Path(), known, {"kind": kind})


def test_a_body_pointed_at_in_a_later_frame_is_pointed_at_there() -> None:
    objects = [KnownObject.model_validate(item) for item in video_arguments(clip())["objects"]]
    assert [(item.name, item.pixel, item.frame) for item in objects] == [("A", [3, 5], 7), ("B", None, None)]


def state(velocity: list[float], spin: list[float]) -> dict[str, object]:
    return {"name": "A", "initial_state": {"velocity": velocity, "angular_velocity": spin, "position": [1.0, 2.0, 0.1]}}


def test_turning_a_rolling_ball_keeps_it_rolling() -> None:
    """A quarter turn about z takes x to y: rolling without slip along +x is a spin about +y, along +y about -x."""
    inspected = {"objects": [state([1.0, 0.0, 0.0], [0.0, 10.0, 0.0])], "joints": []}
    (edit,) = edits_of(clip(), inspected, {"op": "turn", "body": "A", "factor": 90.0})
    ball = RigidObject(
        name="A",
        shape=Sphere(radius=0.1),
        representation="rigid_spatial",
        position=(0.0, 0.0, 0.1),
        velocity=(1.0, 0.0, 0.0),
        angular_velocity=(0.0, 10.0, 0.0),
    )
    turned = branch(World(objects=(ball,)), [TypeAdapter(Intervention).validate_python(edit)]).object("A")
    assert turned.velocity == pytest.approx((0.0, 1.0, 0.0))
    assert np.allclose(np.cross(turned.angular_velocity, [0.0, 0.0, 0.1]), turned.velocity)


def test_a_raised_body_moves_up_and_damping_is_that_of_joints_and_bodies() -> None:
    world = {"objects": [state([0.0] * 3, [0.0] * 3)], "joints": [{"name": "pivot_A"}]}
    (edit,) = edits_of(clip(), world, {"op": "raise", "body": "A", "factor": 0.3})
    assert edit["shift"] == [0.0, 0.0, 0.3]
    paths = [e["path"] for e in edits_of(clip("pendulum"), world, {"op": "damping", "body": "", "factor": 2.0})]
    assert paths == ["joints.pivot_A.friction", "joints.pivot_A.damping", "objects.A.linear_damping"]
