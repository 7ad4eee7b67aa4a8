"""The arrays a spatial run works in: state and parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.effect_contacts import contact_laws
from polyworld.solver.core.effect_forces import forces_among
from polyworld.solver.core.episodes import Log
from polyworld.solver.core.references import by_reference
from polyworld.solver.spatial import layout
from polyworld.solver.spatial.acceleration import SWEEPS
from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.joint_scene import build_joints, joint_rows
from polyworld.solver.spatial.statics import static_poses
from polyworld.solver.spatial.system import System
from polyworld.world import World, geometry

MESH_TRIANGLES = 24  # triangles of a mesh that one body has room to touch at once, at first
MOST_BYTES = 1_000_000_000  # of contacts and their rows
LISTED = 256  # neighbours of a body that there is room for, on average, at first

PARAMETER_TYPES = {
    "mass": wp.float64,
    "friction": wp.float64,
    "restitution": wp.float64,
    "rolling_resistance": wp.float64,
    "torsional_radius": wp.float64,
    "linear_damping": wp.float64,
    "angular_damping": wp.float64,
    "position": wp.vec3d,
    "orientation": wp.quatd,
    "velocity": wp.vec3d,
    "angular_velocity": wp.vec3d,
    "static_position": wp.vec3d,
    "static_orientation": wp.quatd,
    "static_plane": wp.vec4d,
    "static_friction": wp.float64,
    "static_restitution": wp.float64,
    "gravity": wp.vec3d,
    "time_scale": wp.float64,
    "time_origin": wp.float64,
    "effect_parameters": wp.float64,
    "effect_kind": wp.int32,
    "effect_acts": wp.int32,
    "effect_programs": wp.float64,
}
EFFECT = "effect_"  # begins the names of what stands in the record's `effects`
SHARED = frozenset({"effect_kind", "effect_acts", "effect_programs"})  # the same in all worlds


def zeros(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return an array of zeros."""
    return buffers.zeros(shape, dtype)


def allocate_state(world: World, rows: int) -> layout.State:
    """Room to work in for `rows` worlds at a time."""
    n, s = len(world.objects), len(world.statics)
    meshes = sum(static.shape.kind == "triangle_mesh" for static in world.statics)
    pieces = sum(len(geometry.pieces(o.shape)) for o in world.objects)
    with_statics = pieces * (s - meshes + meshes * MESH_TRIANGLES)
    state = layout.State()
    state.bodies = zeros((rows, n + s + 1), layout.Body)
    # Round bodies of similar size touch six others on average; twice that leaves room for overlaps.
    _allocate_contacts(state, max(1, min(pieces * (pieces - 1) // 2, 12 * pieces) + with_statics), rows, world)
    _allocate_neighbours(state, min(n, LISTED) * n + n * s, rows)
    state.first_neighbour = zeros((rows, n + 1), wp.int32)
    state.listed_x = zeros((rows, n), wp.vec3d)
    state.skin = zeros((rows,), wp.float64)
    state.mix_v = zeros((rows, SWEEPS * n), wp.vec3d)
    state.mix_w = zeros((rows, SWEEPS * n), wp.vec3d)
    state.mixed = zeros((rows,), wp.int32)
    state.resisting = zeros((rows,), wp.int32)
    state.scratch = zeros((rows, 2 * layout.MAX_MANIFOLD_POINTS + 3 * layout.MAX_CLIPPED_POINTS), wp.vec3d)
    state.manifold_count = zeros((rows, 2), wp.int32)
    state.contact_count = zeros((rows, 2), wp.int32)
    state.half = zeros((rows,), wp.int32)
    state.slowest = zeros((rows,), wp.float64)
    state.early = zeros((rows,), wp.float64)
    state.overflowed = zeros((rows,), wp.int32)
    state.planes = zeros((rows, s), wp.vec4d)
    state.reaction = zeros((rows, n), wp.vec3d)
    state.reaction_turning = zeros((rows, n), wp.vec3d)
    state.objects, state.statics = n, s
    return state


def _allocate_contacts(state: layout.State, manifolds: int, rows: int, world: World) -> None:
    contacts = layout.MAX_MANIFOLD_POINTS * (manifolds + 1)
    state.manifolds = zeros((rows, 2 * manifolds), layout.Manifold)
    state.contacts = zeros((rows, 2 * contacts), layout.Contact)
    state.rows = zeros((rows, 2 * ROWS * contacts + joint_rows(world)), layout.Row)
    state.mix_start = zeros((rows, 2 * contacts), wp.vec3d)
    state.mix_end = zeros((rows, 2 * SWEEPS * contacts), wp.vec3d)
    state.mix_change = zeros((rows, 2 * SWEEPS * contacts), wp.vec3d)
    state.max_manifolds, state.max_contacts = manifolds, contacts
    state.turning_rows = ROWS * contacts


def _allocate_neighbours(state: layout.State, count: int, rows: int) -> None:
    state.neighbours = zeros((rows, count), wp.int32)
    state.max_neighbours = count


def enlarge(system: System, state: layout.State, joints: Joints, world: World) -> bool:
    """Give worlds room for four times the manifolds, in place; return False where that takes too much memory.

    All contacts are forgotten: runs begin again.
    """
    kept = (state.manifolds, state.contacts, state.rows, state.mix_start, state.mix_end, state.mix_change)
    if 4 * sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in kept) > MOST_BYTES:
        return False
    _allocate_contacts(state, 4 * state.max_manifolds, state.manifolds.shape[0], world)
    _allocate_neighbours(state, 4 * state.max_neighbours, state.manifolds.shape[0])
    joints.base = state.rows.shape[1] - joint_rows(world)
    system.state = by_reference(state, layout.State, system.state)
    system.joints = by_reference(joints, Joints, system.joints)
    return True


def system_of(geometry: layout.Geometry, state: layout.State, log: Log) -> System:
    """Return the records of a step by reference, without parameters and joints, which each run writes."""
    system = System()
    system.geometry = by_reference(geometry, layout.Geometry)
    system.state = by_reference(state, layout.State)
    system.log = by_reference(log, Log)
    return system


def allocate_joints(world: World, state: layout.State) -> Joints:
    """Return the world's joints, whose rows follow those of the contacts."""
    rows, length = state.rows.shape
    return build_joints(world, length - joint_rows(world), rows)


class ParameterBuffers:
    """The parameters of a world as kernels take them. reference: an array of one record. capacity: of worlds."""

    def __init__(self, world: World, capacity: int) -> None:
        self.reference: Any = None
        self._capacity = capacity
        self._world = world
        self._record = layout.Parameters()
        self._content: dict[str, buffers.Mirror] = {}  # of the record's arrays

    def write(self, arrays: RigidArrays) -> None:
        """Copy parameters into the kernel's arrays, made again only where a field comes to differ per world."""
        names = ("static_position", "static_orientation", "static_plane")
        poses = dict(zip(names, static_poses(self._world, arrays), strict=True))
        for name, dtype in PARAMETER_TYPES.items():
            values = poses[name] if name in poses else getattr(arrays, name)
            if name == "orientation":
                values = np.roll(values, -1, axis=-1)
            if name in ("time_scale", "time_origin"):
                values = values[:, 0]
            kept = self._content.get(name)
            if name in SHARED or len(values) == 1:
                if kept is None:
                    kept = self._made(name, values, dtype)
                kept.values[...] = values
                kept.push()
                continue
            if kept is None or len(kept.values) < len(values):
                kept = self._made(name, np.repeat(values[:1], self._capacity, axis=0), dtype)
            kept.values[: len(values)] = values
            kept.push()
        self._record.contact_laws = contact_laws(arrays.effect_kind)
        self._record.forces = forces_among(arrays.effect_kind)
        self.reference = by_reference(self._record, layout.Parameters, self.reference)

    def _made(self, name: str, values: Any, dtype: Any) -> buffers.Mirror:
        made: Any = buffers.array(values, dtype)
        if name.startswith(EFFECT):
            setattr(self._record.effects, name.removeprefix(EFFECT), made)
        else:
            setattr(self._record, name, made)
        self._content[name] = buffers.Mirror(made)
        return self._content[name]
