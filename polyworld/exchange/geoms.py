"""Geoms of a compiled MuJoCo model as shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.world import geometry
from polyworld.world.description import Appearance, Quaternion, Vec3
from polyworld.world.shapes import (
    Box,
    Capsule,
    ConvexMesh,
    Cylinder,
    Plane,
    Sphere,
    TriangleMesh,
)

Array = NDArray[np.float64]

MOST_VERTICES = 256  # of a convex mesh


@dataclass(frozen=True)
class Placed:
    """A shape at a position (3,) [m] with a rotation (3, 3) in world axes; `said` where it is not the geom's own."""

    shape: Any
    position: Array
    rotation: Array
    said: str = ""


def convex_geom(model: Any, data: Any, geom: int) -> Placed | str:
    """Return a geom as a convex shape, or why that is not possible."""
    from mujoco import mjtGeom

    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    position = np.array(data.geom_xpos[geom])
    rotation = np.array(data.geom_xmat[geom]).reshape(3, 3)
    a, b, c = (float(v) for v in size)
    if kind == mjtGeom.mjGEOM_SPHERE:
        return Placed(Sphere(radius=a), position, rotation)
    if kind == mjtGeom.mjGEOM_BOX:
        return Placed(Box(half_extents=(a, b, c)), position, rotation)
    if kind == mjtGeom.mjGEOM_CYLINDER:
        return Placed(Cylinder(radius=a, half_height=b), position, rotation)
    if kind == mjtGeom.mjGEOM_CAPSULE:
        return Placed(Capsule(radius=a, half_height=b), position, rotation)
    if kind == mjtGeom.mjGEOM_ELLIPSOID:
        if a == b == c:
            return Placed(Sphere(radius=a), position, rotation)
        return _ellipsoid(size, position, rotation)
    if kind == mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        return convex_hull(np.array(model.mesh_vert[first : first + count], dtype=float), position, rotation)
    return f"a {mjtGeom(kind).name.removeprefix('mjGEOM_').lower()} has no counterpart on a body that moves"


def static_geom(model: Any, data: Any, geom: int) -> Placed | str:
    """Return a geom that does not move as the shape of a static, or why that is not possible."""
    from mujoco import mjtGeom

    kind = int(model.geom_type[geom])
    position = np.array(data.geom_xpos[geom])
    rotation = np.array(data.geom_xmat[geom]).reshape(3, 3)
    if kind == mjtGeom.mjGEOM_PLANE:
        normal = rotation[:, 2]
        plane = Plane(normal=vector(normal), offset=float(normal @ position))
        return Placed(plane, np.zeros(3), np.eye(3))
    if kind == mjtGeom.mjGEOM_HFIELD:
        return Placed(_height_field(model, int(model.geom_dataid[geom])), position, rotation)
    return convex_geom(model, data, geom)


def convex_hull(points: Array, position: Array, rotation: Array) -> Placed | str:
    """Return the convex hull of points (k, 3), of at most MOST_VERTICES of them, about its centre of mass."""
    import trimesh

    try:
        hull = trimesh.convex.convex_hull(points)
    except Exception as error:  # Qhull's own errors: flat or too few points
        return f"its {len(points)} points have no convex hull with a volume ({type(error).__name__})"
    vertices, said = np.asarray(hull.vertices, dtype=float), ""
    if len(vertices) > MOST_VERTICES:
        said = f"a convex hull of {MOST_VERTICES} of its {len(vertices)} vertices"
        vertices = _farthest(vertices, MOST_VERTICES)
        hull = trimesh.convex.convex_hull(vertices)
    centre = np.asarray(hull.center_mass, dtype=float)
    shape = ConvexMesh(vertices=tuple(vector(v) for v in vertices - centre))
    return Placed(shape, position + rotation @ centre, rotation, said)


def part_inertia(placed: Placed) -> Array:
    """Inertia (3, 3) of a shape for 1 kg, about its origin, world axes [m^2]."""
    solid = geometry.mass_properties(placed.shape)
    inertia: Array = placed.rotation @ (solid.inertia / solid.volume) @ placed.rotation.T
    return inertia


def quaternion(rotation: Array) -> Quaternion:
    """Unit quaternion w, x, y, z of a rotation matrix, w not negative."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = (float(v) for v in Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))
    return w, x, y, z


def vector(values: Any) -> Vec3:
    """Three numbers as a description holds them."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def appearance(rgba: Any) -> Appearance:
    """A colour of four numbers in 0..1 as #rrggbb."""
    red, green, blue = (round(255 * min(max(float(v), 0.0), 1.0)) for v in rgba[:3])
    return Appearance(color=f"#{red:02x}{green:02x}{blue:02x}")


def _ellipsoid(size: Array, position: Array, rotation: Array) -> Placed:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    # Grown so that the polyhedron has the ellipsoid's volume.
    scale = (4.0 / 3.0 * np.pi / float(ball.volume)) ** (1.0 / 3.0)
    vertices = np.asarray(ball.vertices) * scale * size
    shape = ConvexMesh(vertices=tuple(vector(v) for v in vertices))
    return Placed(shape, position, rotation, f"a polyhedron of {len(vertices)} vertices for an ellipsoid")


def _height_field(model: Any, field: int) -> TriangleMesh:
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    across, along, height, _ = (float(v) for v in model.hfield_size[field])
    first = int(model.hfield_adr[field])
    z = np.array(model.hfield_data[first : first + rows * columns], dtype=float).reshape(rows, columns) * height
    x, y = np.meshgrid(np.linspace(-across, across, columns), np.linspace(-along, along, rows))
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    faces = np.concatenate([lower, upper])
    return TriangleMesh(
        vertices=tuple(vector(v) for v in vertices), faces=tuple((int(a), int(b), int(c)) for a, b, c in faces)
    )


def _farthest(points: Array, count: int) -> Array:
    """Return `count` of the points, each the farthest from those before it, the outermost first."""
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    apart = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.linalg.norm(points - points[chosen[-1]], axis=1))
    found: Array = points[chosen]
    return found
