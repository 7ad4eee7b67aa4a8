"""Soft bodies divided into quadratic tetrahedra or, in a plane, triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from polyworld.core.kept import BOUNDS, kept
from polyworld.model.mesh import DeformableMesh
from polyworld.model.soft_box import box_tetrahedra
from polyworld.model.soft_elements import QuadraticMesh, quadratic_slice, quadratic_solid, with_volume
from polyworld.model.soft_lattice import MOST, filled
from polyworld.model.soft_outline import area, nearest_on, outline_triangles, rectangle_triangles, section
from polyworld.model.soft_round import ball_tetrahedra, cylinder_tetrahedra, disc_triangles
from polyworld.model.soft_surface import CapsuleSurface, MeshSurface
from polyworld.world import World
from polyworld.world.geometry import hull, mass_properties, plane_axes, quaternion_matrix
from polyworld.world.materials import PLANAR
from polyworld.world.representations.cloth import SurfaceMesh
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere

Array = NDArray[np.float64]
Shape = Sphere | Box | Cylinder | Capsule | ConvexMesh | SurfaceMesh

CONTACT_RADIUS = 0.01  # of the edge length: nodes are points of the surface, so nearly nothing
DIVISIONS = 3.0  # elements across the smallest extent, unless a resolution is given
SECTIONS = 96  # sides of a round body where a slice is cut out of it aslant


def soft_mesh(world: World, item: Soft) -> DeformableMesh:
    """Nodes, surface and linear tetrahedra of a soft body as it starts.

    Each 10-node tetrahedron appears as eight linear ones over its nodes, each of its surface faces as four
    triangles; of a soft_planar slice `triangles` fill it and `segments` are its outline, the inside on their left
    as seen against the motion plane's normal. Raises ValueError for a shape that holds no elements.
    """
    form = soft_form(world, item)
    if form.planar:
        plane = world.environment.motion_plane
        axes = plane_axes(plane)
        place, point = np.asarray(item.position), np.asarray(plane.point)
        place = place - ((place - point) @ axes[2]) * axes[2]
        nodes = form.nodes @ axes + place
    else:
        nodes = form.nodes @ quaternion_matrix(np.asarray(item.orientation)).T + np.asarray(item.position)
    return DeformableMesh(
        nodes=nodes,
        measure=form.measure(),
        radius=np.full(len(nodes), CONTACT_RADIUS * edge_length(item)),
        segments=form.segments(),
        triangles=form.triangles(),
        tetrahedra=form.tetrahedra(),
    )


def soft_form(world: World, item: Soft) -> QuadraticMesh:
    """The body without forces, in its own axes, a slice in those of the motion plane. Equal bytes on every call.

    Raises ValueError for more than `MOST` elements, and for shapes that cannot be divided.
    """
    _check_count(item)
    if item.representation == "soft":
        return _solid(item.name, item.shape, edge_length(item))
    axes = plane_axes(world.environment.motion_plane)
    turn = axes @ quaternion_matrix(np.asarray(item.orientation))
    rows = tuple(float(x) for x in turn.ravel())
    return _slice(item.name, item.shape, edge_length(item), rows, item.thickness)


def edge_length(item: Soft) -> float:
    """Edge length that the elements aim at [m]."""
    return item.resolution if item.resolution is not None else smallest_extent(item.shape) / DIVISIONS


def smallest_extent(shape: Shape) -> float:
    """Smallest width of the shape's bounding box in its own axes [m]."""
    return float(_extent(shape).min())


def _extent(shape: Shape) -> Array:
    """Widths (3,) of the shape's bounding box in its own axes [m]."""
    if isinstance(shape, Box):
        return 2.0 * np.asarray(shape.half_extents, dtype=float)
    if isinstance(shape, Sphere | Capsule | Cylinder):
        half = shape.radius if isinstance(shape, Sphere) else shape.half_height
        half += shape.radius if isinstance(shape, Capsule) else 0.0
        return 2.0 * np.array([shape.radius, shape.radius, half])
    vertices = np.asarray(shape.vertices, dtype=float)
    widths: Array = np.ptp(vertices, axis=0)
    return widths


def predicted_elements(item: Soft) -> float:
    """Return how many elements the bounding box of the shape would hold: an upper estimate, without dividing it."""
    cells = _extent(item.shape) / edge_length(item)
    if item.representation.endswith(PLANAR):
        return 2.0 * float(np.prod(np.sort(cells)[1:]))
    return 6.0 * float(np.prod(cells))


def _check_count(item: Soft) -> None:
    """Refuse, before any work, elements of which the bounding box would hold more than `MOST`."""
    count = predicted_elements(item)
    if count > MOST:
        raise ValueError(
            f"soft body {item.name!r}: elements of {edge_length(item):.3g} m would be about {count:.2g}, more than "
            f"{MOST}: give a larger resolution"
        )


@kept(BOUNDS.shapes)
def _solid(name: str, shape: Shape, edge: float) -> QuadraticMesh:
    if isinstance(shape, Box):
        return quadratic_solid(*box_tetrahedra(shape.half_extents, edge))
    if isinstance(shape, Sphere):
        points, cells = ball_tetrahedra(shape.radius, edge)
        mesh = quadratic_solid(points, cells, lambda p: p * (shape.radius / np.linalg.norm(p, axis=1))[:, None])
        return with_volume(mesh, mass_properties(shape).volume)
    if isinstance(shape, Cylinder):
        return _cylinder(shape, edge)
    if isinstance(shape, Capsule):
        return filled(CapsuleSurface(shape.radius, shape.half_height), edge, mass_properties(shape).volume)
    closed = _closed(name, shape) if isinstance(shape, SurfaceMesh) else hull(shape)
    return filled(MeshSurface(closed), edge, float(closed.volume))


def _cylinder(shape: Cylinder, edge: float) -> QuadraticMesh:
    points, cells = cylinder_tetrahedra(shape.radius, shape.half_height, edge)
    rings = len(np.unique(np.rint(np.linalg.norm(points[:, :2], axis=1) / (1e-6 * shape.radius)))) - 1

    def snap(middles: Array) -> Array:
        """Middles of edges round the side moved out to it; those within the caps lie nearer to the axis."""
        distance = np.linalg.norm(middles[:, :2], axis=1)
        outer = distance > shape.radius * (np.cos(np.pi / (6 * rings)) - 1e-6)
        moved = middles.copy()
        moved[outer, :2] *= (shape.radius / distance[outer])[:, None]
        return moved

    mesh = quadratic_solid(points, cells, snap)
    widen = np.sqrt(mass_properties(shape).volume / mesh.measure().sum())
    return replace(mesh, nodes=mesh.nodes * np.array([widen, widen, 1.0]))


@kept(BOUNDS.shapes)
def _slice(name: str, shape: Shape, edge: float, turn: tuple[float, ...], thickness: float) -> QuadraticMesh:
    """Mesh the section, in the plane z = 0, of a shape turned by the matrix with rows `turn`."""
    rotation = np.asarray(turn).reshape(3, 3)
    upright = abs(rotation[2, 2]) > 1.0 - 1e-9
    if isinstance(shape, Sphere) or (isinstance(shape, Cylinder | Capsule) and upright):
        points, cells = disc_triangles(shape.radius, max(1, round(shape.radius / edge)))
        rim = shape.radius
        disc = quadratic_slice(points, cells, thickness, lambda p: p * (rim / np.linalg.norm(p, axis=1))[:, None])
        return with_volume(disc, np.pi * rim**2 * thickness)
    if isinstance(shape, Box) and np.abs(rotation[2]).max() > 1.0 - 1e-9:
        across = int(np.abs(rotation[2]).argmax())
        one, two = (k for k in range(3) if k != across)
        size = 2.0 * np.array([shape.half_extents[one], shape.half_extents[two]])
        points, cells = rectangle_triangles(size, edge)
        basis = rotation[:2, [one, two]].T
        if np.linalg.det(basis) < 0.0:
            cells = cells[:, ::-1].copy()
        return quadratic_slice(points @ basis, cells, thickness)
    solid = _tessellated(name, shape)
    solid.apply_transform(np.block([[rotation, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
    loops = section(solid)
    if not loops:
        raise ValueError(f"soft body {name!r}: the plane through its position misses its shape")
    points, cells = outline_triangles(loops, edge)

    def snap(middles: Array) -> Array:
        return np.column_stack([nearest_on(loops, middles[:, :2]), np.zeros(len(middles))])

    return with_volume(quadratic_slice(points, cells, thickness, snap), area(loops) * thickness)


def _tessellated(name: str, shape: Box | Cylinder | Capsule | ConvexMesh | SurfaceMesh) -> trimesh.Trimesh:
    """The shape as a closed triangle mesh, not shared with anybody."""
    solid: trimesh.Trimesh
    if isinstance(shape, SurfaceMesh):
        solid = _closed(name, shape)
    elif isinstance(shape, ConvexMesh):
        solid = hull(shape).copy()
    elif isinstance(shape, Box):
        solid = trimesh.creation.box(2.0 * np.asarray(shape.half_extents))
    elif isinstance(shape, Cylinder):
        solid = trimesh.creation.cylinder(shape.radius, 2.0 * shape.half_height, sections=SECTIONS)
    else:
        ball = trimesh.creation.icosphere(subdivisions=4, radius=shape.radius)
        lift = np.array([0.0, 0.0, shape.half_height])
        solid = trimesh.convex.convex_hull(np.concatenate([ball.vertices - lift, ball.vertices + lift]))
    return solid


def _closed(name: str, shape: SurfaceMesh) -> trimesh.Trimesh:
    """The mesh of a closed surface, faces outward; raises ValueError where it has holes."""
    mesh = trimesh.Trimesh(np.asarray(shape.vertices, dtype=float), np.asarray(shape.faces))
    if not mesh.is_watertight:
        raise ValueError(f"soft body {name!r}: its surface mesh is not closed, so that nothing is inside it")
    if not mesh.is_winding_consistent:
        raise ValueError(f"soft body {name!r}: faces of its surface mesh are not all counter-clockwise from outside")
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh
