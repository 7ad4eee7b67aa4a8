"""Volumes, inertia, hulls, footprints and rotations of the shapes a world is made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from polyworld.world import MotionPlane
from polyworld.world.shapes import Box, Capsule, Compound, ConvexMesh, Cylinder, Sphere, Wall, inertia_matrix

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]
ConvexShape = Sphere | Box | Cylinder | Capsule | ConvexMesh
Solid = ConvexShape | Compound

ROUND_CORNERS = 64  # of the polygon that stands for a disc where outlines are joined


@dataclass(frozen=True)
class MassProperties:
    """volume [m^3]; inertia (3, 3) about the centre of mass for unit density [m^5]."""

    volume: float
    inertia: Array


@lru_cache(maxsize=512)
def hull(shape: ConvexMesh) -> trimesh.Trimesh:
    """Convex hull with outward faces, moved so that its centre of mass is the origin."""
    import trimesh  # slow to import, and only hulls and meshes need it

    solid: trimesh.Trimesh = trimesh.convex.convex_hull(np.asarray(shape.vertices, dtype=float))
    solid.apply_translation(-solid.center_mass)
    return solid


def surface_mesh(shape: ConvexShape) -> trimesh.Trimesh:
    """Return the surface of a convex shape about its origin [m]."""
    import trimesh

    mesh: trimesh.Trimesh
    if isinstance(shape, ConvexMesh):
        return hull(shape)
    if isinstance(shape, Sphere):
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=shape.radius)
    elif isinstance(shape, Box):
        mesh = trimesh.creation.box(extents=2.0 * np.asarray(shape.half_extents))
    elif isinstance(shape, Cylinder):
        mesh = trimesh.creation.cylinder(radius=shape.radius, height=2.0 * shape.half_height)
    else:
        mesh = trimesh.creation.capsule(radius=shape.radius, height=2.0 * shape.half_height)
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return mesh


@dataclass(frozen=True)
class Piece:
    """A convex piece of a body: position (3,) of its origin and rotation (3, 3) of its axes, in body axes."""

    shape: ConvexShape
    position: Array
    rotation: Array


@lru_cache(maxsize=512)
def pieces(shape: Solid) -> tuple[Piece, ...]:
    """The convex pieces of a body about its centre of mass; a convex shape is its own only piece."""
    if not isinstance(shape, Compound):
        return (Piece(shape, np.zeros(3), np.eye(3)),)
    places = np.array([part.position for part in shape.parts])
    volumes = np.array([mass_properties(part.shape).volume for part in shape.parts])
    centre = volumes @ places / volumes.sum() if shape.centre_of_mass is None else np.asarray(shape.centre_of_mass)
    return tuple(
        Piece(part.shape, place - centre, quaternion_matrix(np.asarray(part.orientation)))
        for part, place in zip(shape.parts, places, strict=True)
    )


@lru_cache(maxsize=512)
def mass_properties(shape: Solid) -> MassProperties:
    """Volume and unit-density inertia of a solid shape (any mechanics handbook); pieces of a compound add up."""
    if isinstance(shape, Compound):
        volume, inertia = 0.0, np.zeros((3, 3))
        for piece in pieces(shape):
            own, p = mass_properties(piece.shape), piece.position
            volume += own.volume
            inertia += piece.rotation @ own.inertia @ piece.rotation.T
            inertia += own.volume * (p @ p * np.eye(3) - np.outer(p, p))  # Huygens and Steiner
        return MassProperties(volume, inertia if shape.inertia is None else volume * inertia_matrix(shape.inertia))
    if isinstance(shape, Sphere):
        volume = 4.0 / 3.0 * np.pi * shape.radius**3
        return MassProperties(volume, np.eye(3) * 0.4 * volume * shape.radius**2)
    if isinstance(shape, Box):
        a = np.asarray(shape.half_extents)
        volume = float(8.0 * a.prod())
        return MassProperties(volume, np.diag(volume / 3.0 * ((a**2).sum() - a**2)))
    if isinstance(shape, Cylinder):
        r, h = shape.radius, shape.half_height
        volume = 2.0 * np.pi * r**2 * h
        side = volume * (r**2 / 4.0 + h**2 / 3.0)
        return MassProperties(volume, np.diag([side, side, volume * r**2 / 2.0]))
    if isinstance(shape, Capsule):
        r, h = shape.radius, shape.half_height
        rod, ball = 2.0 * np.pi * r**2 * h, 4.0 / 3.0 * np.pi * r**3
        side = rod * (r**2 / 4 + h**2 / 3) + ball * (0.4 * r**2 + h**2 + 0.75 * h * r)
        return MassProperties(rod + ball, np.diag([side, side, rod * r**2 / 2 + ball * 0.4 * r**2]))
    solid = hull(shape)
    return MassProperties(float(solid.volume), np.asarray(solid.moment_inertia, dtype=float))


def equivalent_radius(shape: Solid) -> float:
    """Radius of the ball of a shape's volume [m]."""
    return float(np.cbrt(0.75 * mass_properties(shape).volume / np.pi))


@lru_cache(maxsize=512)
def circumscribed_radius(shape: Solid) -> float:
    """Radius [m] of the smallest ball about the centre of mass that holds the shape; an upper bound for compounds."""
    if isinstance(shape, Compound):
        return max(float(np.linalg.norm(p.position)) + circumscribed_radius(p.shape) for p in pieces(shape))
    if isinstance(shape, Sphere):
        return shape.radius
    if isinstance(shape, Box):
        return float(np.linalg.norm(shape.half_extents))
    if isinstance(shape, Cylinder):
        return float(np.hypot(shape.radius, shape.half_height))
    if isinstance(shape, Capsule):
        return shape.radius + shape.half_height
    return float(np.linalg.norm(hull(shape).vertices, axis=1).max())


def wall_box(wall: Wall) -> tuple[Box, Array, Array]:
    """The box a wall is, its centre (3,) and its rotation matrix (3, 3); box x runs along the wall."""
    start, end = np.asarray(wall.start), np.asarray(wall.end)
    along = end - start
    length = float(np.linalg.norm(along))
    along = along / length
    up = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    up = up - (up @ along) * along
    up /= np.linalg.norm(up)
    rotation = np.stack([along, np.cross(up, along), up], axis=1)
    box = Box(half_extents=(length / 2, wall.thickness / 2, wall.height / 2))
    return box, (start + end) / 2 + up * wall.height / 2, rotation


def plane_axes(plane: MotionPlane) -> Array:
    """Rows x, y, n (3, 3): a right-handed frame of the motion plane.

    For a normal along +z these are the world axes; for a vertical plane y is up, as seen by a viewer whom
    the normal points at.
    """
    return _axes_across(tuple(plane.normal))


@lru_cache(maxsize=256)
def _axes_across(normal: tuple[float, ...]) -> Array:
    n = np.asarray(normal, dtype=float)
    n = n / np.linalg.norm(n)
    up = np.array([0.0, 0.0, 1.0]) if abs(n[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    y = up - (up @ n) * n
    y /= np.linalg.norm(y)
    axes = np.stack([np.cross(y, n), y, n])
    axes.setflags(write=False)  # all who ask share them
    return axes


def quaternion_matrix(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4) w, x, y, z."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(r, axis=-1) for r in rows], axis=-2)


def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (..., 4): first b, then a, as rotations."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=float), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=float), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def rotation_quaternion(rotation_vector: Array) -> Array:
    """Unit quaternions (..., 4) of rotation vectors (..., 3) [rad]."""
    v = np.asarray(rotation_vector, dtype=float)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    # sin(a/2)/a is finite at 0: numpy's sinc is sin(pi x)/(pi x)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)


def planar_outline(shape: Solid, rotation: Array, axes: Array) -> tuple[Array, float]:
    """Projection of a shape on the motion plane: a convex polygon swept by a disc.

    rotation (3, 3) is the shape's rest orientation, axes (3, 3) the rows of `plane_axes`. Returns the
    polygon's vertices (k, 2), counter-clockwise about the centre of mass (k = 1 for a disc, 2 for a capsule
    lying down), and the disc's radius [m]. A compound's outline is the convex hull of its pieces' outlines.
    """
    if isinstance(shape, Compound):
        joined = np.concatenate([_flat_points(piece, rotation, axes) for piece in pieces(shape)])
        around: Array = joined[ConvexHull(joined).vertices]
        return around, 0.0
    if isinstance(shape, Sphere):
        return np.zeros((1, 2)), shape.radius
    to_plane = axes @ rotation  # body axes to plane axes
    if isinstance(shape, Capsule):
        tip = to_plane[:2, 2] * shape.half_height
        if np.linalg.norm(tip) < 1e-9:
            return np.zeros((1, 2)), shape.radius
        return np.stack([-tip, tip]), shape.radius
    if isinstance(shape, Cylinder):
        if abs(to_plane[2, 2]) > 1.0 - 1e-9:
            return np.zeros((1, 2)), shape.radius
        angle = np.arange(16) * (2 * np.pi / 16)
        ring = np.stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle), np.zeros(16)], axis=1)
        lift = np.array([0.0, 0.0, shape.half_height])
        points = np.concatenate([ring - lift, ring + lift])
    elif isinstance(shape, Box):
        corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1).reshape(-1, 3)
        points = corners * np.asarray(shape.half_extents)
    else:
        points = np.asarray(hull(shape).vertices, dtype=float)
    flat = points @ to_plane[:2].T
    outline: Array = flat[ConvexHull(flat).vertices]
    return outline, 0.0


def _flat_points(piece: Piece, rotation: Array, axes: Array) -> Array:
    """Corners (k, 2) of a piece's outline about the body's centre, round ones as polygons around them."""
    outline, radius = planar_outline(piece.shape, rotation @ piece.rotation, axes)
    points: Array = outline + axes[:2] @ rotation @ piece.position
    if radius > 0.0:
        angle = np.arange(ROUND_CORNERS) * (2.0 * np.pi / ROUND_CORNERS)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (radius / np.cos(np.pi / ROUND_CORNERS))
        points = (points[:, None] + ring).reshape(-1, 2)
    return points


def footprint_radius(shape: Solid, outline: Array) -> float:
    """Mean distance of the supporting patch from the centre of mass [m]: 2/3 R for a flat disc, 0 for a ball.

    With uniform pressure the spinning-friction moment of a patch is mu N times this radius.
    """
    if isinstance(shape, Sphere | Capsule):
        return 0.0
    if isinstance(shape, Cylinder) and len(outline) == 1:
        return 2.0 / 3.0 * shape.radius
    # Over a triangle (centre, a, b) the integral of |p| is 2/3 of its area times the mean of |p| along the edge.
    node, weight = np.polynomial.legendre.leggauss(16)
    total, area = 0.0, 0.0
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        triangle = 0.5 * abs(a[0] * b[1] - a[1] * b[0])
        edge = a + 0.5 * (node[:, None] + 1.0) * (b - a)
        total += triangle * 2.0 / 3.0 * float(0.5 * weight @ np.linalg.norm(edge, axis=1))
        area += triangle
    return total / area if area > 0 else 0.0
