"""Worlds as MJCF: the same masses, places and axes in MuJoCo's model, the same motion, and back again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from polyworld import World, rollout
from polyworld.exchange import export_mjcf, import_world
from polyworld.world import Effect, Environment, StaticObject, geometry
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Motor, Slider, Spring
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Compound, ConvexMesh, Cylinder, Part, Plane, Sphere, TriangleMesh, Wall
from tests.scenes.six_bodies import six_body_world
from tests.verification.joint_scenes import body, linked, turned

mujoco = pytest.importorskip("mujoco")

HAMMER = Compound(
    parts=(
        Part(shape=Cylinder(radius=0.03, half_height=0.2)),
        Part(shape=Box(half_extents=(0.1, 0.05, 0.05)), position=(0.02, 0, 0.25)),
    )
)
WEDGE = ConvexMesh(vertices=((0, 0, 0), (0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.3)))
TILTED = turned((0.6, 0.0, 0.8), 0.7)


def robot() -> World:
    """Bodies of every shape on joints of every kind, tilted and in motion."""
    wheel = body("wheel", Cylinder(radius=0.1, half_height=0.02), (0, 0, 2), orientation=TILTED)
    arm = body("arm", HAMMER, (0.3, 0, 2), mass=2.0, orientation=TILTED, velocity=(0, 0, -0.1))
    arm = arm.model_copy(update={"angular_velocity": (0.0, 0.5, 0.0)})
    tip = body("tip", Capsule(radius=0.05, half_height=0.1), (0.6, 0, 2), velocity=(0, 0, -0.2))
    plate = body("plate", Box(half_extents=(0.1, 0.1, 0.02)), (0.6, 0, 1.8), velocity=(0, 0, -0.2))
    cart = body("cart", Sphere(radius=0.1), (2, 0, 1), velocity=(0.5, 0, 0))
    stone = body("stone", WEDGE, (-2, 0, 1), orientation=TILTED, velocity=(1, 2, 3), angular_velocity=(3, 2, 1))
    return linked(
        *(wheel, arm, tip, plate, cart, stone),
        joints=(
            Hinge(name="axle", object="wheel", anchor=(0, 0, 2), axis=(0, 1, 1), damping=0.1, motor=Motor(limit=0.3)),
            Hinge(name="elbow", object="wheel", other="arm", anchor=(0.1, 0, 2), axis=(0, 2, 0), lower=-1.0),
            Ball(name="wrist", object="tip", other="arm", anchor=(0.5, 0, 2), damping=0.02),
            Fixed(name="glue", object="plate", other="tip", anchor=(0.6, 0, 1.9)),
            Slider(name="rail", object="cart", anchor=(2, 0, 1), axis=(1, 0, 0), friction=0.1),
            Spring(
                name="spring", object="cart", anchor=(2, 0, 1), other_anchor=(1.5, 0, 1), stiffness=30.0, damping=0.2
            ),
        ),
    )


def loaded(world: World) -> tuple[Any, Any]:
    """MuJoCo's model of a world, and its data at the keyframe of the start."""
    model = mujoco.MjModel.from_xml_string(export_mjcf(world).xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def test_masses_inertias_places_axes_and_velocities_are_the_worlds() -> None:
    world = robot()
    model, data = loaded(world)
    assert model.nbody == 1 + len(world.objects)
    for item in world.objects:
        b = model.body(item.name).id
        turn = geometry.quaternion_matrix(np.asarray(item.orientation))
        assert model.body_mass[b] == pytest.approx(item.mass, rel=1e-12)
        np.testing.assert_allclose(data.xipos[b], item.position, atol=1e-9)
        np.testing.assert_allclose(data.xmat[b].reshape(3, 3), turn, atol=1e-9)
        axes = data.ximat[b].reshape(3, 3)
        solid = geometry.mass_properties(item.shape)
        expected = turn @ (solid.inertia / solid.volume * item.mass) @ turn.T
        inertia = axes @ np.diag(model.body_inertia[b]) @ axes.T
        np.testing.assert_allclose(inertia, expected, atol=1e-9 * np.trace(expected))
    for joint in world.joints:
        if joint.kind in ("hinge", "slider", "ball"):
            np.testing.assert_allclose(data.joint(joint.name).xanchor, joint.anchor, atol=1e-9)
    np.testing.assert_allclose(data.joint("axle").xaxis, np.array((0, 1, 1)) / np.sqrt(2), atol=1e-9)
    # The arm hangs on the wheel, which is the hinge's object: turned the other way about the other axis.
    np.testing.assert_allclose(data.joint("elbow").xaxis, (0, -1, 0), atol=1e-9)
    assert data.joint("elbow").qvel[0] == pytest.approx(-0.5)
    assert data.joint("rail").qvel[0] == pytest.approx(0.5)
    found = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, model.body("stone").id, found, 0)
    np.testing.assert_allclose(found, (3, 2, 1, 1, 2, 3), atol=1e-12)


def test_an_exported_robot_moves_alike_in_mujoco() -> None:
    """Half a second within 5 mm: MuJoCo's steps are first order, 0.5 ms here, and its stops and friction yield."""
    world = robot()
    model, data = loaded(world)
    model.opt.timestep = 5e-4
    mujoco.mj_step(model, data, 1000)
    mujoco.mj_forward(model, data)
    run = rollout(world, 0.5).trajectory
    there = [data.body(name).xipos for name in run.names]
    assert np.abs(run.positions[-1] - run.positions[0])[1:].max(axis=1).min() > 0.02  # the wheel turns in its place
    np.testing.assert_allclose(run.positions[-1], there, atol=5e-3)


def test_exported_bodies_that_slide_and_strike_end_alike_in_mujoco() -> None:
    """Six bodies with e = 0.5 and friction 0.3: after the first blows, at 0.8 s, within 4 cm of 1.5 m travelled."""
    world = six_body_world(planar=False)
    model, data = loaded(world)
    mujoco.mj_step(model, data, round(0.8 / model.opt.timestep))
    run = rollout(world, 0.8).trajectory
    there = np.array([data.body(name).xipos for name in run.names])
    assert np.linalg.norm(run.positions[-1] - run.positions[0], axis=1).min() > 0.6
    np.testing.assert_allclose(run.positions[-1], there, atol=0.04)


def test_a_world_comes_back_from_mjcf_as_it_was(tmp_path: Path) -> None:
    """Objects, statics, joints and pairs that pass through each other; what MJCF says otherwise, as it says it."""
    ramp = StaticObject(name="ramp", shape=Box(half_extents=(1, 1, 0.1)), position=(0, 0, -1), orientation=TILTED)
    floor = StaticObject(name="floor", shape=Plane(normal=(0, 0.6, 0.8), offset=-2.0), friction=0.9, dominant=True)
    wall = StaticObject(name="wall", shape=Wall(start=(3, -1, -2), end=(3, 1, -2)))
    world = robot().model_copy(update={"statics": (ramp, floor, wall), "no_contact": (("cart", "ramp"),)})
    objects = tuple(o.model_copy(update={"restitution": 0.0, "friction": 0.5}) for o in world.objects)
    world = World.model_validate(world.model_copy(update={"objects": objects}).model_dump())
    path = tmp_path / "world.xml"
    path.write_text(export_mjcf(world).xml)
    back = import_world(path, keyframe="start").world
    assert {o.name for o in back.objects} == {"wheel", "arm", "tip", "cart", "stone"}  # the plate is welded to the tip
    for item in back.objects:
        was = world.object(item.name)
        if item.name != "tip":
            assert item.mass == pytest.approx(was.mass)
            np.testing.assert_allclose(item.position, was.position, atol=1e-9)
            np.testing.assert_allclose(item.velocity, was.velocity, atol=1e-9)
        assert (item.friction, item.restitution) == (0.5, pytest.approx(0.0, abs=0.15))
    assert {s.name: s.shape.kind for s in back.statics} == {"ramp": "box", "floor": "plane", "wall": "box"}
    joints = {j.name: j for j in back.joints}
    assert {name: j.kind for name, j in joints.items()} == {
        "axle": "hinge",
        "elbow": "hinge",
        "wrist": "ball",
        "rail": "slider",
    }
    assert ("cart", "ramp") in back.no_contact
    assert ("cart", "floor") not in back.no_contact


def test_a_closed_loop_is_held_by_constraints() -> None:
    """Two rods hinged to each other and both to the world: a triangle that cannot move, though gravity pulls."""
    rod = Box(half_extents=(0.25, 0.02, 0.02))
    left = body("left", rod, (0.2, 0, 0.15), orientation=turned((0, 1, 0), -np.arctan2(0.15, 0.2)))
    right = body("right", rod, (0.6, 0, 0.15), orientation=turned((0, 1, 0), np.arctan2(0.15, 0.2)))
    world = linked(
        left,
        right,
        joints=(
            Hinge(name="a", object="left", anchor=(0, 0, 0), axis=(0, 1, 0)),
            Hinge(name="b", object="right", other="left", anchor=(0.4, 0, 0.3), axis=(0, 1, 0)),
            Ball(name="c", object="right", anchor=(0.8, 0, 0)),
        ),
    )
    model, data = loaded(world)
    assert model.neq >= 1
    mujoco.mj_step(model, data, 250)
    np.testing.assert_allclose(data.body("left").xipos, left.position, atol=2e-3)


def test_what_is_left_out_is_said_and_planar_worlds_are_refused() -> None:
    late = body("late", Sphere(radius=0.1), (0, 0, 1), start_time=1.0, linear_damping=0.1)
    mesh = TriangleMesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), faces=((0, 2, 1), (0, 1, 3), (0, 3, 2)))
    air = Effect(name="air", kind="linear_drag", parameters={"coefficient": 0.1})
    world = World(objects=(late,), statics=(StaticObject(name="hill", shape=mesh),), effects=(air,))
    said = "\n".join(export_mjcf(world).left_out)
    for what in (
        "effects are left out: air",
        "linear_damping is left out: late",
        "start_time",
        "hill: MuJoCo collides",
    ):
        assert what in said
    with pytest.raises(ValueError, match="planar worlds have no counterpart"):
        export_mjcf(six_body_world(planar=True))


def test_a_compound_with_an_inertia_of_its_own_turns_by_it() -> None:
    """Spun up about z for 0.1 s by a known torque: w = M t / (m k^2), and its centre of mass stays where it is."""
    from polyworld import Control, stepper

    shape = Compound(
        parts=(Part(shape=Sphere(radius=0.1)),), centre_of_mass=(0.05, 0, 0), inertia=(0.3, 0.2, 0.4, 0, 0, 0)
    )
    item = RigidObject(name="top", shape=shape, mass=2.0, position=(0, 0, 0))
    world = World(objects=(item,), environment=Environment(gravity=(0, 0, 0)))
    assert World.model_validate_json(world.canonical_json()).id == world.id
    run = stepper(world, interval=0.1)
    run.step(control=lambda _: Control(torques={"top": (0, 0, 4.0)}))
    np.testing.assert_allclose(run.state.angular_velocities[0], (0, 0, 4.0 * 0.1 / (2.0 * 0.4)), rtol=1e-9, atol=1e-12)
    assert geometry.pieces(shape)[0].position == pytest.approx((-0.05, 0, 0))
    with pytest.raises(ValueError, match="none exceed the sum"):
        Compound(parts=shape.parts, inertia=(0.1, 0.1, 0.3, 0, 0, 0))


@pytest.mark.parametrize("planar", [True, False])
def test_pairs_without_contact_pass_through_each_other(planar: bool) -> None:
    """Two balls head-on: they swap places without a contact; without the pair they strike."""
    kind = "rigid_planar" if planar else "rigid_spatial"
    a, b = (
        body(name, Sphere(radius=0.1), (x, 0, 0), velocity=(v, 0, 0)).model_copy(update={"representation": kind})
        for name, x, v in (("a", 0.0, 2.0), ("b", 0.5, 0.0))
    )
    world = World(objects=(a, b), environment=Environment(gravity=(0, 0, 0)), no_contact=(("b", "a"),))
    assert not rollout(world, 0.4).events
    assert rollout(world.model_copy(update={"no_contact": ()}), 0.4).events
    with pytest.raises(ValueError, match="must name two rigid objects"):
        World(objects=(a, b), no_contact=(("a", "c"),))
