"""Contacts of cloth and ropes with themselves and with each other: nothing passes through."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.solver.coupled.contact_obstacles import surface_edges
from polyworld.world import Environment, MotionPlane, World
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Sphere
from tests.verification.coupled_world import FLOOR, VACUUM, Run, pinned_corners, sheet

Array = NDArray[np.float64]
ROPE = {"linear_density": 0.05, "stretch_stiffness": 2000.0, "stretch_damping": 1e-3, "bending_stiffness": 1e-4}


def crossings(points: Array, edges: NDArray[np.int32], triangles: NDArray[np.int32]) -> int:
    """How many edges run through triangles that they do not belong to (Moeller & Trumbore 1997)."""
    a = points[triangles[:, 0]]
    u, v = points[triangles[:, 1]] - a, points[triangles[:, 2]] - a
    origin, way = points[edges[:, 0]][:, None], (points[edges[:, 1]] - points[edges[:, 0]])[:, None]
    h = np.cross(way, v)
    det = (u * h).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - a
        q = np.cross(s, u)
        first, second = (s * h).sum(-1) / det, (way * q).sum(-1) / det
        along = (v * q).sum(-1) / det
        inside = (first > 0) & (second > 0) & (first + second < 1) & (along > 0) & (along < 1)
    shared = (edges[:, None, :, None] == triangles[None, :, None, :]).any(axis=(2, 3))
    return int((inside & ~shared).sum())


@pytest.mark.parametrize("self_contact", [True, False])
def test_folding_sheet_keeps_its_layers_apart_where_it_is_asked_to(self_contact: bool) -> None:
    """A sheet that stands on its edge falls and folds over itself; without self-contact the layers mix."""
    geometry = Sheet(corner=(-0.2, 0.0, 0.02), edge_u=(0.4, 0.0, 0.0), edge_v=(0.0, 0.03, 0.5), divisions=(8, 12))
    cloth = Cloth(
        name="cloth",
        geometry=geometry,
        thickness=0.006,
        stretch_stiffness=50.0,
        stretch_damping=0.01,
        bending_stiffness=1e-6,
        linear_damping=1.0,
        self_contact=self_contact,
    )
    world = World(statics=(FLOOR,), deformables=(cloth,))
    run = Run(world, 0.8, samples=9)
    mesh = mesh_of(world, cloth)
    through = [crossings(p, surface_edges(mesh), mesh.triangles) for p in run.points("cloth")]
    if self_contact:
        assert max(through) == 0
        assert run.points("cloth")[-1, :, 2].max() < 0.2  # it did fall
    else:
        assert max(through) > 20


def test_cloth_falling_on_cloth_is_carried_and_the_pins_hold_both() -> None:
    n = (5, 5)
    fields = {"stretch_stiffness": 100.0, "stretch_damping": 0.02, "linear_damping": 6.0}
    lower = sheet("lower", (0.0, 0.0, 0.0), 0.6, 0.6, n, **fields)
    upper = sheet("upper", (0.21, 0.19, 0.03), 0.2, 0.2, (4, 4), **fields)
    pins = pinned_corners("lower", n)
    run = Run(World(environment=VACUUM, deformables=(lower, upper), attachments=pins), 1.5, samples=5)
    held = sum(force[0, 2] for force in run.shard.attachments.forces().values())
    assert held == pytest.approx(9.81 * 0.2 * (0.36 + 0.04), rel=0.01)
    assert {e.participants for e in run.trajectory.events[0]} == {("lower", "upper")}


def test_rope_dropped_across_a_rope_hangs_on_it() -> None:
    low = Rope(name="low", points=((-0.4, 0, 0), (0.4, 0, 0)), segments=20, radius=0.008, linear_damping=1.0, **ROPE)
    high = Rope(
        name="high", points=((0, -0.3, 0.05), (0.02, 0.3, 0.05)), segments=15, radius=0.008, linear_damping=1.0, **ROPE
    )
    pins = (
        Attachment(name="a", object="low", end="start"),
        Attachment(name="b", object="low", end="end"),
    )
    run = Run(World(deformables=(low, high), attachments=pins), 1.2, samples=13)
    top = run.points("high")[:, :, 2].max(axis=1)
    assert top[-1] > -0.1
    middle = run.points("low")[-1, :, 2].min()
    assert top[-1] - middle == pytest.approx(0.016, abs=0.008)  # twice the radius, and the ropes' bends


def test_loop_of_rope_pulled_tight_does_not_pass_through_itself() -> None:
    """An overhand loop pulled at both ends: at its crossing the rope is never nearer to itself than it is thick."""
    s = np.linspace(0.0, 1.0, 61)
    angle = 2.0 * np.pi * np.clip((s - 0.3) / 0.4, 0.0, 1.0)
    x = np.where(s < 0.3, s - 0.3, np.where(s > 0.7, s - 0.7, 0.06 * np.sin(angle)))
    y = 0.06 * (1.0 - np.cos(angle))
    z = 0.03 * (s - 0.5) / 0.5
    rope = Rope(
        name="rope", points=tuple(zip(x, y, z, strict=True)), segments=60, radius=0.006, linear_damping=2.0, **ROPE
    )
    pull = (
        Attachment(name="a", object="rope", end="start", motion=((0, 0, 0, 0), (0.5, -0.05, 0, 0))),
        Attachment(name="b", object="rope", end="end", motion=((0, 0, 0, 0), (0.5, 0.05, 0, 0))),
    )
    run = Run(World(environment=VACUUM, deformables=(rope,), attachments=pull), 0.5, samples=11)
    for points in run.points("rope"):
        middle = 0.5 * (points[1:] + points[:-1])
        apart = np.linalg.norm(middle[:, None] - middle[None], axis=2)
        far_along = np.abs(np.subtract.outer(np.arange(60), np.arange(60))) > 8
        assert apart[far_along].min() > 0.9 * 0.012


def test_discs_in_a_plane_collide_as_balls_do_and_a_planar_rope_catches_one() -> None:
    plane = MotionPlane(normal=(0.0, -1.0, 0.0))
    shared = {
        "representation": "soft_planar",
        "shape": Sphere(radius=0.1),
        "resolution": 0.07,
        "youngs_modulus": 5e4,
        "damping": 0.003,
    }
    one = Soft.model_validate({"name": "one", "position": (-0.15, 0, 0), "velocity": (1, 0, 0), **shared})
    two = Soft.model_validate({"name": "two", "position": (0.15, 0, 0.03), "velocity": (-1, 0, 0), **shared})
    free = Environment(motion_plane=plane, gravity=(0, 0, 0))
    run = Run(World(environment=free, deformables=(one, two)), 0.4)
    momentum = run.momentum()
    assert np.abs(momentum - momentum[0]).max() < 1e-12
    assert run.trajectory.velocities[0, -1, 0, 0] < -0.3
    rope = Rope(name="rope", representation="rope_planar", points=((-0.3, 0, -0.12), (0.3, 0, -0.12)), segments=16)
    pins = (Attachment(name="a", object="rope", end="start"), Attachment(name="b", object="rope", end="end"))
    falling = one.model_copy(update={"position": (0.0, 0.0, 0.0), "velocity": (0.0, 0.0, 0.0)})
    world = World(environment=Environment(motion_plane=plane), deformables=(falling, rope), attachments=pins)
    caught = Run(world, 0.6)
    assert caught.points("one")[:, :, 2].min() > -0.4
    gap = caught.points("one")[-1, :, 2].min() - caught.points("rope")[-1, :, 2].min()
    assert gap > 0.0
