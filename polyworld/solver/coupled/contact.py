"""Contacts of ropes, cloth and soft bodies with rigid bodies, with statics and with each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.coupled import contact_layout as layout
from polyworld.solver.coupled.assembly import write_in_place
from polyworld.solver.coupled.contact_bodies import CarriedBodies, carried_arrays
from polyworld.solver.coupled.contact_bounds import bound_objects, near_parts
from polyworld.solver.coupled.contact_events import DeformableContactLog
from polyworld.solver.coupled.contact_obstacles import build_obstacles, build_surface, excluded_bodies, no_obstacles
from polyworld.solver.coupled.contact_search import (
    BLOCK,
    keep_acting,
    recall_acting,
    search_corners,
    search_edges,
    search_nodes,
)
from polyworld.solver.coupled.contact_solve import push_on, solve_contacts
from polyworld.solver.coupled.mechanism import build_mechanisms
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes, parameter_row
from polyworld.solver.coupled.surface import SurfacePairs
from polyworld.solver.spatial.stepper import RigidStepper
from polyworld.trajectory import Event
from polyworld.world import World

MOST_ROOM = 16  # times the room at first, which is some 30 contacts a node: more is crushed, not in contact


def room_at_first(surface: layout.Surface, pairs: SurfacePairs) -> int:
    """Return how many contacts a world has room for before any search asked for more."""
    return 64 + 2 * int(buffers.read(surface.exposed).sum()) + surface.edges.shape[0] + pairs.room()


class Contacts:
    """All contacts of nodes in W worlds: searched once in a coupling step, solved in every inner step."""

    def __init__(
        self,
        world: World,
        meshes: dict[str, DeformableMesh],
        first: dict[str, int],
        nodes: Nodes,
        carried: CarriedBodies | None,
        rigid: RigidStepper | None,
        *,
        record_events: bool = False,
    ) -> None:
        """first: the row of each object's first node. carried, rigid: the world's bodies, None where it has none."""
        self.world = world
        self.n_worlds = nodes.x.shape[0]
        w, n = nodes.x.shape
        self.surface = build_surface(world, meshes, first, n)
        if carried is None or rigid is None:
            self.obstacles = no_obstacles(w)
            self._carried = carried_arrays((w, 1))
            self._carried.mechanisms = build_mechanisms(world, 1, w)
            excluded = buffers.zeros((n, 1), wp.int32)
        else:
            self.obstacles = build_obstacles(rigid.geometry, carried.bodies)
            self._carried = carried.carried
            rigid.reset()
            excluded = excluded_bodies(world, meshes, first, nodes, self.surface, self.obstacles)
        self.surface.excluded = excluded
        parts = self.obstacles.parts.shape[0]
        d = len(world.deformables)
        self.bounds = layout.Bounds()
        self.bounds.low, self.bounds.high = buffers.zeros((w, d), wp.vec3d), buffers.zeros((w, d), wp.vec3d)
        self.bounds.speed = buffers.zeros((w, d), wp.float64)
        self.bounds.near = buffers.zeros((w, d, parts), wp.int32)
        bodies = [o.name for o in (*world.objects, *world.statics)]
        self._pairs = SurfacePairs(world, meshes, first, nodes, self.surface, len(bodies))
        room = room_at_first(self.surface, self._pairs)
        self._most = MOST_ROOM * room
        self.found = layout.Found()
        self._allocate(room)
        self.found.kept_count = buffers.zeros((w,), wp.int32)
        self.found.latest = buffers.full((w, n), -1, wp.int32)
        self.found.count = buffers.zeros((w,), wp.int32)
        self.found.overflowed = buffers.zeros((w,), wp.int32)
        self.found.falling = buffers.full((w, n), 1.0, wp.float64)
        self.found.reaction = buffers.zeros((w, n), wp.vec3d)
        names = [d.name for d in world.deformables]
        self.tally = _tally(w, d, len(bodies), record_events)
        self._log = DeformableContactLog(w, self.tally, names, [*bodies, *names])

    def _allocate(self, room: int) -> None:
        """Make room for so many contacts; left unwritten, so that what is not needed takes no memory."""
        w, found = self.n_worlds, self.found
        found.contacts = buffers.empty((w, room), layout.Contact)
        found.acting = buffers.empty((w, room), wp.int32)
        found.kept = buffers.empty((w, room), layout.Kept)
        found.kept_node = buffers.empty((w, room), wp.int32)

    def enlarge(self) -> bool:
        """Double the room for what was full in the last search; return False where that would be too much.

        What acted before the search is kept; the search is to be done again.
        """
        found, counts = self.found, buffers.read(self.found.kept_count)
        contacts_full = bool((buffers.read(found.count) >= self.room).any())
        if (contacts_full and self.room >= self._most) or not self._pairs.enlarge(MOST_ROOM):
            return False
        if contacts_full:
            kept, node = buffers.read(found.kept), buffers.read(found.kept_node)
            self._allocate(2 * self.room)
            for w, count in enumerate(counts):
                buffers.write(found.kept, kept[w, :count], np.s_[w, :count])
                buffers.write(found.kept_node, node[w, :count], np.s_[w, :count])
        return True

    def write(self, fields: Fields) -> bool:
        """Write the coefficients of contacts in place; return True where arrays were reallocated."""
        names = tuple(d.name for d in self.world.deformables)
        recapture = write_in_place(self.surface, "friction", parameter_row(fields, names, "friction"))
        recapture |= write_in_place(self.surface, "restitution", parameter_row(fields, names, "restitution"))
        return recapture

    def reset(self) -> None:
        """Forget all contacts."""
        buffers.write(self.found.count, 0)
        buffers.write(self.found.overflowed, 0)
        buffers.write(self.found.reaction, 0.0)
        buffers.write(self.found.kept_count, 0)
        buffers.write(self.found.latest, -1)
        self._pairs.reset()
        self._log.reset()

    @property
    def reaction(self) -> Any:
        """Impulses (W, N) of contacts on nodes that are held, for their attachments to read and clear."""
        return self.found.reaction

    def launch_tally(self) -> None:
        """Launch the record of a coupling step's contacts."""
        self._log.launch()

    def events(self, w: int, end: float) -> tuple[Event, ...]:
        """Contacts of world w up to the time `end` [s], in order of time; none where they are not recorded."""
        return self._log.events(w, end, self.world.time.substep)

    def overflowed(self) -> NDArray[np.bool_]:
        """Worlds (W,) that had more contacts than there is room for."""
        return buffers.read(self.found.overflowed) > 0

    @property
    def room(self) -> int:
        """Contacts that a world has room for."""
        return int(self.found.contacts.shape[1])

    def complete_until(self, w: int) -> float | None:
        """Return the time [s] up to which the contacts of world w are recorded; None where all are."""
        return self._log.complete_until(w)

    def reserve(self) -> None:
        """Make room in the log for all contacts that one coupling step may begin, as far as there may be."""
        self._log.reserve()

    def launch_search(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the search for all that may touch within the coupling step."""
        w, d, _parts = self.bounds.near.shape
        buffers.launch(bound_objects, (w, d), [nodes, self.surface, self.bounds])
        buffers.launch(keep_acting, self.n_worlds, [clock, self.found])
        self._launch_search(nodes, clock)

    def search_again(self, nodes: Nodes, clock: Clock) -> None:
        """Do a coupling step's search again, after `enlarge`."""
        buffers.clear(self.found.count)
        buffers.clear(self.found.overflowed)
        self._launch_search(nodes, clock)

    def _launch_search(self, nodes: Nodes, clock: Clock) -> None:
        w, d, parts = self.bounds.near.shape
        self._pairs.launch(nodes, clock, self.bounds, self.found)
        if parts > 0:
            near = [self.obstacles, self.surface, self.bounds]
            buffers.launch(near_parts, (w, d, parts), [clock, *near])
            search = [clock, nodes, *near, self.found]
            buffers.launch(search_nodes, (w, _blocks(nodes.x.shape[1])), search)
            buffers.launch(search_edges, (w, _blocks(self.surface.edges.shape[0])), search)
            buffers.launch(search_corners, (w, _blocks(self.surface.triangles.shape[0])), search)
        buffers.launch(recall_acting, self.n_worlds, [clock, self.found])

    def launch_push(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the impulses of the inner step before, which the next solution starts from."""
        buffers.launch(push_on, self.n_worlds, [clock, nodes, self.obstacles.bodies, self._carried, self.found])

    def launch_solve(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the impulses of one inner step."""
        inputs = [clock, nodes, self.obstacles, self._carried, self.surface.across, self.found, self.tally]
        buffers.launch(solve_contacts, self.n_worlds, inputs)


def _blocks(count: int) -> int:
    return -(-count // BLOCK)


def _tally(w: int, d: int, bodies: int, record: bool) -> layout.Tally:
    tally = layout.Tally()
    shape = (w, d, bodies + d) if record else (1, 1, 1)
    for name in ("impulse", "first_impulse", "speed", "begin", "last"):
        setattr(tally, name, buffers.zeros(shape, wp.float64))
    tally.position = buffers.zeros(shape, wp.vec3d)
    tally.record = int(record)
    return tally
