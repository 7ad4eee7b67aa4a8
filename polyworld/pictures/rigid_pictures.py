"""Rigid bodies, statics and pulleys in a picture: the surfaces, rods and floors that show their shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polyworld.core.kept import BOUNDS, kept
from polyworld.pictures.scene import Drawn, Floor, Rods, Surface
from polyworld.world import World, geometry
from polyworld.world.colors import display_color
from polyworld.world.representations.rope import Pulley
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Plane, Sphere, TriangleMesh, Wall

Array = NDArray[np.float64]
Shape = Sphere | Box | Cylinder | Capsule | ConvexMesh | Plane | Wall | TriangleMesh

STATIC_COLOR = "silver"
PULLEY_COLOR = "gray"


def drawn_solids(world: World, positions: Array, orientations: Array, eye: Array) -> Iterator[Drawn]:
    """Yield the forms of a world's objects, statics, supporting plane and pulleys, labelled as in `render`.

    eye (3,): where the camera is. Objects without a finite position are left out.
    """
    rotations = geometry.quaternion_matrix(orientations)
    for index, item in enumerate(world.objects):
        color = display_color(item.appearance.color, index)
        if np.all(np.isfinite(positions[index])):
            for piece in geometry.pieces(item.shape):
                place = positions[index] + rotations[index] @ piece.position
                yield Drawn(index, color, form(piece.shape, place, rotations[index] @ piece.rotation, eye))
    n = len(world.moving_names)
    for index, static in enumerate(world.statics):
        rotation = geometry.quaternion_matrix(np.asarray(static.orientation))
        color = display_color(static.appearance.color or STATIC_COLOR, 0)
        yield Drawn(n + index, color, form(static.shape, np.asarray(static.position), rotation, eye))
    first = n + len(world.statics)
    plane = world.environment.motion_plane
    if world.planar and plane.supports and float(np.dot(world.environment.gravity, plane.normal)) < 0.0:
        ground = form(Plane(normal=plane.normal), np.asarray(plane.point), np.eye(3), eye)
        yield Drawn(first, display_color(STATIC_COLOR, 0), ground)
    for index, pulley in enumerate(world.pulleys):
        centre, axes = pulley_pose(world, pulley, positions, orientations)
        thick = float(getattr(world.deformable(pulley.rope), "radius", 0.0))
        radius, half_height = max(pulley.radius - thick, 1.5 * thick), max(2 * thick, 0.1 * pulley.radius)
        wheel = form(Cylinder(radius=radius, half_height=half_height), centre, axes, eye)
        yield Drawn(first + 1 + index, display_color(PULLEY_COLOR, 0), wheel)


def pulley_pose(world: World, pulley: Pulley, positions: Array, orientations: Array) -> tuple[Array, Array]:
    """Centre (3,) [m] of a pulley and axes (3, 3) whose third column is the wheel's, objects being as in `render`."""
    centre, axis = np.asarray(pulley.centre, dtype=float), np.asarray(pulley.axis, dtype=float)
    axes = frame_about(axis / np.linalg.norm(axis))
    if pulley.object is None:
        return centre, axes
    item = world.object(pulley.object)
    index = world.moving_names.index(pulley.object)
    start = geometry.quaternion_matrix(np.asarray(item.orientation))
    turn = geometry.quaternion_matrix(np.asarray(orientations[index])) @ start.T
    return np.asarray(positions[index]) + turn @ (centre - np.asarray(item.position)), turn @ axes


def form(shape: Shape, position: Array, rotation: Array, eye: Array) -> Surface | Rods | Floor:
    """Return the form of a shape at a position (3,) [m] and rotation (3, 3), as seen from an eye (3,)."""
    if isinstance(shape, Plane):
        normal = np.asarray(shape.normal, dtype=float) / np.linalg.norm(shape.normal)
        return Floor(position + rotation @ (normal * shape.offset), (rotation @ frame_about(normal)).T)
    if isinstance(shape, Sphere | Capsule | Cylinder):
        reach = 0.0 if isinstance(shape, Sphere) else shape.half_height
        tip = reach * rotation[:, 2]
        ends = (position - tip)[None], (position + tip)[None]
        return Rods(*ends, np.array([shape.radius]), np.ones(1), flat=isinstance(shape, Cylinder))
    corners = _corners(shape) @ rotation.T + position
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    behind = ((corners[:, 0] - eye) * normals).sum(axis=1) > 0.0
    if isinstance(shape, TriangleMesh):  # both sides of a face look the same
        corners[behind], normals[behind] = corners[behind, ::-1], -normals[behind]
    else:  # faces turned away are never seen, and from inside a body the others are not
        corners, normals = corners[~behind], normals[~behind]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    count = len(corners)
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Surface(corners.reshape(-1, 3), triangles, np.repeat(normals, 3, axis=0), np.ones(count))


@kept(BOUNDS.shapes)
def _corners(shape: Box | ConvexMesh | Wall | TriangleMesh) -> Array:
    """Corners (t, 3, 3) of a shape's faces in its own axes, counter-clockwise seen from outside."""
    if isinstance(shape, TriangleMesh):
        corners: Array = np.asarray(shape.vertices, dtype=float)[np.asarray(shape.faces)]
    elif isinstance(shape, Wall):
        box, centre, turn = geometry.wall_box(shape)
        corners = _corners(box) @ turn.T + centre
    else:
        corners = np.asarray(geometry.surface_mesh(shape).triangles, dtype=float)
    return corners


def frame_about(normal: Array) -> Array:
    """Return a rotation (3, 3) whose third column is the unit vector `normal`; the identity for +z."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = helper - (helper @ normal) * normal
    x /= np.linalg.norm(x)
    frame: Array = np.stack([x, np.cross(normal, x), normal], axis=1)
    return frame
