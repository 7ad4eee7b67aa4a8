"""USD stages as worlds: units, axes, masses, joints and stops, and what is left out."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from polyworld import rollout
from polyworld.exchange import Imported, import_world
from polyworld.world import geometry
from polyworld.world.representations.joint import Ball, Fixed, Hinge, Slider

pxr = pytest.importorskip("pxr.UsdPhysics")
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade  # noqa: E402


class Builder:
    """A stage in centimetres with y up."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "stage.usda"
        self.stage = Usd.Stage.CreateNew(str(self.path))
        UsdGeom.SetStageUpAxis(self.stage, "Y")
        UsdGeom.SetStageMetersPerUnit(self.stage, 0.01)

    def body(self, path: str, at: tuple[float, float, float]) -> Any:
        prim = UsdGeom.Xform.Define(self.stage, path)
        prim.AddTranslateOp().Set(Gf.Vec3d(*at))
        UsdPhysics.RigidBodyAPI.Apply(prim.GetPrim())
        return prim.GetPrim()

    def collider(self, kind: Any, path: str, at: tuple[float, float, float] = (0, 0, 0), **values: Any) -> Any:
        prim = kind.Define(self.stage, path)
        prim.AddTranslateOp().Set(Gf.Vec3d(*at))
        for name, value in values.items():
            getattr(prim, f"Create{name}Attr")(value)
        UsdPhysics.CollisionAPI.Apply(prim.GetPrim())
        return prim.GetPrim()

    def joint(self, kind: Any, path: str, body0: str | None, body1: str, at0: Any, at1: Any, **values: Any) -> Any:
        joint = kind.Define(self.stage, path)
        if body0 is not None:
            joint.CreateBody0Rel().SetTargets([body0])
        joint.CreateBody1Rel().SetTargets([body1])
        joint.CreateLocalPos0Attr(Gf.Vec3f(*at0))
        joint.CreateLocalPos1Attr(Gf.Vec3f(*at1))
        for name, value in values.items():
            getattr(joint, f"Create{name}Attr")(value)
        return joint

    def read(self) -> Imported:
        self.stage.Save()
        return import_world(self.path)


def test_a_rod_on_a_pivot_swings_with_its_period(tmp_path: Path) -> None:
    """A capsule of 2 kg, 0.6 m between its caps, hung by an end at 3 degrees: T = 2 pi sqrt(I / m g l) to 0.1%."""
    build = Builder(tmp_path)
    UsdPhysics.Scene.Define(build.stage, "/scene")
    arm = build.body("/arm", (50, 200, 0))
    rod = build.collider(UsdGeom.Capsule, "/arm/rod", (0, -30, 0), Axis="Y", Radius=5.0, Height=60.0)
    UsdPhysics.MassAPI.Apply(rod).CreateMassAttr(2.0)
    UsdGeom.Xformable(arm).AddRotateZOp().Set(3.0)
    joint = build.joint(UsdPhysics.RevoluteJoint, "/pivot", None, "/arm", (50, 200, 0), (0, 0, 0), Axis="Z")
    joint.CreateLowerLimitAttr(-90.0)
    joint.CreateUpperLimitAttr(45.0)
    found = build.read()
    item, pivot = found.world.objects[0], found.world.joints[0]
    assert found.left_out == ()
    assert isinstance(pivot, Hinge)
    np.testing.assert_allclose(pivot.anchor, (0.5, 0, 2.0), atol=1e-7)
    np.testing.assert_allclose(pivot.axis, (0, -1, 0), atol=1e-7)  # z of the stage
    assert math.degrees(pivot.lower or 0.0) == pytest.approx(-93.0, abs=1e-4)
    assert math.degrees(pivot.upper or 0.0) == pytest.approx(42.0, abs=1e-4)
    assert item.mass == pytest.approx(2.0)
    run = rollout(found.world, 6.0, sample_interval=0.01).trajectory
    x = run.positions[:, 0, 0] - 0.5
    zero = np.flatnonzero(x[1:] * x[:-1] < 0)
    period = 2.0 * np.diff(run.times[zero] + 0.01 * x[zero] / (x[zero] - x[zero + 1])).mean()
    solid = geometry.mass_properties(item.shape)
    inertia = 2.0 * solid.inertia[0, 0] / solid.volume + 2.0 * 0.3**2
    assert period == pytest.approx(2 * math.pi * math.sqrt(inertia / (2.0 * 9.81 * 0.3)), rel=1e-3)


def test_masses_come_from_bodies_colliders_and_materials(tmp_path: Path) -> None:
    """A body's own mass, centre and inertia go first; else its colliders', else densities: 1000 kg/m^3 by default."""
    build = Builder(tmp_path)
    stated = build.body("/stated", (0, 100, 0))
    build.collider(UsdGeom.Sphere, "/stated/ball", Radius=10.0)
    api = UsdPhysics.MassAPI.Apply(stated)
    api.CreateMassAttr(3.0)
    api.CreateCenterOfMassAttr(Gf.Vec3f(0, 5, 0))
    api.CreateDiagonalInertiaAttr(Gf.Vec3f(400, 300, 200))  # kg cm^2
    build.body("/plain", (100, 100, 0))
    build.collider(UsdGeom.Cube, "/plain/box", Size=20.0)
    build.body("/heavy", (200, 100, 0))
    cube = build.collider(UsdGeom.Cube, "/heavy/box", Size=20.0)
    iron = UsdShade.Material.Define(build.stage, "/iron")
    surface = UsdPhysics.MaterialAPI.Apply(iron.GetPrim())
    surface.CreateDensityAttr(0.0078)  # kg/cm^3
    surface.CreateDynamicFrictionAttr(0.25)
    surface.CreateRestitutionAttr(0.5)
    UsdShade.MaterialBindingAPI.Apply(cube).Bind(iron, UsdShade.Tokens.weakerThanDescendants, "physics")
    world = build.read().world
    top, plain, heavy = world.objects
    np.testing.assert_allclose(top.position, (0, 0, 1.05), atol=1e-7)
    solid = geometry.mass_properties(top.shape)
    turn = geometry.quaternion_matrix(np.asarray(top.orientation))
    inertia = turn @ (solid.inertia / solid.volume * 3.0) @ turn.T
    np.testing.assert_allclose(inertia, np.diag((0.04, 0.02, 0.03)), atol=1e-8)
    assert (top.mass, plain.mass) == (3.0, pytest.approx(8.0, rel=1e-6))
    assert heavy.mass == pytest.approx(62.4, rel=1e-6)
    assert (heavy.friction, heavy.restitution) == (0.25, 0.5)


def test_joints_statics_meshes_and_filters(tmp_path: Path) -> None:
    build = Builder(tmp_path)
    build.collider(UsdGeom.Plane, "/ground", Axis="Y")
    points = [(0, 0, 0), (100, 0, 0), (0, 0, 100), (100, 50, 100)]
    hill = build.collider(
        UsdGeom.Mesh, "/hill", Points=points, FaceVertexCounts=[3, 3], FaceVertexIndices=[0, 2, 1, 1, 2, 3]
    )
    UsdPhysics.MeshCollisionAPI.Apply(hill).CreateApproximationAttr("none")
    for number, name in enumerate("abcd"):
        prim = build.body(f"/{name}", (100.0 * number, 100, 0))
        build.collider(UsdGeom.Cube, f"/{name}/box", Size=20.0)
        if name == "d":
            UsdPhysics.RigidBodyAPI(prim).CreateVelocityAttr(Gf.Vec3f(0, 0, 50))
            UsdPhysics.RigidBodyAPI(prim).CreateAngularVelocityAttr(Gf.Vec3f(0, 180, 0))
            UsdPhysics.FilteredPairsAPI.Apply(prim).CreateFilteredPairsRel().AddTarget("/a")
    wall = build.body("/wall", (0, 300, 0))
    UsdPhysics.RigidBodyAPI(wall).CreateKinematicEnabledAttr(True)
    build.collider(UsdGeom.Cube, "/wall/box", Size=20.0)
    slide = build.joint(UsdPhysics.PrismaticJoint, "/rail", "/a", "/b", (0, 0, 0), (-100, 0, 0), Axis="X")
    slide.CreateUpperLimitAttr(50.0)
    UsdPhysics.DriveAPI.Apply(slide.GetPrim(), "linear").CreateStiffnessAttr(7.0)
    build.joint(UsdPhysics.SphericalJoint, "/socket", "/b", "/c", (50, 0, 0), (-50, 0, 0))
    build.joint(UsdPhysics.FixedJoint, "/glue", None, "/a", (0, 100, 0), (0, 0, 0))
    build.joint(UsdPhysics.DistanceJoint, "/string", "/c", "/d", (0, 0, 0), (0, 0, 0))
    found = build.read()
    world, said = found.world, "\n".join(found.left_out)
    kinds = {joint.name: (type(joint), joint.object, joint.other) for joint in world.joints}
    assert kinds == {"rail": (Slider, "b", "a"), "socket": (Ball, "c", "b"), "glue": (Fixed, "a", None)}
    rail = next(joint for joint in world.joints if isinstance(joint, Slider))
    assert (rail.axis, rail.upper) == (pytest.approx((1, 0, 0)), pytest.approx(0.5))
    assert rail.motor is not None
    np.testing.assert_allclose(world.joints[1].anchor, (1.5, 0, 1.0), atol=1e-7)
    assert {s.name: s.shape.kind for s in world.statics} == {"ground": "plane", "hill": "triangle_mesh", "box": "box"}
    assert world.no_contact == (("a", "d"),)
    thrown = world.object("d")
    np.testing.assert_allclose(thrown.velocity, (0, -0.5, 0), atol=1e-7)
    np.testing.assert_allclose(thrown.angular_velocity, (0, 0, math.pi), atol=1e-6)
    for what in (
        "/wall is not moved by forces",
        "joint rail: its drive (stiffness 7",
        "/string is left out: DistanceJoint",
    ):
        assert what in said


def test_a_stage_without_physics_is_refused(tmp_path: Path) -> None:
    build = Builder(tmp_path)
    UsdGeom.Sphere.Define(build.stage, "/ball")
    with pytest.raises(ValueError, match="no rigid bodies or colliders"):
        build.read()
    broken = tmp_path / "broken.usda"
    broken.write_text("no stage")
    with pytest.raises(ValueError, match="not read by USD"):
        import_world(broken)
