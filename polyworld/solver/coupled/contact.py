"""Contacts of ropes, cloth and soft bodies with rigid bodies, with statics and with each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.core.references import by_reference
from polyworld.solver.coupled import contact_layout as layout
from polyworld.solver.coupled.contact_bodies import CarriedBodies
from polyworld.solver.coupled.contact_events import DeformableContactLog
from polyworld.solver.coupled.contact_obstacles import build_obstacles, build_surface, excluded_bodies
from polyworld.solver.coupled.contact_search import (
    BLOCK,
    bound_objects,
    keep_acting,
    near_parts,
    recall_acting,
    search_corners,
    search_edges,
    search_nodes,
)
from polyworld.solver.coupled.contact_solve import push_on, solve_contacts
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.coupled.surface import SurfacePairs
from polyworld.solver.spatial.layout import Body, Geometry
from polyworld.solver.spatial.stepper import RigidStepper
from polyworld.trajectory import Event
from polyworld.world import World


class Contacts:
    """All contacts of nodes in W worlds: searched once in a coupling step, solved in every inner step."""

    def __init__(
        self,
        world: World,
        meshes: dict[str, DeformableMesh],
        nodes: Nodes,
        carried: CarriedBodies | None,
        rigid: RigidStepper | None,
        *,
        record_events: bool = False,
    ) -> None:
        """carried, rigid: the world's bodies, None where it has none."""
        self.world = world
        self.n_worlds = nodes.x.shape[0]
        w, n = nodes.x.shape
        if carried is None or rigid is None:
            self._solid = Geometry()
            self._bodies: Any = buffers.zeros((w, 1), Body)
            self._acceleration: Any = buffers.zeros((w, 1), wp.vec3d)
            self._before: Any = self._acceleration
            self._flying: Any = buffers.zeros((w, 1), wp.int32)
            self._inverse_inertia: Any = buffers.zeros((w, 1), wp.mat33d)
            self.obstacles = layout.Obstacles()
            self.obstacles.parts = buffers.zeros((0,), layout.Part)
            excluded = np.zeros((n, 1), dtype=np.int32)
        else:
            self._bodies = carried.bodies
            self._acceleration = carried.carried.acceleration
            self._before = carried.carried.before
            self._flying = carried.carried.flying
            self._inverse_inertia = carried.carried.inverse_inertia
            self._solid = rigid.geometry
            self.obstacles = build_obstacles(rigid.geometry)
            rigid.reset()
            excluded = excluded_bodies(world, meshes, nodes, self._solid, self.obstacles, self._bodies)
        self._geometry = by_reference(self._solid, Geometry)
        self.surface = build_surface(world, meshes, nodes.first, excluded)
        parts = self.obstacles.parts.shape[0]
        d = len(world.deformables)
        self.bounds = layout.Bounds()
        self.bounds.low, self.bounds.high = buffers.zeros((w, d), wp.vec3d), buffers.zeros((w, d), wp.vec3d)
        self.bounds.speed = buffers.zeros((w, d), wp.float64)
        self.bounds.near = buffers.zeros((w, d, parts), wp.int32)
        self._pairs = SurfacePairs(world, meshes, nodes, self.surface, len(world.objects) + len(world.statics))
        room = 64 + 2 * int(self.surface.exposed.numpy().sum()) + self.surface.edges.shape[0] + self._pairs.room()
        self.found = layout.Found()
        # Left unwritten, so that room which is not needed takes no memory.
        self.found.contacts = buffers.empty((w, room), layout.Contact)
        self.found.acting = buffers.empty((w, room), wp.int32)
        self.found.kept = buffers.empty((w, room), layout.Kept)
        self.found.kept_node = buffers.empty((w, room), wp.int32)
        self.found.kept_count = buffers.zeros((w,), wp.int32)
        self.found.latest = buffers.full((w, n), -1, wp.int32)
        self.found.count = buffers.zeros((w,), wp.int32)
        self.found.overflowed = buffers.zeros((w,), wp.int32)
        self.found.falling = buffers.full((w, n), 1.0, wp.float64)
        self.found.reaction = buffers.zeros((w, n), wp.vec3d)
        bodies = [o.name for o in (*world.objects, *world.statics)]
        names = [d.name for d in world.deformables]
        self.tally = _tally(w, d, len(bodies), record_events)
        self._log = DeformableContactLog(w, self.tally, names, [*bodies, *names])

    def reset(self) -> None:
        """Forget all contacts."""
        self.found.count.numpy()[:] = 0
        self.found.overflowed.numpy()[:] = 0
        self.found.reaction.numpy()[:] = 0.0
        self.found.kept_count.numpy()[:] = 0
        self.found.latest.numpy()[:] = -1
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
        return self.found.overflowed.numpy() > 0

    @property
    def room(self) -> int:
        """Contacts that a world has room for."""
        return int(self.found.contacts.shape[1])

    def launch_search(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the search for all that may touch within the coupling step."""
        w, d, parts = self.bounds.near.shape
        buffers.launch(bound_objects, (w, d), [nodes.x, nodes.v, self.surface, self.bounds])
        buffers.launch(keep_acting, self.n_worlds, [clock.h, self.found])
        self._pairs.launch(nodes, clock, self.bounds, self.found)
        if parts > 0:
            self._search_bodies(nodes, clock)
        buffers.launch(recall_acting, self.n_worlds, [clock.h, self.found])

    def _search_bodies(self, nodes: Nodes, clock: Clock) -> None:
        w, d, parts = self.bounds.near.shape
        moving = [clock.h, clock.gravity]
        solids = [self._geometry, self.obstacles, self._bodies]
        of_nodes = [nodes.x, nodes.v, nodes.radius, nodes.owner, nodes.active, nodes.friction, nodes.restitution]
        buffers.launch(near_parts, (w, d, parts), [*moving, *solids, nodes.radius, self.surface, self.bounds])
        rest = [self.surface, self.bounds, self.found]
        buffers.launch(search_nodes, (w, _blocks(nodes.x.shape[1])), [*moving, *solids, *of_nodes, *rest])
        buffers.launch(search_edges, (w, _blocks(self.surface.edges.shape[0])), [*moving, *solids, *of_nodes, *rest])
        buffers.launch(
            search_corners,
            (w, _blocks(self.surface.triangles.shape[0])),
            [*moving, *solids[1:], nodes.x, *of_nodes[2:], *rest],
        )

    def launch_push(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the impulses of the inner step before, which the next solution starts from."""
        solids = [self._inverse_inertia, self._bodies]
        buffers.launch(push_on, self.n_worlds, [clock.dt, nodes.inverse_mass, *solids, nodes.v, self.found])

    def launch_solve(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the impulses of one inner step."""
        buffers.launch(
            solve_contacts,
            self.n_worlds,
            [
                clock.time,
                clock.dt,
                clock.inner,
                clock.gravity,
                self._geometry,
                self.obstacles,
                self.surface.across,
                self._bodies,
                self._acceleration,
                self._before,
                self._flying,
                self._inverse_inertia,
                nodes.inverse_mass,
                nodes.x,
                nodes.v,
                self.found,
                self.tally,
            ],
        )


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
