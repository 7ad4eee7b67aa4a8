"""Hinges in the description of a world, and under edits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from polyworld.edits.interventions import Move, SetParameter, branch
from polyworld.solver.rollout import rollout
from polyworld.world import Environment, World
from polyworld.world.parameters import parameter_paths
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Slider, Spring
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.verification.planar_scenes import SIDE_VIEW, body

ROD = Box(half_extents=(0.05, 0.05, 0.5))


def chain(**fields: Any) -> World:
    """Two rods, one below the other, and a ball aside."""
    return World(
        objects=(
            body("upper", ROD, (0.0, 0.0, -0.5)),
            body("lower", ROD, (0.0, 0.0, -1.5)),
            body("ball", Sphere(radius=0.1), (3.0, 0.0, 0.0)),
        ),
        environment=Environment(motion_plane=SIDE_VIEW),
        **{
            "joints": (
                Hinge(name="pivot", object="upper", anchor=(0.0, 0.0, 0.0)),
                Hinge(name="elbow", object="lower", other="upper", anchor=(0.0, 0.0, -1.0)),
            ),
            **fields,
        },
    )


def test_a_world_with_hinges_survives_json() -> None:
    assert World.model_validate_json(chain().canonical_json()).id == chain().id


@pytest.mark.parametrize(
    ("hinge", "reason"),
    [
        (Hinge(name="j", object="rod", anchor=(0, 0, 0)), r"unknown objects \['rod'\]; rigid objects: \['ball', 'l"),
        (Hinge(name="j", object="ball", other="wall", anchor=(0, 0, 0)), "or on a static, leave `other` out"),
        (Hinge(name="j", object="ball", other="ball", anchor=(0, 0, 0)), "joins 'ball' to itself"),
    ],
)
def test_a_hinge_of_what_is_not_there_is_refused(hinge: Hinge, reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        chain(joints=(hinge,))


def test_two_joints_of_one_name_are_refused() -> None:
    twice = tuple(Hinge(name="j", object=name, anchor=(0.0, 0.0, 0.0)) for name in ("upper", "ball"))
    with pytest.raises(ValidationError, match=r"names of joints must be unique; repeated: \['j'\]"):
        chain(joints=twice)


def test_a_hinge_between_objects_that_start_at_different_times_is_refused() -> None:
    late = body("late", Sphere(radius=0.1), (1.0, 0.0, 0.0), start_time=1.0)
    with pytest.raises(ValidationError, match=r"different start_time: \{'late': 1.0, 'ball': 0.0\}"):
        World(
            objects=(*chain().objects, late),
            joints=(Hinge(name="j", object="late", other="ball", anchor=(2.0, 0.0, 0.0)),),
            environment=chain().environment,
        )


def test_hinges_rub_in_a_plane_as_they_do_in_space() -> None:
    """A ball on an arm whose hinge rubs and has a stop falls alike, rigid_planar or rigid_spatial."""
    stiff = Hinge(name="j", object="ball", anchor=(2.5, 0.0, 0.0), axis=(0.0, -1.0, 0.0), friction=0.1, upper=1.0)
    flat = chain(joints=(stiff,))
    spatial = World(
        objects=tuple(o.model_copy(update={"representation": "rigid_spatial"}) for o in flat.objects),
        joints=(stiff,),
        environment=flat.environment,
    )
    assert {"joints.j.friction", "joints.j.upper"} <= set(parameter_paths(flat))
    planar, other = (rollout(world, 0.5).trajectory.positions for world in (flat, spatial))
    np.testing.assert_allclose(planar, other, atol=1e-4)


def test_an_object_given_only_an_orientation_turns_about_its_hinge() -> None:
    angle = np.radians(30.0)
    edit = Move(object="lower", orientation=(np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0))
    moved = branch(chain(), [edit]).object("lower")
    # Plane x is world x and plane y is world z: the rod's centre swings towards +x.
    np.testing.assert_allclose(moved.position, (0.5 * np.sin(angle), 0.0, -1.0 - 0.5 * np.cos(angle)), atol=1e-12)


@pytest.mark.parametrize(
    "edit",
    [
        Move(object="lower", position=(0.1, 0.0, -1.5)),
        Move(object="upper", orientation=(0.8, 0.0, 0.6, 0.0)),
        Move(object="upper", position=(0.48, 0.0, -0.14), orientation=(0.8, 0.0, -0.6, 0.0)),
        SetParameter(path="objects.lower.position.x", value=0.1),
    ],
)
def test_a_move_that_would_leave_a_hinge_is_refused(edit: Move | SetParameter) -> None:
    with pytest.raises(ValueError, match=r"turns on joint '(pivot|elbow)' at .* its position there is"):
        branch(chain(), [edit])


Y_AXIS = (0.0, 1.0, 0.0)


def spatial(joint: Hinge | Slider | Ball | Fixed | Spring) -> World:
    """A rod hanging from the origin, held there in space."""
    rod = RigidObject(name="rod", shape=ROD, position=(0.0, 0.0, -0.5))
    return World(objects=(rod,), joints=(joint,))


def turned(axis: int, angle: float) -> tuple[float, float, float, float]:
    q = [np.cos(angle / 2), 0.0, 0.0, 0.0]
    q[1 + axis] = np.sin(angle / 2)
    return (float(q[0]), float(q[1]), float(q[2]), float(q[3]))


def test_a_spatial_hinge_turns_about_its_axis_and_its_stops_stay_where_they_were() -> None:
    hinge = Hinge(name="j", object="rod", anchor=(0, 0, 0), axis=Y_AXIS, lower=-0.5, upper=0.7)
    after = branch(spatial(hinge), [Move(object="rod", orientation=turned(1, 0.3))])
    np.testing.assert_allclose(after.object("rod").position, (-0.5 * np.sin(0.3), 0, -0.5 * np.cos(0.3)), atol=1e-12)
    joint = after.joints[0]
    assert isinstance(joint, Hinge)
    assert joint.lower == pytest.approx(-0.8)
    assert joint.upper == pytest.approx(0.4)
    with pytest.raises(ValueError, match=r"turns on joint 'j' about .* would be tilted"):
        branch(spatial(hinge), [Move(object="rod", orientation=turned(0, 0.3))])


def test_a_ball_joint_turns_every_way_but_keeps_its_point() -> None:
    ball = Ball(name="j", object="rod", anchor=(0, 0, 0))
    after = branch(spatial(ball), [Move(object="rod", orientation=turned(0, 0.3))])
    np.testing.assert_allclose(after.object("rod").position, (0, 0.5 * np.sin(0.3), -0.5 * np.cos(0.3)), atol=1e-12)
    with pytest.raises(ValueError, match="would leave it"):
        branch(spatial(ball), [Move(object="rod", position=(0.1, 0, -0.5))])


def test_a_slider_moves_along_its_axis_only_and_its_stops_stay_where_they_were() -> None:
    slider = Slider(name="j", object="rod", anchor=(0, 0, 0), axis=(0, 0, 2.0), upper=1.0)
    after = branch(spatial(slider), [Move(object="rod", position=(0, 0, -0.2))])
    joint = after.joints[0]
    assert isinstance(joint, Slider)
    assert joint.upper == pytest.approx(0.7)
    assert joint.lower is None
    with pytest.raises(ValueError, match="slides on joint 'j' along"):
        branch(spatial(slider), [Move(object="rod", position=(0.1, 0, -0.5))])
    with pytest.raises(ValueError, match="cannot turn against what joint 'j'"):
        branch(spatial(slider), [Move(object="rod", position=(0, 0, -0.5), orientation=turned(2, 0.1))])


def test_what_is_fixed_cannot_be_moved_and_a_spring_can_be_stretched() -> None:
    fixed = Fixed(name="j", object="rod", anchor=(0, 0, 0))
    with pytest.raises(ValueError, match="is fixed by joint 'j' to the world"):
        branch(spatial(fixed), [Move(object="rod", position=(0, 0, -0.6))])
    spring = Spring(name="j", object="rod", anchor=(0, 0, 0), other_anchor=(0, 0, 1.0), stiffness=10.0)
    after = branch(spatial(spring), [Move(object="rod", position=(0, 0, -0.6))])
    joint = after.joints[0]
    assert isinstance(joint, Spring)
    assert joint.rest_length == pytest.approx(1.0)
    np.testing.assert_allclose(joint.anchor, (0, 0, -0.1), atol=1e-12)


@pytest.mark.parametrize(("lower", "upper"), [(0.5, 1.0), (-1.0, -0.5), (0.1, None), (None, -0.1)])
def test_a_joint_that_starts_outside_its_stops_is_refused(lower: float | None, upper: float | None) -> None:
    with pytest.raises(ValidationError, match=r"starts outside its stops.*lower <= 0 <= upper"):
        Hinge(name="pivot", object="upper", anchor=(0, 0, 0), axis=(0, 1, 0), lower=lower, upper=upper)
