"""Colliders of a USD stage as shapes, and the masses of bodies that have them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.geoms import Placed, convex_hull, part_inertia, vector
from polyworld.exchange.usd_stage import Stage
from polyworld.world import geometry
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.shapes import Box, Capsule, Cylinder, Plane, Sphere, TriangleMesh

Array = NDArray[np.float64]

WATER = 1000.0  # density of what states none, as UsdPhysics has it [kg/m^3]
# Rotations that take z to the axis a shape is described about.
_ABOUT = {
    "X": np.array(((0.0, 0, 1), (0, 1, 0), (-1, 0, 0))),
    "Y": np.array(((1.0, 0, 0), (0, 0, 1), (0, -1, 0))),
    "Z": np.eye(3),
}
_CONE = 32  # corners of a cone's base


def shape_of(stage: Stage, found: Any, *, moving: bool) -> Placed | str:
    """Return a collider as a shape in world axes, or why that is not possible."""
    kind = str(found.type).rsplit(".", 1)[-1]
    position, rotation = stage.pose(str(found.primPath))
    unit = stage.metre
    if kind == "SphereShape":
        scales = np.linalg.norm(stage.matrix(str(found.primPath))[:3, :3], axis=0)
        said = "a ball, though it is scaled otherwise along its axes" if np.ptp(scales) > 1e-6 * scales.max() else ""
        return Placed(Sphere(radius=found.radius * unit), position, rotation, said)
    if kind == "CubeShape":
        return Placed(Box(half_extents=vector(np.array(found.halfExtents) * unit)), position, rotation)
    if kind == "MeshShape":
        return _mesh(stage, found, position, rotation, moving)
    axis = str(getattr(found, "axis", "Z")).rsplit(".", 1)[-1]
    if axis not in _ABOUT:
        return f"{kind} has no counterpart"
    along = rotation @ _ABOUT[axis]
    if kind == "PlaneShape":
        normal = along[:, 2]
        return Placed(Plane(normal=vector(normal), offset=float(normal @ position)), np.zeros(3), np.eye(3))
    if kind in ("CapsuleShape", "CylinderShape"):
        radius, half_height = found.radius * unit, found.halfHeight * unit
        made = Capsule if kind == "CapsuleShape" else Cylinder
        return Placed(made(radius=radius, half_height=half_height), position, along)
    if kind == "ConeShape":
        angle = np.arange(_CONE) * (2.0 * np.pi / _CONE)
        base = np.stack([np.cos(angle), np.sin(angle)], axis=1) * found.radius * unit
        height = np.full((_CONE, 1), -found.halfHeight * unit)
        points = np.concatenate([np.concatenate([base, height], axis=1), [[0.0, 0.0, found.halfHeight * unit]]])
        cone = convex_hull(points, position, along)
        return cone if isinstance(cone, str) else replace(cone, said="a pyramid for a cone")
    return f"{kind} has no counterpart"


def masses_of(
    stage: Stage, at: str, shapes: list[tuple[Any, Placed]], origin: Array, rotation: Array
) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg m^2] of a body, world axes.

    What the body states goes before what its colliders state, that before their materials' densities (UsdPhysics,
    "Mass properties"). Raises ValueError for a body without colliders that does not state its mass.
    """
    own = stage.mass_api(at)
    stated = float(own.get("Mass", 0.0)) * stage.kilogram
    masses, places, inertias = [], [], []
    for found, placed in shapes:
        mass, centre, inertia = _collider_mass(stage, own, found, placed)
        masses.append(mass)
        places.append(centre)
        inertias.append(inertia)
    total = float(sum(masses))
    if not masses and stated <= 0.0:
        raise ValueError(f"body {at} has neither colliders nor a mass (PhysicsMassAPI): state one of them")
    centre = np.average(places, axis=0, weights=masses) if masses else origin
    if np.isfinite(np.array(own.get("CenterOfMass", (np.inf,) * 3), dtype=float)).all() and "CenterOfMass" in own:
        matrix = stage.matrix(at)
        centre = stage.up @ (matrix[:3, :3] @ np.array(own["CenterOfMass"], dtype=float) + matrix[:3, 3]) * stage.metre
    mass = stated if stated > 0.0 else total
    inertia = np.zeros((3, 3))
    for part, place, tensor in zip(masses, places, inertias, strict=True):
        off = place - centre
        inertia += tensor + part * (off @ off * np.eye(3) - np.outer(off, off))
    if total > 0.0:
        inertia *= mass / total
    diagonal = np.array(own.get("DiagonalInertia", (0.0, 0.0, 0.0)), dtype=float)
    if (diagonal > 0.0).all():
        axes = rotation @ _principal(own)
        inertia = axes @ np.diag(diagonal * stage.kilogram * stage.metre**2) @ axes.T
    elif not masses:
        inertia = mass * 0.4 * 0.01 * np.eye(3)  # a ball of 0.1 m
    return mass, centre, inertia


def _principal(own: dict[str, Any]) -> Array:
    axes = own.get("PrincipalAxes")
    values = np.zeros(4) if axes is None else np.array((axes.GetReal(), *axes.GetImaginary()), dtype=float)
    return quaternion_matrix(values / np.linalg.norm(values)) if np.linalg.norm(values) > 0.5 else np.eye(3)


def _collider_mass(stage: Stage, body: dict[str, Any], found: Any, placed: Placed) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it of one collider."""
    own = stage.mass_api(str(found.primPath))
    volume = geometry.mass_properties(placed.shape).volume
    material = stage.material(found)
    density = WATER if material is None or material.density is None else material.density
    for source in (body, own):  # the collider's own goes before the body's
        if float(source.get("Density", 0.0)) > 0.0:
            density = float(source["Density"]) * stage.kilogram / stage.metre**3
    mass = float(own.get("Mass", 0.0)) * stage.kilogram
    mass = mass if mass > 0.0 else density * volume
    return mass, placed.position, part_inertia(placed) * mass


def _mesh(stage: Stage, found: Any, position: Array, rotation: Array, moving: bool) -> Placed | str:
    points, faces = stage.mesh(str(found.primPath))
    matrix = stage.matrix(str(found.primPath))
    world = (points @ matrix[:3, :3].T + matrix[:3, 3]) @ stage.up.T * stage.metre
    local = (world - position) @ rotation
    kind = str(found.approximation)
    if moving or kind in ("convexHull", "convexDecomposition", "boundingCube", "boundingSphere"):
        hull = convex_hull(local, position, rotation)
        if isinstance(hull, str) or hull.said or kind == "convexHull":
            return hull
        return replace(hull, said="the convex hull of its mesh")
    triangles = [(f[0], a, b) for f in faces for a, b in itertools.pairwise(f[1:])]
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        triangles = [(a, c, b) for a, b, c in triangles]
    mesh = TriangleMesh(vertices=tuple(vector(v) for v in local), faces=tuple(triangles))
    return Placed(mesh, position, rotation)
