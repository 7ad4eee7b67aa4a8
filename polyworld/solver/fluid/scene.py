"""A world's grid and solids as the arrays the kernels read."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.fluid import layout
from polyworld.solver.fluid.distance import OPEN_MESH
from polyworld.solver.spatial import layout as rigid
from polyworld.world import World, geometry
from polyworld.world.materials import PLANAR
from polyworld.world.shapes import Box, Capsule, Compound, Cylinder, Plane, Sphere, TriangleMesh, Wall

Array = NDArray[np.float64]

ENDLESS = 1e6  # half extent across the plane of what reaches through it [m]
AXES = "xyz"


def thin_axis(world: World) -> int:
    """World axis across the plane of fluid_planar, -1 in space; ValueError where the plane is not along the axes."""
    if not any(d.representation.endswith(PLANAR) for d in world.of_form("liquid")):
        return -1
    normal = np.asarray(world.environment.motion_plane.normal, dtype=float)
    normal = np.abs(normal / np.linalg.norm(normal))
    axis = int(np.argmax(normal))
    if normal[axis] < 1.0 - 1e-9:
        raise ValueError(
            f"fluid_planar flows in planes along the axes: motion_plane.normal must be along x, y or z, not "
            f"{world.environment.motion_plane.normal}; turn the world, or use the representation fluid"
        )
    return axis


def build_grid(world: World) -> layout.Grid:
    """Return the cells of a world's fluid_grid, `layout.PAD` more on every side."""
    box = world.fluid_grid
    if box is None:
        raise ValueError("the world has no fluid_grid")
    thin, h = thin_axis(world), box.cell
    lower, upper = np.asarray(box.lower, dtype=float), np.asarray(box.upper, dtype=float)
    cells = np.maximum(np.ceil((upper - lower) / h - 1e-6).astype(int), 1)
    pad = np.full(3, layout.PAD)
    origin = lower - layout.PAD * h
    if thin >= 0:
        cells[thin], pad[thin] = 1, 0
        origin[thin] = world.environment.motion_plane.point[thin] - h / 2
        lower[thin], upper[thin] = -ENDLESS, ENDLESS
    count = cells + 2 * pad
    stride = np.array([count[1] * count[2], count[2], 1])
    wide = np.ones(3, dtype=int)
    if thin >= 0:
        stride[thin], wide[thin] = 0, 0
    grid = layout.Grid()
    grid.origin, grid.cell = wp.vec3d(*origin), h
    grid.box_lower, grid.box_upper = wp.vec3d(*lower), wp.vec3d(*upper)
    grid.volume = h**3 if thin < 0 else h**2
    grid.area = h**2 if thin < 0 else h
    grid.count, grid.stride = wp.vec3i(*count.tolist()), wp.vec3i(*stride.tolist())
    grid.lower, grid.upper = wp.vec3i(*pad.tolist()), wp.vec3i(*(pad + cells).tolist())
    grid.wide, grid.thin, grid.closed, grid.cells = wp.vec3i(*wide.tolist()), thin, int(box.closed), int(count.prod())
    return grid


class _Table:
    """Rows of solids that grow as shapes are added."""

    def __init__(self, world: World) -> None:
        self.thin = thin_axis(world)
        self.axes = geometry.plane_axes(world.environment.motion_plane)
        self.plane = np.asarray(world.environment.motion_plane.point, dtype=float)
        self.rows: list[dict[str, Any]] = []
        self.normals: list[Array] = []
        self.offsets: list[float] = []
        self.meshes: list[Any] = []

    def add(self, shape: Any, body: int, position: Array, rotation: Array, pose: Array) -> None:
        """Add one shape at a position in its body's axes; pose (3, 3): rotation of the body at the start."""
        row: dict[str, Any]
        if isinstance(shape, Sphere):
            row = {"kind": rigid.SPHERE, "size": (shape.radius, 0, 0), "bound": shape.radius}
        elif isinstance(shape, Box):
            half = np.asarray(shape.half_extents, dtype=float)
            row = {"kind": rigid.BOX, "size": half, "bound": float(np.linalg.norm(half))}
        elif isinstance(shape, Cylinder | Capsule):
            r, z = shape.radius, shape.half_height
            kind, bound = (rigid.CYLINDER, np.hypot(r, z)) if isinstance(shape, Cylinder) else (rigid.CAPSULE, r + z)
            row = {"kind": kind, "size": (r, r, z), "bound": float(bound)}
        else:
            hull = geometry.hull(shape)
            normals = np.asarray(hull.face_normals, dtype=float)
            offsets = np.einsum("fi,fi->f", normals, np.asarray(hull.triangles)[:, 0])
            row = self._half_spaces(normals, offsets, float(np.linalg.norm(hull.vertices, axis=1).max()))
        if self.thin >= 0:
            row = self._through_plane(shape, row, pose @ rotation)
        self._append(row, body, position, rotation)

    def add_plane(self, normal: Array, offset: float) -> None:
        row = {"kind": rigid.PLANE, "size": normal, "offset": offset, "bound": ENDLESS}
        self._append(row, -1, np.zeros(3), np.eye(3))

    def add_mesh(self, shape: TriangleMesh, position: Array, rotation: Array) -> None:
        import trimesh  # slow to import, and few fluids need it

        points = np.asarray(shape.vertices, dtype=np.float32)
        mesh = wp.Mesh(
            points=buffers.array(points, wp.vec3),
            indices=buffers.array(np.asarray(shape.faces, dtype=np.int32).reshape(-1), wp.int32),
            support_winding_number=True,
        )
        solid = trimesh.Trimesh(shape.vertices, shape.faces)  # merges equal vertices
        faces = 0 if solid.is_watertight else OPEN_MESH
        bound = float(np.linalg.norm(points, axis=1).max())
        self._append({"kind": rigid.MESH, "bound": bound, "faces": faces}, -1, position, rotation, mesh)

    def _append(self, row: dict[str, Any], body: int, position: Array, rotation: Array, mesh: Any = None) -> None:
        self.rows.append({**row, "body": body, "position": position, "rotation": rotation})
        self.meshes.append(mesh)

    def _half_spaces(self, normals: Array, offsets: Array, bound: float) -> dict[str, Any]:
        row = {"kind": rigid.CONVEX, "first_face": len(self.normals), "faces": len(normals), "bound": bound}
        self.normals.extend(normals)
        self.offsets.extend(float(o) for o in offsets)
        return row

    def _through_plane(self, shape: Any, row: dict[str, Any], rotation: Array) -> dict[str, Any]:
        """Return the shape's outline in the plane, extended across it without end."""
        across = np.abs(rotation.T @ self.axes[2])
        if isinstance(shape, Sphere) or (isinstance(shape, Capsule) and across[2] < 1e-6):
            return row
        if isinstance(shape, Box) and across.max() > 1.0 - 1e-9:
            size = np.array(row["size"])
            size[int(np.argmax(across))] = ENDLESS
            return {**row, "size": size}
        if isinstance(shape, Cylinder | Capsule) and across[2] > 1.0 - 1e-9:
            size = (shape.radius, shape.radius, ENDLESS)
            return {"kind": rigid.CYLINDER, "size": size, "bound": shape.radius}
        outline, radius = geometry.planar_outline(shape, rotation, self.axes)
        edges = np.roll(outline, -1, axis=0) - outline
        sides = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
        normals = sides @ self.axes[:2] @ rotation
        offsets = np.einsum("ij,ij->i", sides, outline) + radius
        return self._half_spaces(normals, offsets, float(np.linalg.norm(outline, axis=1).max()) + radius)


def build_solids(world: World) -> tuple[layout.Solids, list[Any]]:
    """Solids of a world, and the meshes that must live as long as they are used."""
    table = _Table(world)
    for body, item in enumerate(world.objects):
        pose = geometry.quaternion_matrix(np.asarray(item.orientation, dtype=float))
        for piece in geometry.pieces(item.shape):
            table.add(piece.shape, body, piece.position, piece.rotation, pose)
    moving = len(table.rows)
    for static in world.statics:
        position = np.asarray(static.position, dtype=float)
        orientation = geometry.quaternion_matrix(np.asarray(static.orientation, dtype=float))
        shape = static.shape
        if isinstance(shape, Plane):
            normal = orientation @ (np.asarray(shape.normal, dtype=float) / np.linalg.norm(shape.normal))
            if table.thin < 0 or abs(normal[table.thin]) < 1.0 - 1e-9:
                table.add_plane(normal, shape.offset + float(normal @ position))
            continue
        if isinstance(shape, TriangleMesh):
            table.add_mesh(shape, position, orientation)
            continue
        if isinstance(shape, Wall):
            shape, centre, rotation = geometry.wall_box(shape)
            position, orientation = orientation @ centre + position, orientation @ rotation
        if table.thin >= 0:
            position = position.copy()
            position[table.thin] = table.plane[table.thin]
        table.add(shape, -1, position, np.eye(3), orientation)
        table.rows[-1]["rotation"] = orientation
    _add_cut_sides(world, table)
    return _solids(world, table, moving), table.meshes


def _add_cut_sides(world: World, table: _Table) -> None:
    """Walls of a closed grid whose extent is no multiple of the cell: its last cells are cut by a half space."""
    box = world.fluid_grid
    if box is None or not box.closed:
        return
    for axis in range(3):
        cells = (box.upper[axis] - box.lower[axis]) / box.cell
        if axis != table.thin and abs(cells - round(cells)) > 1e-6:
            normal = np.zeros(3)
            normal[axis] = -1.0
            table.add_plane(normal, -box.upper[axis])


def _solids(world: World, table: _Table, moving: int) -> layout.Solids:
    rows = np.zeros(max(len(table.rows), 1), dtype=layout.Solid.numpy_dtype())
    for i, row in enumerate(table.rows):
        for name, value in row.items():
            rows[name][i] = value
    solids = layout.Solids()
    solids.solids = buffers.array(rows[: len(table.rows)], layout.Solid)
    solids.normals = _array(table.normals, wp.vec3d)
    solids.offsets = _array(table.offsets, wp.float64)
    solids.meshes = _array([0 if m is None else m.id for m in table.meshes], wp.uint64)
    solids.share = _array(body_shares(world), wp.float64)
    solids.bodies, solids.moving = len(world.objects), moving
    return solids


def body_shares(world: World) -> list[float]:
    """Metres of a slice that each rigid object reaches across the plane: its volume over its outline's area."""
    if thin_axis(world) < 0:
        return [1.0 for _ in world.objects]
    axes = geometry.plane_axes(world.environment.motion_plane)
    shares = []
    for item in world.objects:
        if isinstance(item.shape, Compound):
            raise ValueError(f"object {item.name!r}: compound shapes move in space only, use the representation fluid")
        pose = geometry.quaternion_matrix(np.asarray(item.orientation, dtype=float))
        outline, radius = geometry.planar_outline(item.shape, pose, axes)
        x, y = outline.T
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) + np.pi * radius**2
        edges = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
        area += radius * float(edges.sum())
        shares.append(geometry.mass_properties(item.shape).volume / area)
    return shares


def _array(rows: Any, dtype: Any) -> Any:
    if len(rows) == 0:
        return buffers.zeros(1, dtype)
    return buffers.array(np.asarray(rows), dtype)
