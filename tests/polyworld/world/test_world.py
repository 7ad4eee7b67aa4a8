"""A world is immutable, closed to mistakes, and known by its content."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from polyworld.model import model_of
from polyworld.world import Effect, MotionPlane, World, geometry
from polyworld.world.parameters import parameter_paths, read_parameter, with_parameters
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere


def ball(name: str = "ball", **fields: object) -> RigidObject:
    return RigidObject.model_validate(
        {"name": name, "shape": {"kind": "sphere", "radius": 0.1}, "position": (0, 0, 0.1), **fields}
    )


def test_equal_content_has_equal_id_and_survives_json() -> None:
    world = World(objects=(ball(orientation=(0.3, 0.1, -0.7, 0.2)),))
    assert World.model_validate_json(world.model_dump_json()).id == world.id
    assert World(objects=(ball(orientation=(0.3, 0.1, -0.7, 0.2)),)).id == world.id


def test_any_changed_value_changes_the_id() -> None:
    world = World(objects=(ball(),), effects=(Effect(name="air", kind="linear_drag"),))
    ids = {world.id}
    for path in parameter_paths(world):
        value = read_parameter(world, path)
        ids.add(with_parameters(world, {path: 0.25 if value is None else value + 0.125}).id)
    # angular_velocity, velocity, ...: every path leads to a different world
    assert len(ids) == 1 + len(parameter_paths(world))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"friction": -0.1}, "friction"),
        ({"restitution": 1.2}, "restitution"),
        ({"mass": 0.0}, "mass"),
        ({"orientation": (0, 0, 0, 0)}, "zero quaternion"),
        ({"velocity": (math.nan, 0, 0)}, "velocity"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_bad_object_is_refused_by_name(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ball(**fields)


def test_flat_mesh_is_refused() -> None:
    with pytest.raises(ValidationError, match="span a volume"):
        ConvexMesh(vertices=((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)))


def test_repeated_names_and_mixed_representations_are_refused() -> None:
    with pytest.raises(ValidationError, match="repeated"):
        World(objects=(ball(), ball()))
    with pytest.raises(ValidationError, match="planar and spatial objects cannot share one world"):
        World(objects=(ball(), ball("other", representation="rigid_planar")))


def test_unknown_effect_names_the_catalogue() -> None:
    with pytest.raises(ValidationError, match="quadratic_drag"):
        World(objects=(ball(),), effects=(Effect(name="e", kind="aether"),))


def test_value_outside_bounds_is_refused_with_the_bounds() -> None:
    world = World(objects=(ball(),))
    with pytest.raises(ValueError, match=r"0\.0 to 1\.0"):
        with_parameters(world, {"objects.ball.restitution": 1.5})
    with pytest.raises(KeyError, match=r"objects\.ball\.friction"):
        read_parameter(world, "objects.ball.frction")


def test_overrides_reach_the_arrays_like_a_changed_world() -> None:
    world = World(objects=(ball(), ball("other", position=(1, 0, 0.1))))
    values = {"objects.other.rotation.z": 0.4, "objects.ball.velocity.y": -2.0, "environment.gravity.x": 0.5}
    batch = model_of(world).arrays({path: np.array([0.0, value]) for path, value in values.items()})
    single = model_of(with_parameters(world, values)).arrays()
    for field in ("orientation", "velocity", "gravity"):
        np.testing.assert_allclose(getattr(batch, field)[1], getattr(single, field)[0], atol=1e-15)


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(radius=0.3),
        Box(half_extents=(0.1, 0.2, 0.4)),
        Cylinder(radius=0.2, half_height=0.5),
        Capsule(radius=0.2, half_height=0.3),
    ],
)
def test_mass_properties_agree_with_sampling(shape: geometry.ConvexShape) -> None:
    # Monte Carlo over the bounding box: independent of every formula.
    points = np.random.default_rng(7).uniform(-1, 1, (2_000_000, 3)) * 0.6
    x, y, z = points.T
    if isinstance(shape, Sphere):
        inside = x**2 + y**2 + z**2 < shape.radius**2
    elif isinstance(shape, Box):
        inside = np.all(np.abs(points) < shape.half_extents, axis=1)
    elif isinstance(shape, Cylinder):
        inside = (x**2 + y**2 < shape.radius**2) & (np.abs(z) < shape.half_height)
    else:
        inside = x**2 + y**2 + np.maximum(np.abs(z) - shape.half_height, 0) ** 2 < shape.radius**2
    cell = 1.2**3 / len(points)
    kept = points[inside]
    inertia = (np.eye(3) * (kept**2).sum() - kept.T @ kept) * cell
    found = geometry.mass_properties(shape)
    assert found.volume == pytest.approx(len(kept) * cell, rel=0.01)
    np.testing.assert_allclose(found.inertia, inertia, rtol=0.02, atol=0.01 * inertia.max())


def test_convex_mesh_of_a_box_weighs_like_the_box() -> None:
    corners = [(x, y, z) for x in (0, 0.2) for y in (0, 0.4) for z in (0, 0.8)]
    mesh = geometry.mass_properties(ConvexMesh(vertices=tuple(corners)))
    box = geometry.mass_properties(Box(half_extents=(0.1, 0.2, 0.4)))
    assert mesh.volume == pytest.approx(box.volume)
    np.testing.assert_allclose(mesh.inertia, box.inertia, atol=1e-12)


def test_quaternions_agree_with_scipy() -> None:
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(20, 3))
    expected = Rotation.from_rotvec(vectors)
    q = geometry.rotation_quaternion(vectors)
    np.testing.assert_allclose(geometry.quaternion_matrix(q), expected.as_matrix(), atol=1e-12)
    product = geometry.quaternion_product(q[:10], q[10:])
    np.testing.assert_allclose(
        geometry.quaternion_matrix(product), (expected[:10] * expected[10:]).as_matrix(), atol=1e-12
    )


def test_footprint_of_a_square_has_the_published_mean_radius() -> None:
    # Mean distance to the centre of a square of side a: a (sqrt 2 + ln(1 + sqrt 2)) / 6.
    box = Box(half_extents=(0.2, 0.2, 0.2))
    outline, _ = geometry.planar_outline(box, np.eye(3), geometry.plane_axes(MotionPlane()))
    expected = 0.4 * (math.sqrt(2) + math.log(1 + math.sqrt(2))) / 6
    assert geometry.footprint_radius(box, outline) == pytest.approx(expected, rel=1e-4)
