"""MJCF and URDF as worlds: the same masses and axes as MuJoCo has, the same motion, and what is left out is said."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from polyworld import rollout
from polyworld.exchange import Imported, import_world
from polyworld.exchange.geoms import quaternion
from polyworld.exchange.surfaces import restitution_of
from polyworld.world import World, geometry
from polyworld.world.representations.joint import Hinge

mujoco = pytest.importorskip("mujoco")

ROD = '<geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" density="500"/>'
CHAIN = """
<mujoco><option timestep="{step}"/><worldbody>
  <geom name="floor" type="plane" size="0 0 1" pos="0 0 -3"/>
  <body name="upper" pos="0 0 1">
    <joint name="shoulder" axis="0 1 0" {shoulder}/>{rod}
    <body name="lower" pos=".4 0 0">
      <joint name="elbow" axis="0 1 0" {elbow}/>{inertial}<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
      <body name="tool" pos=".3 0 0"><geom type="sphere" size=".04" mass="0.2"/></body>
    </body>
  </body>
  <body name="stone" pos="-1 0 2"><freejoint/><geom type="mesh" mesh="wedge" mass="1"/></body>
</worldbody><asset><mesh name="wedge" vertex="0 0 0  .2 0 0  0 .2 0  0 0 .3"/></asset></mujoco>
"""
INERTIAL = '<inertial pos=".15 .01 0" mass="0.7" diaginertia=".002 .01 .009"/>'


def chain(step: float = 2e-4, shoulder: str = "", elbow: str = "", inertial: str = "") -> str:
    return CHAIN.format(step=step, shoulder=shoulder, elbow=elbow, inertial=inertial, rod=ROD)


def read(folder: Path, text: str, name: str = "model.xml", **options: Any) -> Imported:
    path = folder / name
    path.write_text(text)
    return import_world(path, **options)


def mujoco_motion(text: str, world: World, duration: float, key: int | None = None) -> tuple[Any, Any]:
    """Positions (T, n, 3) of the centres of bodies by name every 0.02 s, in MuJoCo and here."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    found = rollout(world, duration, sample_interval=0.02).trajectory
    there = []
    for time in found.times:
        while data.time < time - 1e-9:
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        # Bodies without joints belong to their parents: the centre of mass of all that is welded.
        there.append([centre_of(model, data, name) for name in found.names])
    return np.array(there), found.positions


def centre_of(model: Any, data: Any, name: str) -> Any:
    root = model.body(name).id
    parts = [b for b in range(model.nbody) if model.body_weldid[b] == root]
    return np.average(data.xipos[parts], axis=0, weights=model.body_mass[parts])


@pytest.mark.parametrize(
    "text",
    [
        chain(),
        chain(shoulder='damping="0.05"', elbow='frictionloss="0.02"', inertial=INERTIAL),
    ],
    ids=["free", "resisting"],
)
def test_a_double_pendulum_and_a_falling_stone_move_as_in_mujoco(tmp_path: Path, text: str) -> None:
    """Within 2 mm in 0.6 s: MuJoCo's steps of 0.2 ms are first order, 0.6 mm of a free fall."""
    there, here = mujoco_motion(text, read(tmp_path, text).world, 0.6)
    np.testing.assert_allclose(here, there, atol=2e-3)
    assert np.ptp(here[:, 1], axis=0).max() > 0.3


def test_a_rod_comes_to_rest_against_its_stop_as_in_mujoco(tmp_path: Path) -> None:
    """From 40 degrees, of a range of -10 to 50, in a keyframe: stops here count from the pose at the start."""
    text = f"""<mujoco><option timestep="0.001"/><worldbody><body name="rod" pos="0 0 1">
      <joint axis="0 1 0" damping="0.5" range="-10 50" limited="true" solreflimit="0.002 1"/>{ROD}</body></worldbody>
      <keyframe><key qpos="0.698"/></keyframe></mujoco>"""
    there, here = mujoco_motion(text, read(tmp_path, text, keyframe=0).world, 2.0, key=0)
    np.testing.assert_allclose(here[-1], there[-1], atol=1e-3)
    np.testing.assert_allclose(here[-1, 0], (0.2 * math.cos(math.radians(50)), 0, 1 - 0.2 * math.sin(math.radians(50))))


def test_a_pendulum_has_the_period_of_its_own_inertia(tmp_path: Path) -> None:
    """T = 2 pi sqrt(I / m g l), 5 degrees wide (1.0005), of an inertia that its geom does not have: within 0.1%."""
    text = """<mujoco><option timestep="0.002"/><worldbody><body name="bob" pos="0 0 1">
      <joint name="pivot" axis="0 1 0"/><inertial pos="0 0 -.5" mass="2" diaginertia=".3 .4 .2"/>
      <geom type="sphere" size=".1" pos="0 0 -.5"/></body></worldbody>
      <keyframe><key name="aside" qpos="0.0872665"/></keyframe></mujoco>"""
    world = read(tmp_path, text, keyframe="aside").world
    run = rollout(world, 6.0, sample_interval=0.01).trajectory
    x = run.positions[:, 0, 0]
    zero = np.flatnonzero(x[1:] * x[:-1] < 0)
    crossings = run.times[zero] + 0.01 * x[zero] / (x[zero] - x[zero + 1])
    period = 2.0 * np.diff(crossings).mean()
    assert period == pytest.approx(2 * math.pi * math.sqrt((0.4 + 2 * 0.25) / (2 * 9.81 * 0.5)) * 1.0005, rel=1e-3)


def test_a_box_slides_and_strikes_as_in_mujoco(tmp_path: Path) -> None:
    """A box with friction 0.3 stops after v^2 / 2 mu g; another is struck by it: 1% of the way, which is contact slack.

    Both rub more on the floor's 0.2 than it does: in MuJoCo the greater friction counts.
    """
    text = """<mujoco><option timestep="0.0002" cone="elliptic" impratio="100"/>
      <default><geom solref="0.004 1" solimp="0.99 0.99 0.001" friction="0.3"/></default><worldbody>
      <geom name="floor" type="plane" size="0 0 1" friction="0.2"/>
      <body name="a" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
      <body name="b" pos=".5 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody>
      <keyframe><key qpos="0 0 .1 1 0 0 0 .5 0 .1 1 0 0 0" qvel="2 0 0 0 0 0 0 0 0 0 0 0"/></keyframe></mujoco>"""
    found = read(tmp_path, text, keyframe=0)
    assert found.left_out == ()
    assert found.world.objects[0].velocity == (2.0, 0.0, 0.0)
    there, here = mujoco_motion(text, found.world, 1.2, key=0)
    assert here[-1, 1, 0] - 0.5 > 0.05
    np.testing.assert_allclose(here[-1], there[-1], atol=5e-3)


@pytest.mark.parametrize(("contact", "step"), [(".02 1", 2e-3), (".02 .2", 1e-3), ("-40000 -30", 2e-4)])
def test_a_dropped_ball_rebounds_as_in_mujoco(tmp_path: Path, contact: str, step: float) -> None:
    """Speed after the first bounce of a ball in no gravity, within 0.03 of the speed before.

    MuJoCo's default, one that swings, and one by stiffness and damping; the rest depends on where in a step they meet.
    """
    text = f"""<mujoco><option timestep="{step}" gravity="0 0 0"/><default><geom solref="{contact}"/></default>
      <worldbody><geom name="floor" type="plane" size="0 0 1"/>
      <body name="ball" pos="0 0 .3"><freejoint/><geom type="sphere" size=".1"/></body></worldbody>
      <keyframe><key qpos="0 0 .3 1 0 0 0" qvel="0 0 -1 0 0 0"/></keyframe></mujoco>"""
    world = read(tmp_path, text, keyframe=0).world
    there, here = mujoco_motion(text, world, 0.8, key=0)
    speeds = [heights[-1, 0, 2] - heights[-2, 0, 2] for heights in (there, here)]
    assert speeds[1] / 0.02 == pytest.approx(world.objects[0].restitution, abs=1e-6)
    assert speeds[0] == pytest.approx(speeds[1], abs=0.02 * 0.03)


def test_rebound_of_a_damped_spring_is_that_of_theory() -> None:
    """Schwager & Poeschel 2007, eq. 21: exp(-2) at critical damping, exp(-z (pi - phi) / sqrt(1 - z^2)) below it."""
    for ratio in (0.1, 0.3579, 0.6):
        root = math.sqrt(1.0 - ratio**2)
        angle = math.atan(2.0 * ratio * root / (1.0 - 2.0 * ratio**2))
        expected = math.exp(-ratio / root * (math.pi - angle))
        assert restitution_of((0.01, ratio), 0.95, 1e-6) == pytest.approx(expected, abs=0.01)
    assert restitution_of((0.01, 1.0), 0.95, 1e-6) == pytest.approx(math.exp(-2.0), abs=0.01)


def test_masses_inertias_and_axes_are_those_of_the_model(tmp_path: Path) -> None:
    text = chain(inertial=INERTIAL)
    world = read(tmp_path, text).world
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert [o.name for o in world.objects] == ["upper", "lower", "stone"]
    for item in world.objects:
        root = model.body(item.name).id
        parts = [b for b in range(model.nbody) if model.body_weldid[b] == root]
        assert item.mass == pytest.approx(model.body_mass[parts].sum(), rel=1e-12)
        np.testing.assert_allclose(item.position, centre_of(model, data, item.name), atol=1e-12)
        solid = geometry.mass_properties(item.shape)
        turn = geometry.quaternion_matrix(np.asarray(item.orientation))
        inertia = turn @ (solid.inertia / solid.volume * item.mass) @ turn.T
        expected = np.zeros((3, 3))
        for b in parts:
            axes, off = data.ximat[b].reshape(3, 3), data.xipos[b] - item.position
            expected += axes @ np.diag(model.body_inertia[b]) @ axes.T
            expected += model.body_mass[b] * (off @ off * np.eye(3) - np.outer(off, off))
        np.testing.assert_allclose(inertia, expected, atol=1e-6 * np.trace(expected))
    for joint in world.joints:
        np.testing.assert_allclose(joint.anchor, data.joint(joint.name).xanchor, atol=1e-12)
        np.testing.assert_allclose(joint.axis, data.joint(joint.name).xaxis, atol=1e-12)  # type: ignore[union-attr]


def test_a_body_with_several_joints_moves_in_all_of_them(tmp_path: Path) -> None:
    """A planar base, two sliders and a hinge, thrown: falls, drifts and turns as in MuJoCo, within 2 mm in 0.5 s."""
    text = """<mujoco><option timestep="0.0002"/><worldbody><body name="base" pos="0 0 2">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="turn" axis="0 1 0" damping="0.01"/><geom type="box" size=".2 .1 .05"/></body></worldbody>
      <keyframe><key qvel="1 2 3"/></keyframe></mujoco>"""
    found = read(tmp_path, text, keyframe=0)
    assert re.search("base has 3 joints: 2 balls", "\n".join(found.left_out))
    world = found.world
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 2500)
    run = rollout(world, 0.5).trajectory
    np.testing.assert_allclose(run.positions[-1, 0], data.body("base").xipos, atol=2e-3)
    here = geometry.quaternion_matrix(run.orientations[-1, 0])
    there = data.body("base").xmat.reshape(3, 3)
    np.testing.assert_allclose(here, there, atol=2e-3)


def test_pairs_that_do_not_collide_in_mujoco_do_not_here(tmp_path: Path) -> None:
    """By masks, by exclusion, and a body none of whose geoms collide; what does collide, does."""
    text = """<mujoco><worldbody><geom name="floor" type="plane" size="0 0 1"/>
      <body name="a" pos="0 0 1"><freejoint/><geom size=".1" contype="2" conaffinity="1"/></body>
      <body name="b" pos="1 0 1"><freejoint/><geom size=".1" contype="2" conaffinity="1"/></body>
      <body name="c" pos="2 0 1"><freejoint/><geom size=".1"/></body>
      <body name="d" pos="3 0 1"><freejoint/><geom size=".1"/></body>
      <body name="ghost" pos="4 0 1"><freejoint/><geom size=".1" contype="0" conaffinity="0"/></body></worldbody>
      <contact><exclude body1="c" body2="d"/></contact></mujoco>"""
    pairs = {frozenset(pair) for pair in read(tmp_path, text).world.no_contact}
    ghost = {frozenset((other, "ghost")) for other in ("a", "b", "c", "d", "floor")}
    assert pairs == {frozenset("ab"), frozenset("cd"), *ghost}


def test_many_pairs_do_not_collide(tmp_path: Path) -> None:
    """Twenty balls without contacts among each other, 190 pairs, that fall on a floor."""
    ball = '<body name="b{i}" pos="0 0 {z}"><freejoint/><geom size=".1" contype="2" conaffinity="1"/></body>'
    balls = "".join(ball.format(i=i, z=0.5 + 0.05 * i) for i in range(20))
    text = f'<mujoco><worldbody><geom type="plane" size="0 0 1"/>{balls}</worldbody></mujoco>'
    world = read(tmp_path, text).world
    assert len(world.no_contact) == 190
    run = rollout(world, 0.6)
    assert {e.participants for e in run.events if e.kind == "contact_begin"} <= {(f"b{i}", "geom0") for i in range(20)}


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    text = """<mujoco><option density="1.2"/><worldbody>
      <geom name="mat" type="plane" size="0 0 1" contype="0" conaffinity="0"/>
      <body name="arm/1" pos="0 0 1"><joint name="j" armature="0.1" stiffness="2"/><geom size=".1"/>
      <site name="s1"/></body>
      <body name="ball"><joint name="b" type="ball" range="0 1" limited="true"/><geom type="ellipsoid" size=".1 .2 .3"/>
      <site name="s2"/></body></worldbody>
      <tendon><spatial><site site="s1"/><site site="s2"/></spatial></tendon>
      <equality><joint joint1="j" polycoef="0 1 0 0 0"/></equality>
      <actuator><position name="servo" joint="j" kp="5"/></actuator>
      <sensor><jointpos joint="j"/></sensor></mujoco>"""
    found = read(tmp_path, text)
    said = "\n".join(found.left_out)
    for what in (
        "mat is left out",
        "armature 0.1 is left out",
        "stiffness 2 is left out",
        "limit of a ball joint",
        "a polyhedron of 162 vertices for an ellipsoid",
        "equality joint0 is left out",
        r"actuator servo is left out.*joint j; the force is 1 times \(5 control -5 position\)",
        "1 tendons",
        "1 sensors",
        "drag of the medium",
        "'arm/1' is called 'arm_1'",
    ):
        assert re.search(what, said), what
    assert found.world.joints[0].motor is not None  # type: ignore[union-attr]


def test_a_loop_closed_by_an_equality_holds(tmp_path: Path) -> None:
    """A four-bar linkage: its last bar is held by a connect, here a ball joint, to the world."""
    bar = '<geom type="capsule" fromto="0 0 0 {x} 0 {z}" size=".02" contype="0" conaffinity="0"/>'
    text = f"""<mujoco><option timestep="0.001"/><worldbody>
      <body name="a"><joint axis="0 1 0"/>{bar.format(x=0, z=-0.3)}
      <body name="b" pos="0 0 -.3"><joint axis="0 1 0"/>{bar.format(x=0.4, z=0)}
      <body name="c" pos=".4 0 0"><joint axis="0 1 0"/>{bar.format(x=0, z=0.3)}</body></body></body></worldbody>
      <equality><connect body1="c" anchor="0 0 .3"/></equality>
      <keyframe><key qvel="3 -3 3"/></keyframe></mujoco>"""
    found = read(tmp_path, text, keyframe=0)
    there, here = mujoco_motion(text, found.world, 0.5, key=0)
    np.testing.assert_allclose(here, there, atol=5e-3)
    assert "equality connect0 is a ball joint, which does not yield" in found.left_out


def test_urdf_is_read_with_inertias_joints_and_meshes(tmp_path: Path) -> None:
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv .2 0 0\nv 0 .2 0\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    text = """<robot name="r"><link name="root"/>
      <link name="arm"><inertial><origin xyz="0 0 -.2"/><mass value="2"/>
      <inertia ixx=".05" iyy=".06" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><mesh filename="wedge.obj"/></geometry></collision></link>
      <joint name="pivot" type="revolute"><parent link="root"/><child link="arm"/>
      <origin xyz="0 0 1"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1.5" effort="1" velocity="1"/><dynamics damping="0.1"/></joint></robot>"""
    found = read(tmp_path, text, "arm.urdf")
    arm, pivot = found.world.objects[0], found.world.joints[0]
    assert (arm.mass, arm.position) == (2.0, pytest.approx((0, 0, 0.8)))
    assert isinstance(pivot, Hinge)
    assert (pivot.lower, pivot.upper, pivot.damping) == (-1.0, 1.5, 0.1)
    assert (pivot.axis, pivot.anchor) == (pytest.approx((0, 1, 0)), pytest.approx((0, 0, 1)))
    assert found.left_out[0].startswith("the root link is fixed to the world")


def test_the_root_link_of_a_urdf_file_can_be_free(tmp_path: Path) -> None:
    """A base of 3 kg with a wheel falls with g, with its mesh beside the file."""
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv .2 0 0\nv 0 .2 0\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    inertial = '<inertial><mass value="3"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = f"""<robot name="r"><link name="base">{inertial}
      <collision><geometry><mesh filename="wedge.obj"/></geometry></collision></link>
      <link name="wheel">{inertial}<collision><geometry><sphere radius=".1"/></geometry></collision></link>
      <joint name="axle" type="continuous"><parent link="base"/><child link="wheel"/><origin xyz="1 0 0"/></joint>
      </robot>"""
    path = tmp_path / "cart.urdf"
    path.write_text(text)
    world = import_world(path, floating=True).world
    assert {o.name: o.mass for o in world.objects} == {"base": 3.0, "wheel": 3.0}
    assert rollout(world, 0.2).trajectory.positions[-1, 0, 2] == pytest.approx(-0.5 * 9.81 * 0.04, rel=1e-6)
    with pytest.raises(ValueError, match="leave `floating` out"):
        read(tmp_path, chain(), floating=True)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="endings are"):
        import_world(tmp_path / "model.sdf")
    with pytest.raises(ValueError, match="not read by MuJoCo"):
        read(tmp_path, "<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(ValueError, match="there is no keyframe 'home'"):
        read(tmp_path, chain(), keyframe="home")


def test_a_turned_rotation_keeps_its_quaternion() -> None:
    turn = geometry.quaternion_matrix(np.array([0.5, 0.5, -0.5, 0.5]))
    np.testing.assert_allclose(quaternion(turn), (0.5, 0.5, -0.5, 0.5), atol=1e-15)


def test_a_joint_that_starts_outside_its_range_starts_at_the_nearer_limit(tmp_path: Path) -> None:
    """MuJoCo drives it there; at rest against that limit, both hang alike."""
    text = """<mujoco><compiler angle="degree"/><worldbody><body name="arm" pos="0 0 1">
      <joint name="j" axis="0 1 0" range="-60 -30" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/></body></worldbody></mujoco>"""
    found = read(tmp_path, text)
    assert "joint j starts at its limit -0.5236 instead of 0" in found.left_out[0]
    end = rollout(found.world, 1.0).trajectory.positions[-1, 0]
    np.testing.assert_allclose(end, [0.2 * np.cos(np.pi / 6), 0.0, 1.0 + 0.2 * np.sin(np.pi / 6)], atol=1e-6)
