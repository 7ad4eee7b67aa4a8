"""Members of an ensemble: one batch gives what each of them gives alone, whatever was edited."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.edits.interventions import (
    Move,
    Remove,
    ScaleParameter,
    ScaleVelocity,
    SetVelocity,
    branch,
)
from polyworld.probing.ensemble import differences, member_worlds, roll_out_members
from polyworld.probing.ensemble_statistics import Probability, decisive_split, interval_of, relations
from polyworld.solver.rollout import rollout
from polyworld.world import StaticObject, World
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Box, Plane
from tests.atw_mcp.two_discs import two_discs
from tests.polyworld.sliding_block import block_world, stopping_distance


def test_members_in_a_batch_move_as_each_of_them_alone() -> None:
    start = two_discs()
    values = {
        "objects.striker.velocity.x": np.array([0.8, 1.0, 1.3]),
        "objects.target.mass": np.array([0.5, 1.0, 2.0]),
        "objects.target.restitution": np.array([0.2, 0.9, 1.0]),
    }
    edits = [ScaleVelocity(object="striker", factor=1.5)]
    members = member_worlds(start, values, edits)
    batch = roll_out_members(branch(start, edits), members, values, 1.0)
    for member, together in zip(members, batch, strict=True):
        alone = rollout(member, 1.0)
        assert together.world_id == member.id
        assert together.trajectory.positions == pytest.approx(alone.trajectory.positions, abs=1e-9)
        assert [e.kind for e in together.events] == [e.kind for e in alone.events]


@pytest.mark.parametrize(
    "edits",
    [
        [],
        [Remove(object="other")],
        [SetVelocity(object="box", velocity=(1.0, 0.0, 0.0))],
        [Move(object="box", position=(1.0, 2.0, 3.0))],
        [Move(object="box", shift=(0.0, 0.0, 0.2), turn=(0.0, 0.3, 0.0))],
        [ScaleVelocity(object="box", turn=(0.0, 0.0, 0.5))],
        [ScaleParameter(path="objects.box.friction", factor=0.5), ScaleVelocity(object="other", factor=0.0)],
    ],
)
def test_differences_rebuild_every_member_after_an_edit(edits: list[Any]) -> None:
    shape = Box(half_extents=(0.1, 0.05, 0.02))
    start = World(
        objects=(
            RigidObject(name="box", shape=shape, position=(0.0, 0.0, 1.0), velocity=(0.3, 0.0, 0.0)),
            RigidObject(name="other", shape=shape, position=(1.0, 0.0, 1.0), angular_velocity=(0.0, 0.0, 1.0)),
        ),
        statics=(StaticObject(name="floor", shape=Plane()),),
    )
    rng = np.random.default_rng(2)
    names = ["box.rotation.x", "box.rotation.z", "box.position.x", "box.velocity.x", "box.friction"]
    names += ["other.mass", "other.angular_velocity.z"]
    values = {f"objects.{name}": rng.uniform(0.1, 0.4, 4) for name in names}
    fitted = branch(member_worlds(start, {p: v[:1] for p, v in values.items()}, ())[0], edits)
    rollouts = roll_out_members(fitted, member_worlds(start, values, edits), values, 0.1)
    assert len(rollouts) == 4
    found = differences(fitted, member_worlds(start, values, edits), values)
    assert ("objects.other.mass" in found) == (not isinstance(edits[0], Remove) if edits else True)


def test_members_that_differ_beyond_their_parameters_are_refused() -> None:
    start = block_world(0.2, 1.0)
    with pytest.raises(ValueError, match="more than the fitted parameters"):
        roll_out_members(start, [block_world(0.3, 1.0)], ["objects.block.velocity.x"], 0.5)


def test_an_edit_that_one_member_cannot_take_is_refused_naming_it() -> None:
    values = {"objects.block.restitution": np.array([0.3, 0.8])}
    edits = [ScaleParameter(path="objects.block.restitution", factor=2.0)]
    with pytest.raises(ValueError, match=r"in member 2 of the ensemble, edit 1 .*outside its bounds"):
        member_worlds(block_world(0.2, 1.0), values, edits)


def test_ropes_of_an_ensemble_hang_as_each_of_them_alone() -> None:
    rope = Rope(
        name="line", points=((0.0, 0.0, 1.0), (0.5, 0.0, 1.0)), linear_density=0.1, radius=0.01, stretch_stiffness=200.0
    )
    start = World(objects=(), deformables=(rope,), attachments=(Attachment(name="hook", object="line", end="start"),))
    values = {
        "objects.line.bending_stiffness": np.array([1e-5, 1e-2]),
        "objects.line.linear_damping": np.array([0.0, 0.3]),
    }
    members = member_worlds(start, values, ())
    for member, together in zip(members, roll_out_members(start, members, values, 0.3), strict=True):
        alone = rollout(member, 0.3).trajectory.deformables["line"].points
        assert together.trajectory.deformables["line"].points == pytest.approx(alone, abs=1e-9)


def test_scaled_speed_and_friction_move_the_stop_as_the_law_says() -> None:
    edits = [
        ScaleVelocity(object="block", factor=2.0),
        ScaleParameter(path="objects.block.friction", factor=0.5),
    ]
    end = rollout(branch(block_world(0.4, 0.5), edits), 2.0).trajectory.positions[-1, 0, 0]
    assert end == pytest.approx(stopping_distance(0.2, 1.0), rel=0.01)


def test_scale_velocity_turns_with_its_factor_unless_another_is_given() -> None:
    spinning = RigidObject(
        name="ball",
        position=(0.0, 0.0, 1.0),
        shape=Box(half_extents=(0.1, 0.1, 0.1)),
        velocity=(1.0, 0.0, 0.0),
        angular_velocity=(0.0, 2.0, 0.0),
    )
    world = World(objects=(spinning,))
    twice = branch(world, [ScaleVelocity(object="ball", factor=2.0)]).object("ball")
    assert (twice.velocity, twice.angular_velocity) == ((2.0, 0.0, 0.0), (0.0, 4.0, 0.0))
    same = branch(world, [ScaleVelocity(object="ball", factor=-1.0, angular_factor=1.0)]).object("ball")
    assert (same.velocity, same.angular_velocity) == ((-1.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    with pytest.raises(ValueError, match=r"edit 1 \(scale_velocity\): no object is called 'bal'"):
        branch(world, [ScaleVelocity(object="bal", factor=2.0)])
    with pytest.raises(ValueError, match="outside its bounds"):
        branch(world, [ScaleParameter(path="objects.ball.restitution", factor=30.0)])


def test_a_probability_has_the_jeffreys_interval() -> None:
    low, high = Probability(31, 40).interval
    assert (low, high) == pytest.approx((0.654, 0.867), abs=0.003)  # beta(31.5, 9.5)
    assert Probability(0, 40).interval[0] == 0.0
    assert Probability(0, 40).interval[1] == pytest.approx(0.0466, abs=0.001)
    for nearly in (Probability(1e-5, 40), Probability(40 - 1e-5, 40)):
        assert nearly.interval[0] <= nearly.share <= nearly.interval[1]


def test_the_parameter_that_decides_is_found_with_its_threshold() -> None:
    rng = np.random.default_rng(4)
    values = {name: rng.uniform(0.0, 1.0, 40) for name in ("friction", "mass", "speed")}
    split = decisive_split(values, values["friction"] < 0.3)
    assert split is not None
    assert (split.parameter, split.true_where, split.agree) == ("friction", "below", 40)
    assert split.threshold == pytest.approx(0.3, abs=0.05)
    assert decisive_split(values, rng.uniform(size=40) < 0.5) is None  # nothing decides it
    assert decisive_split(values, np.arange(40) < 2) is None  # two members may agree by chance
    assert decisive_split(values, np.ones(40, dtype=bool)) is None


def test_relations_name_what_a_number_goes_with() -> None:
    rng = np.random.default_rng(6)
    values = {name: rng.uniform(0.0, 1.0, 40) for name in ("friction", "mass")}
    (found,) = relations(values, -np.exp(values["friction"]) + 0.01 * rng.normal(size=40))
    assert found.parameter == "friction"
    assert found.rank_correlation < -0.95


def test_an_interval_holds_nine_tenths() -> None:
    assert interval_of(np.arange(101.0)) == pytest.approx({"median": 50.0, "from": 5.0, "to": 95.0})
