"""Branches: what an edit changes, what it leaves, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from polyworld.edits.interventions import (
    Add,
    ChangeEnvironment,
    Intervention,
    Move,
    Remove,
    ScaleVelocity,
    SetParameter,
    SetVelocity,
    ToggleEffect,
    branch,
)
from polyworld.solver.rollout import rollout
from polyworld.world import Effect, Environment, StaticObject, World
from polyworld.world.shapes import Sphere, Wall
from tests.verification.planar_scenes import body, disc, top_view


def world() -> World:
    red = body("red", disc(), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0), friction=0.1)
    blue = body("blue", disc(), (0.0, 0.0, 0.2), friction=0.123)
    effects = (
        Effect(name="wind", kind="uniform_acceleration", parameters={"x": 0.5}, objects=("red",)),
        Effect(name="air", kind="linear_drag", parameters={"coefficient": 0.5}, objects=("red", "blue")),
    )
    wall = StaticObject(name="wall", shape=Wall(start=(2.0, -2.0, 0.0), end=(2.0, 2.0, 0.0)))
    return top_view(red, blue, effects=effects, statics=(wall,))


def test_removing_an_object_takes_it_out_of_the_effects_and_drops_those_left_with_none() -> None:
    other = branch(world(), [Remove(object="red")])
    assert [o.name for o in other.objects] == ["blue"]
    assert [(e.name, e.objects) for e in other.effects] == [("air", ("blue",))]


def test_a_removed_striker_leaves_its_target_alone() -> None:
    hit = rollout(world(), 2.0)
    spared = rollout(branch(world(), [Remove(object="red")]), 2.0)
    assert any(e.kind == "contact_begin" and e.participants == ("blue", "red") for e in hit.events)
    assert not spared.events
    assert spared.trajectory.positions[-1, 0].tolist() == [0.0, 0.0, 0.2]


def test_edits_apply_in_their_order() -> None:
    green = body("green", disc(), (0.0, 3.0, 0.2))
    other = branch(
        world(),
        [
            Add(object=green),
            Move(object="green", position=(0.0, 4.0, 0.2)),
            SetParameter(path="objects.green.friction", value=0.7),
            Remove(object="blue"),
            ToggleEffect(effect="wind", enabled=False),
            ChangeEnvironment(gravity=(0.0, 0.0, -1.62), plane_friction=0.3),
        ],
    )
    assert other.object("green").position == (0.0, 4.0, 0.2)
    assert other.object("green").friction == 0.7
    assert [e.enabled for e in other.effects] == [False, True]
    assert other.environment.gravity == (0.0, 0.0, -1.62)
    assert other.environment.motion_plane.friction == 0.3


def test_edits_relative_to_the_world_change_what_it_has() -> None:
    """A quarter turn about z takes x to y; the angular velocity of a rolling ball turns with its velocity."""
    ball = body("ball", Sphere(radius=0.1), (1.0, 2.0, 0.1)).model_copy(
        update={
            "representation": "rigid_spatial",
            "velocity": (0.5, 0.0, 0.0),
            "angular_velocity": (0.0, 5.0, 0.0),
        }
    )
    before = World(objects=(ball,), environment=Environment(gravity=(0.0, 0.0, -8.0)))
    quarter = (0.0, 0.0, np.pi / 2)
    after = branch(
        before,
        [
            Move(object="ball", shift=(0.0, 0.0, 0.2), turn=quarter),
            ScaleVelocity(object="ball", factor=2.0, turn=quarter),
            ChangeEnvironment(gravity_factor=1.25),
        ],
    )
    moved = after.object("ball")
    np.testing.assert_allclose(moved.position, (1.0, 2.0, 0.3))
    np.testing.assert_allclose(moved.orientation, (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    np.testing.assert_allclose(moved.velocity, (0.0, 1.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(moved.angular_velocity, (-10.0, 0.0, 0.0), atol=1e-14)
    np.testing.assert_allclose(after.environment.gravity, (0.0, 0.0, -10.0))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Remove(object="pink"), r"edit 1 \(remove\): no object or static is called 'pink'; objects: \['red', 'blue'\]"),
        (Move(object="wall", position=(0.0, 0.0, 0.0)), r"'wall' is static and cannot move; objects that can: \['red'"),
        (Move(object="pink", position=(0.0, 0.0, 0.0)), r"no object is called 'pink'; objects: \['red', 'blue'\]"),
        (SetVelocity(object="wall", velocity=(1.0, 0.0, 0.0)), "'wall' is static"),
        (SetParameter(path="objects.red.restitution", value=1.5), "outside its bounds 0.0 to 1.0"),
        (SetParameter(path="objects.red.fluff", value=1.0), r"unknown parameter 'objects.red.fluff'; choices: \["),
        (ToggleEffect(effect="storm", enabled=True), r"no effect is called 'storm'; effects of this world: \['wind'"),
        (Add(object=body("red", disc(), (0.0, 0.0, 0.2))), r"the name 'red' is taken; names in use: \['red', 'blue'"),
        (
            Add(
                object=body("ball", Sphere(radius=0.1), (0, 0, 1)).model_copy(
                    update={"representation": "rigid_spatial"}
                )
            ),
            "give all objects planar or all objects spatial representations",
        ),
    ],
)
def test_an_impossible_edit_names_the_valid_choices(edit: Intervention, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        branch(world(), [edit])


@pytest.mark.parametrize(
    "data",
    [
        {"action": "move", "object": "red"},
        {"action": "set_velocity", "object": "red"},
        {"action": "environment"},
        {"action": "environment", "gravity": [0.0, 0.0, -1.0], "gravity_factor": 2.0},
        {"action": "move", "object": "red", "position": [0.0, 0.0, 0.0], "shift": [0.0, 0.0, 1.0]},
        {"action": "add"},
        {"action": "explode", "object": "red"},
        {"action": "remove", "object": "red", "why": "fun"},
    ],
)
def test_an_edit_that_says_nothing_or_too_much_is_refused(data: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Intervention).validate_python(data)


def test_edits_survive_json() -> None:
    adapter = TypeAdapter(Intervention)
    for edit in (
        Remove(object="red"),
        Add(object=body("g", disc(), (0.0, 3.0, 0.2))),
        ChangeEnvironment(gravity=(0, 0, -1)),
    ):
        assert adapter.validate_json(edit.model_dump_json()) == edit
