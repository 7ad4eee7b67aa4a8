"""Contacts of deformable objects with each other and with themselves: what may touch, and the search for it."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.coupled.contact_layout import Bounds, Found, Surface
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.coupled.pair_contacts import take_pairs
from polyworld.solver.coupled.surface_grid import make_grid
from polyworld.solver.coupled.surface_pairs import Pairs, list_crossings, list_faces, list_sides, sort_surfaces
from polyworld.world import World
from polyworld.world.materials import material_of

Ints = NDArray[np.int32]

SKIN = 0.4  # least margin of a list, per median edge length
ROOM = 40  # listed pairs a node may be part of, on average


def touching_objects(world: World) -> Ints:
    """Find which deformable objects may touch each other (D, D): all but fluids; themselves only ropes, and cloth where
    it says so. A soft body's own parts pass through each other.
    """
    forms = [material_of(d).form for d in world.deformables]
    solid = np.array([form != "liquid" for form in forms], dtype=bool)
    may = np.outer(solid, solid)
    for k, item in enumerate(world.deformables):
        may[k, k] = getattr(item, "self_contact", forms[k] == "line")
    return may.astype(np.int32)


class SurfacePairs:
    """The search for contacts among deformable objects of W worlds; adds them to the list of all contacts."""

    def __init__(
        self,
        world: World,
        meshes: dict[str, DeformableMesh],
        first: dict[str, int],
        nodes: Nodes,
        surface: Surface,
        bodies: int,
    ) -> None:
        """first: the row of each object's first node. bodies: number of rigid objects and statics, which come first in
        the participants of a contact.
        """
        self._surface = surface
        self._bodies = bodies
        self._w = nodes.x.shape[0]
        self._rooms: dict[str, int] = {}  # that lists had at first, of those that were enlarged
        may = touching_objects(world)
        edges, owner = buffers.read(surface.edges), buffers.read(nodes.owner)
        self.any = bool(may.any()) and len(edges) > 0
        if not self.any:
            return
        rest = np.concatenate([meshes[name].nodes for name in first])
        lengths = np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
        owners = owner[edges[:, 0]]
        rope = np.array([material_of(d).form == "line" for d in world.deformables])
        on_rope = rope[owners] & may.any(axis=1)[owners]
        solid = buffers.read(surface.one_sided) > 0
        cross = may * ~np.outer(solid, solid)  # an edge in a solid does not know which way is out
        exposed = np.flatnonzero(buffers.read(surface.exposed) * may.any(axis=1)[owner]).astype(np.int32)
        kept = np.flatnonzero(cross.any(axis=1)[owners]).astype(np.int32)
        has_faces = surface.triangles.shape[0] > 0
        pairs = Pairs()
        pairs.node, pairs.edge = buffers.ints(exposed), buffers.ints(kept)
        pairs.may = buffers.array(may, wp.int32)
        pairs.cross = buffers.array(cross.astype(np.int32), wp.int32)
        pairs.bonded = buffers.array(_bonded(world), wp.int32)
        pairs.rest = buffers.array(rest, wp.vec3d)
        room = ROOM * len(exposed) + 64
        # Left unwritten, so that room which is not needed takes no memory.
        pairs.faces = buffers.empty((self._w, room if has_faces else 1), wp.vec2i)
        pairs.crossings = buffers.empty((self._w, ROOM * len(kept) + 64), wp.vec2i)
        has_sides = surface.sides.shape[0] > 0
        pairs.sides = buffers.empty((self._w, room if has_sides else 1), wp.vec2i)
        pairs.side_count = buffers.zeros((self._w,), wp.int32)
        pairs.face_count, pairs.crossing_count = (
            buffers.zeros((self._w,), wp.int32),
            buffers.zeros((self._w,), wp.int32),
        )
        pairs.listed_x = buffers.zeros(nodes.x.shape, wp.vec3d)
        pairs.margin = buffers.zeros((self._w,), wp.float64)
        pairs.fastest = buffers.zeros((self._w,), wp.float64)
        pairs.due = buffers.zeros((self._w,), wp.int32)
        pairs.chain = buffers.ints(np.where(on_rope, owners, -1))
        number = np.arange(len(edges))
        starts = np.array([number[owners == d].min(initial=len(edges)) for d in range(len(rope))])
        pairs.place_in_chain = buffers.ints(number - starts[owners])
        threaded = {p.rope for p in world.pulleys}
        pairs.over_wheels = buffers.ints([int(d.name in threaded) for d in world.deformables])
        pairs.segment = buffers.array(lengths, wp.float64)
        pairs.longest = float(lengths[kept].max(initial=0.0))
        pairs.skin = SKIN * float(np.median(lengths))
        self._pairs = pairs
        pairs.thickest = float(buffers.read(surface.radius)[exposed].max())
        cell = 2.0 * float(np.median(lengths)) + 2.0 * pairs.thickest
        self._grid = make_grid(self._w, len(exposed), cell)
        self._edge_grid = make_grid(self._w, len(kept), max(cell, pairs.longest))

    def room(self) -> int:
        """Contacts to keep room for."""
        return 10 * self._pairs.node.shape[0] + 6 * self._pairs.edge.shape[0] if self.any else 0

    def enlarge(self, most: int) -> bool:
        """Double the room of the lists that are full, up to `most` times what it was; return False beyond that.

        Worlds whose list was full are due again: nothing moved since it was made, so it will be the same, and whole.
        """
        if not self.any:
            return True
        pairs = self._pairs
        for name, count in (("faces", "face_count"), ("crossings", "crossing_count"), ("sides", "side_count")):
            listed, room = buffers.read(getattr(pairs, count)), getattr(pairs, name).shape[1]
            if not (listed >= room).any():
                continue
            if room >= most * self._rooms.setdefault(name, room):
                return False
            buffers.write(pairs.margin, 0.0, listed >= room)
            setattr(pairs, name, buffers.empty((self._w, 2 * room), wp.vec2i))
        return True

    def reset(self) -> None:
        """Mark the lists as due."""
        if self.any:
            buffers.write(self._pairs.margin, 0.0)
            buffers.write(self._pairs.face_count, 0)
            buffers.write(self._pairs.crossing_count, 0)
            buffers.write(self._pairs.side_count, 0)

    def launch(self, nodes: Nodes, clock: Clock, bounds: Bounds, found: Found) -> None:
        """Launch the search; adds to `found` what may touch within the coupling step."""
        if not self.any:
            return
        surface, pairs = self._surface, self._pairs
        grids = [self._grid, self._edge_grid]
        buffers.launch(sort_surfaces, self._w, [clock, nodes, surface, pairs, *grids])
        if surface.triangles.shape[0]:
            dim = (self._w, surface.triangles.shape[0])
            buffers.launch(list_faces, dim, [nodes, surface, bounds, pairs, self._grid, found])
        if surface.sides.shape[0]:
            buffers.launch(list_sides, (self._w, surface.sides.shape[0]), [nodes, surface, pairs, self._grid, found])
        if pairs.edge.shape[0]:
            dim = (self._w, surface.edges.shape[0])
            buffers.launch(list_crossings, dim, [nodes, surface, bounds, pairs, self._edge_grid, found])
        buffers.launch(take_pairs, self._w, [clock, nodes, surface, pairs, self._bodies, found])


def _bonded(world: World) -> Ints:
    """Find which deformable objects are fastened to each other (D, D)."""
    index = {d.name: k for k, d in enumerate(world.deformables)}
    bonded = np.zeros((len(index), len(index)), dtype=np.int32)
    for attachment in world.attachments:
        if attachment.to in index:
            a, b = index[attachment.object], index[attachment.to]
            bonded[a, b] = bonded[b, a] = 1
    return bonded
