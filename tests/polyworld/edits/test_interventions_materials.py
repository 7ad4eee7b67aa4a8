"""Branches of worlds with ropes, cloth, soft bodies, fluids, joints and fastenings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from polyworld.edits.interventions import (
    Add,
    Intervention,
    Move,
    Release,
    Remove,
    SetParameter,
    SetVelocity,
    branch,
)
from polyworld.edits.relocation import centre_of_mass
from polyworld.model import mesh_of
from polyworld.model.rope import threading
from polyworld.solver.rollout import rollout, simulator
from polyworld.world import Effect, World
from polyworld.world.parameters import read_parameter
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Container, Drain, Emitter, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.joint import Fixed, Hinge, Motor, Spring
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Sphere


def world() -> World:
    """A rope from a hook over nothing to a weight, another over a pulley, cloth, a soft ball, water in a tank."""
    return World(
        objects=(
            RigidObject(name="weight", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.9)),
            RigidObject(name="load", shape=Sphere(radius=0.1), position=(3.2, 0.0, 0.9)),
            RigidObject(name="door", shape=Box(half_extents=(0.3, 0.02, 0.4)), position=(-2.0, 0.0, 0.4)),
        ),
        deformables=(
            Rope(name="line", points=((0.0, 0.0, 2.0), (0.0, 0.0, 1.0)), friction=0.123),
            Rope(name="hoist", points=((2.8, 0.0, 1.0), (3.2, 0.0, 1.0))),
            Cloth(name="flag", geometry=Sheet(corner=(0.0, 3.0, 0.0), edge_u=(1.0, 0.0, 0.0), edge_v=(0.0, 0.0, 0.6))),
            Soft(name="jelly", shape=Sphere(radius=0.1), position=(0.0, -2.0, 0.1)),
            Fluid(name="water", volumes=(FluidVolume(shape=Box(half_extents=(0.2, 0.2, 0.1)), position=(5, 0, 0.1)),)),
        ),
        attachments=(
            Attachment(name="hook", object="line", end="start"),
            Attachment(name="tie", object="line", end="end", to="weight"),
            Attachment(name="lift", object="hoist", end="end", to="load"),
            Attachment(name="pole", object="flag", region=Region(lower=(-0.01, 2.9, -0.1), upper=(0.01, 3.1, 1.0))),
        ),
        pulleys=(Pulley(name="wheel", rope="hoist", centre=(3.0, 0.0, 2.0), radius=0.1, after=0),),
        joints=(
            Hinge(name="pin", object="door", anchor=(-2.3, 0.0, 0.4)),
            Spring(name="coil", object="weight", anchor=(0, 0, 0.8), other_anchor=(0, 0, 0.5), stiffness=10.0),
        ),
        fluid_grid=FluidGrid(lower=(4.5, -0.5, 0.0), upper=(5.5, 0.5, 1.0), cell=0.1),
        emitters=(Emitter(name="tap", fluid="water", position=(5.0, 0.0, 0.8), radius=0.1, rate=1e-3),),
        drains=(Drain(name="sink", lower=(4.5, -0.5, 0.0), upper=(4.7, 0.5, 0.1)),),
        containers=(Container(name="pail", lower=(-0.2, -0.2, 0.7), upper=(0.2, 0.2, 1.1), object="weight"),),
        effects=(Effect(name="push", kind="uniform_acceleration", parameters={"x": 1.0}, objects=("line",)),),
    )


def names(items: Iterable[Any]) -> list[str]:
    return [item.name for item in items]


def test_removing_a_body_takes_what_held_it_along() -> None:
    other = branch(world(), [Remove(object="weight")])
    assert names(other.attachments) == ["hook", "lift", "pole"]
    assert names(other.joints) == ["pin"]
    assert other.containers == ()


def test_removing_a_rope_takes_its_fastenings_its_pulleys_and_its_own_effects_along() -> None:
    assert branch(world(), [Remove(object="hoist")]).pulleys == ()
    other = branch(world(), [Remove(object="line")])
    assert names(other.attachments) == ["lift", "pole"]
    assert other.effects == ()


@pytest.mark.parametrize(
    ("name", "part"),
    [("pin", "joints"), ("tie", "attachments"), ("wheel", "pulleys"), ("tap", "emitters"), ("sink", "drains")],
)
def test_parts_can_be_removed_by_themselves(name: str, part: str) -> None:
    other = branch(world(), [Remove(object=name)])
    assert name not in names(getattr(other, part))
    assert other.moving_names == world().moving_names


def test_name_shared_by_an_object_and_a_joint_means_the_object_unless_said() -> None:
    shared = world().model_copy(update={"joints": (Hinge(name="door", object="door", anchor=(-2.3, 0.0, 0.4)),)})
    assert "door" not in branch(shared, [Remove(object="door")]).moving_names
    other = branch(shared, [Remove(object="door", part="joint")])
    assert "door" in other.moving_names
    assert other.joints == ()


def test_what_was_added_can_be_fastened_and_moved_by_later_edits() -> None:
    other = branch(
        world(),
        [
            Add(deformable=Rope(name="leash", points=((-2.0, 0.0, 0.8), (-2.0, 0.0, 1.8)))),
            Add(attachment=Attachment(name="knot", object="leash", end="start", to="door")),
            Add(joint=Fixed(name="bolt", object="load", anchor=(3.2, 0.0, 0.9))),
            Add(emitter=Emitter(name="jet", fluid="water", position=(5, 0, 0.5), radius=0.1, rate=1e-3)),
            SetVelocity(object="leash", velocity=(0.0, 1.0, 0.0)),
        ],
    )
    assert other.deformable("leash").velocity == (0.0, 1.0, 0.0)
    assert names(other.attachments)[-1] == "knot"
    assert names(other.joints)[-1] == "bolt"
    assert names(other.emitters) == ["tap", "jet"]


def test_first_fluid_of_a_world_brings_its_grid() -> None:
    dry = branch(world(), [Remove(object="water")])
    grid = FluidGrid(lower=(0, 0, 0), upper=(1, 1, 1), cell=0.1)
    assert branch(dry, [Add(deformable=Fluid(name="oil"), fluid_grid=grid)]).fluid_grid == grid
    with pytest.raises(ValueError, match="need a fluid_grid"):
        branch(dry, [Add(deformable=Fluid(name="oil"))])
    with pytest.raises(ValueError, match="has its fluid_grid already"):
        branch(world(), [Add(deformable=Fluid(name="oil"), fluid_grid=grid)])


@pytest.mark.parametrize("name", ["flag", "jelly", "water"])
def test_moving_a_deformable_object_puts_its_centre_of_mass_there_without_deforming_it(name: str) -> None:
    before, target = world(), (5.05, 0.1, 0.45)
    after = branch(before, [Move(object=name, position=target)])
    assert centre_of_mass(after, after.deformable(name)) == pytest.approx(target, abs=1e-9)
    a, b = (mesh_of(w, w.deformable(name)).nodes for w in (before, after))
    assert np.ptp(b - a, axis=0).max() < 1e-9


def test_turning_a_cloth_about_its_centre_keeps_distances() -> None:
    before = world()
    after = branch(before, [Move(object="flag", orientation=(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))])
    a, b = (mesh_of(w, w.deformable("flag")).nodes for w in (before, after))
    assert b.mean(axis=0) == pytest.approx(a.mean(axis=0), abs=1e-9)
    # A quarter turn about z: what pointed along x points along y.
    assert (b - b.mean(axis=0))[:, 1] == pytest.approx((a - a.mean(axis=0))[:, 0], abs=1e-9)
    assert (b - b.mean(axis=0))[:, 2] == pytest.approx((a - a.mean(axis=0))[:, 2], abs=1e-9)


def test_fastening_to_the_world_moves_along_and_holds_the_same_nodes() -> None:
    after = branch(world(), [Move(object="flag", position=(0.0, 0.0, 1.0))])
    nodes = mesh_of(world(), world().deformable("flag")).nodes
    held = next(a for a in after.attachments if a.name == "pole")
    assert held.region is None
    assert held.nodes == tuple(np.flatnonzero(np.abs(nodes[:, 0]) < 0.01))


def test_rope_tied_to_a_moved_body_follows_it_and_keeps_its_length() -> None:
    before = world()
    after = branch(before, [Move(object="weight", position=(0.3, 0.0, 1.1))])
    rope = after.deformable("line")
    assert isinstance(rope, Rope)
    assert rope.points[-1] == pytest.approx((0.3, 0.0, 1.2))
    assert rope.length == pytest.approx(1.0)
    spring = next(j for j in after.joints if j.name == "coil")
    assert isinstance(spring, Spring)
    assert spring.anchor == pytest.approx((0.3, 0.0, 1.0))
    assert spring.rest_length == pytest.approx(0.3)
    assert after.containers[0].lower == pytest.approx((0.1, -0.2, 0.9))


def test_rope_over_a_pulley_keeps_its_length_when_its_load_is_moved() -> None:
    before = world()
    after = branch(before, [Move(object="load", position=(3.2, 0.0, 1.0))])
    lengths = []
    for w in (before, after):
        rope = w.deformable("hoist")
        assert isinstance(rope, Rope)
        lengths.append(threading(w, rope).rest.sum())
    assert lengths[1] == pytest.approx(lengths[0])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Move(object="weight", position=(0.0, 0.0, 0.5)), r"rope 'line', 1 m long, would have to reach over 1.4 m"),
        (Move(object="hoist", position=(0.0, 0.0, 0.0)), r"runs over pulleys \['wheel'\], which stay"),
        (Move(object="line", position=(0.0, 0.0, 0.0)), r"fastened to other objects, {'tie': 'weight'}"),
        (Move(object="door", position=(0.0, 0.0, 0.4)), "turns on joint 'pin'"),
        (SetVelocity(object="line", angular_velocity=(0.0, 0.0, 1.0)), "'line' is rope, which starts without turning"),
        (Release(attachment="glue"), r"no attachment is called 'glue'; attachments of this world: \['hook', 'tie'"),
        (Remove(object="ghost"), r"no object or static is called 'ghost'; objects: \['weight', 'load', 'door'\]"),
        (Remove(object="tie", part="joint"), r"no joint is called 'tie'; joints: \['pin', 'coil'\]"),
        (SetParameter(path="objects.line.youngs_modulus", value=1.0), "unknown parameter"),
        (SetParameter(path="objects.jelly.poisson_ratio", value=0.6), "outside its bounds 0.0 to 0.49"),
    ],
)
def test_what_cannot_be_done_is_refused_with_what_can(edit: Intervention, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        branch(world(), [edit])


def test_motor_is_set_and_differs_within_a_batch() -> None:
    """A wheel whose motor is strong against its friction turns at the target speed, by the right-hand rule about z."""
    wheel = RigidObject(name="wheel", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.0), mass=1.0)
    axle = Hinge(name="axle", object="wheel", anchor=(0.0, 0.0, 0.0), motor=Motor(target_speed=3.0, limit=1.0))
    driven = World(objects=(wheel,), joints=(axle,))
    other = branch(driven, [SetParameter(path="joints.axle.motor.target_speed", value=-5.0)])
    assert read_parameter(other, "joints.axle.motor.target_speed") == -5.0
    assert rollout(other, 1.0).trajectory.angular_velocities[-1, 0, 2] == pytest.approx(-5.0, rel=1e-6)
    stalled = branch(other, [SetParameter(path="joints.axle.motor.limit", value=0.0)])
    assert rollout(stalled, 1.0).trajectory.angular_velocities[-1, 0, 2] == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(ValueError, match=r"choices: \['joints.axle.friction'.*'joints.axle.motor.limit'"):
        branch(driven, [SetParameter(path="joints.axle.speed", value=1.0)])
    batch = simulator(driven, np.array([1.0]), n_worlds=2).run({"joints.axle.motor.limit": np.array([0.0, 1.0])})
    assert batch.angular_velocities[:, 0, 0, 2] == pytest.approx([0.0, 3.0], rel=1e-6)


@pytest.mark.parametrize(
    ("path", "value", "read"),
    [
        ("objects.jelly.youngs_modulus", 2e4, lambda w: w.deformable("jelly").youngs_modulus),
        ("objects.line.linear_density", 0.2, lambda w: w.deformable("line").linear_density),
        ("joints.pin.friction", 0.3, lambda w: w.joints[0].friction),
        ("pulleys.wheel.bearing_friction", 0.1, lambda w: w.pulleys[0].bearing_friction),
        ("emitters.tap.rate", 2e-3, lambda w: w.emitters[0].rate),
    ],
)
def test_parameters_of_materials_and_of_what_connects_them_can_be_set(path: str, value: float, read: object) -> None:
    other = branch(world(), [SetParameter(path=path, value=value)])
    assert callable(read)
    assert read(other) == value
    assert other.deformables[0] == world().deformables[0] or path.startswith("objects.line")


def test_release_is_at_a_time_or_from_the_beginning() -> None:
    later = branch(world(), [Release(attachment="tie", time=0.5)])
    assert [a.release for a in later.attachments] == [None, 0.5, None, None]
    assert names(branch(world(), [Release(attachment="tie")]).attachments) == ["hook", "lift", "pole"]
