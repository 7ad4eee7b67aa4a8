"""Meshes of soft bodies: they fill the shape, close, and are the same on every call."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from polyworld.model import mesh_of
from polyworld.model.soft import soft_form
from polyworld.world import Environment, MotionPlane, World
from polyworld.world.geometry import hull, mass_properties
from polyworld.world.representations.cloth import SurfaceMesh
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere


def surface(mesh: trimesh.Trimesh) -> SurfaceMesh:
    return SurfaceMesh(vertices=mesh.vertices.tolist(), faces=mesh.faces.tolist())


PRIMITIVES = {
    "sphere": Sphere(radius=0.2),
    "box": Box(half_extents=(0.3, 0.2, 0.1)),
    "cylinder": Cylinder(radius=0.2, half_height=0.3),
    "capsule": Capsule(radius=0.1, half_height=0.2),
    "convex": ConvexMesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.8, 0.8, 0.1))),
}
SURFACES = {"torus": trimesh.creation.torus(0.2, 0.07), "cone": trimesh.creation.cone(0.2, 0.4, sections=32)}
SIDE_VIEW = Environment(motion_plane=MotionPlane(normal=(0.0, -1.0, 0.0), supports=False))


def world_of(shape: object, **more: object) -> tuple[World, Soft]:
    item = Soft(name="body", shape=shape, position=(1.0, 2.0, 3.0), orientation=(0.8, 0.36, 0.48, 0.0), **more)
    return World(deformables=(item,), environment=SIDE_VIEW), item


@pytest.mark.parametrize("name", [*PRIMITIVES, *SURFACES])
def test_solid_has_its_volume_a_closed_outward_surface_and_positive_masses(name: str) -> None:
    world, item = world_of(PRIMITIVES.get(name) or surface(SURFACES[name]))
    mesh = mesh_of(world, item)
    volume = mass_properties(PRIMITIVES[name]).volume if name in PRIMITIVES else SURFACES[name].volume
    assert mesh.measure.sum() == pytest.approx(volume, rel=1e-9)
    assert mesh.measure.min() > 0.0
    skin = trimesh.Trimesh(mesh.nodes, mesh.triangles, process=False)
    assert skin.is_watertight
    assert skin.is_winding_consistent
    assert skin.volume == pytest.approx(volume, rel=0.05)
    corners = mesh.nodes[mesh.tetrahedra]
    pieces = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    assert pieces.min() > 0.0
    assert pieces.sum() == pytest.approx(skin.volume, rel=1e-9)


@pytest.mark.parametrize("name", [*PRIMITIVES, *SURFACES])
def test_surface_lies_on_the_shape(name: str) -> None:
    """Within a seventh of an edge length everywhere, sharp edges and corners included."""
    shape = PRIMITIVES.get(name)
    world, item = world_of(shape or surface(SURFACES[name]))
    form = soft_form(world, item)
    nodes = form.nodes[np.unique(form.boundary)]
    if isinstance(shape, Sphere):
        off = np.abs(np.linalg.norm(nodes, axis=1) - shape.radius)
    elif isinstance(shape, Capsule):
        axis = nodes * [0, 0, 1]
        axis[:, 2] = np.clip(axis[:, 2], -shape.half_height, shape.half_height)
        off = np.abs(np.linalg.norm(nodes - axis, axis=1) - shape.radius)
    elif isinstance(shape, Cylinder):
        side = shape.radius - np.linalg.norm(nodes[:, :2], axis=1)
        off = np.abs(np.minimum(side, shape.half_height - np.abs(nodes[:, 2])))
    elif isinstance(shape, Box):
        off = np.abs((np.asarray(shape.half_extents) - np.abs(nodes)).min(axis=1))
    else:
        solid = hull(shape) if isinstance(shape, ConvexMesh) else SURFACES[name]
        dense = trimesh.sample.sample_surface_even(solid, 40_000, seed=3)[0]
        off = cKDTree(dense).query(nodes)[0]
    assert off.max() < np.ptp(form.nodes, axis=0).min() / 3.0 / 7.0


def test_finer_resolution_makes_more_elements_and_a_truer_ball() -> None:
    off = []
    for resolution in (0.2, 0.1, 0.05):
        mesh = mesh_of(*world_of(Sphere(radius=0.2), resolution=resolution))
        skin = trimesh.Trimesh(mesh.nodes, mesh.triangles, process=False)
        off.append(1.0 - skin.volume / (4 / 3 * np.pi * 0.2**3))
    assert off[1] < 0.4 * off[0]
    assert off[2] < 0.4 * off[1]


@pytest.mark.parametrize("name", [*PRIMITIVES, "torus"])
def test_slice_lies_in_the_motion_plane_with_the_area_of_the_section(name: str) -> None:
    world, item = world_of(
        PRIMITIVES.get(name) or surface(SURFACES[name]), representation="soft_planar", thickness=0.05
    )
    mesh = mesh_of(world, item)
    assert np.abs(mesh.nodes[:, 1]).max() < 1e-12
    solids = {
        "sphere": trimesh.creation.icosphere(5, 0.2),
        "box": trimesh.creation.box((0.6, 0.4, 0.2)),
        "cylinder": trimesh.creation.cylinder(0.2, 0.6, sections=128),
        "capsule": trimesh.creation.capsule(0.4, 0.1, count=[64, 64]),
        "convex": hull(PRIMITIVES["convex"]).copy(),
        "torus": SURFACES["torus"].copy(),
    }
    solid = solids[name]
    if name == "capsule":
        solid.apply_translation(-solid.center_mass)
    solid.apply_transform(trimesh.transformations.quaternion_matrix([0.8, 0.36, 0.48, 0.0]))
    expected = _section_area(solid)
    assert mesh.measure.sum() == pytest.approx(0.05 * expected, rel=0.02)
    outline = mesh.nodes[mesh.segments]
    x, z = outline[:, 0][:, [0, 2]], outline[:, 1][:, [0, 2]]
    enclosed = 0.5 * (x[:, 0] * z[:, 1] - x[:, 1] * z[:, 0]).sum()
    assert enclosed == pytest.approx(expected, rel=0.05)  # counter-clockwise seen along +y, against the normal


def _section_area(solid: trimesh.Trimesh) -> float:
    """Area of the section y = 0, by counting where vertical lines are inside."""
    x = np.linspace(*solid.bounds[:, 0], 801)
    lines = trimesh.intersections.mesh_plane(solid, (0, 1, 0), (0, 1e-5, 0))[..., [0, 2]]
    total = 0.0
    for a in 0.5 * (x[1:] + x[:-1]):
        cut = lines[(lines[:, 0, 0] > a) != (lines[:, 1, 0] > a)]
        share = (a - cut[:, 0, 0]) / (cut[:, 1, 0] - cut[:, 0, 0])
        z = np.sort(cut[:, 0, 1] + share * (cut[:, 1, 1] - cut[:, 0, 1]))
        total += (z[1::2] - z[::2]).sum()
    return float(total * (x[1] - x[0]))


def test_same_mesh_on_every_call() -> None:
    """In fresh calls, not from the cache."""
    from polyworld.model import soft

    world, item = world_of(surface(SURFACES["torus"]))
    first = soft.soft_mesh(world, item)
    again = soft.soft_mesh(world.model_copy(), item.model_copy(update={"name": "again"}))
    for name in ("nodes", "measure", "triangles", "tetrahedra"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


def test_surface_with_a_hole_is_refused() -> None:
    open_box = trimesh.creation.box((1, 1, 1))
    open_box.update_faces(np.arange(10))
    with pytest.raises(ValueError, match="'body': its surface mesh is not closed"):
        mesh_of(*world_of(surface(open_box)))


def test_resolution_that_asks_for_too_much_is_refused() -> None:
    with pytest.raises(ValueError, match="give a larger resolution"):
        mesh_of(*world_of(Capsule(radius=0.5, half_height=1.0), resolution=0.005))


@pytest.mark.parametrize(
    "shape", [Sphere(radius=0.2), Box(half_extents=(0.2, 0.1, 0.1)), Cylinder(radius=0.1, half_height=0.2)]
)
@pytest.mark.parametrize("planar", [False, True])
def test_too_many_elements_are_refused_before_any_is_made(shape: object, planar: bool) -> None:
    """At this resolution the nodes alone would fill any memory."""
    representation = "soft_planar" if planar else "soft"
    described = {"name": "jelly", "representation": representation, "shape": shape, "position": (0, 0, 0)}
    item = Soft.model_validate({**described, "resolution": 1e-9})
    with pytest.raises(ValueError, match=r"'jelly': elements of 1e-09 m would be about .* give a larger resolution"):
        mesh_of(World(deformables=(item,), environment=Environment(gravity=(0, 0, 0))), item)
