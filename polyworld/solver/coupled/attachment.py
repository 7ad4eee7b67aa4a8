"""Attachments of ropes, cloth and soft bodies to the world, to rigid bodies and to each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.coupled import attachment_jointed as jointed
from polyworld.solver.coupled import attachment_kernels as kernels
from polyworld.solver.coupled import attachment_layout as layout
from polyworld.solver.coupled.attachment_targets import Held, held_by_rope_stage, held_nodes, nearest_on
from polyworld.solver.coupled.contact_bodies import CarriedBodies
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.trajectory import Event
from polyworld.world import World

Array = NDArray[np.float64]


class Attachments:
    """The attachments of W worlds, but for those of a rope's end to a rigid body, which the rope's solver holds."""

    def __init__(
        self,
        world: World,
        meshes: dict[str, DeformableMesh],
        first: dict[str, int],
        nodes: Nodes,
        carried: CarriedBodies | None,
    ) -> None:
        """first: the row of each object's first node. carried: the world's bodies, None where it has none."""
        self.world = world
        self.attachments = world.attachments
        self._bodies: Any = None if carried is None else carried.bodies
        self._mechanisms: Any = None if carried is None else carried.mechanisms
        self._w = nodes.x.shape[0]
        self._names = [o.name for o in world.objects]
        to_world, to_nodes = Held(), Held()
        on_bodies: dict[int, Held] = {}
        for a, attachment in enumerate(world.attachments):
            if held_by_rope_stage(attachment, world):
                continue
            own = held_nodes(meshes, attachment)
            rows = [int(n) + first[attachment.object] for n in own]
            if attachment.to is None:
                held = to_world
            elif attachment.to in self._names:
                held = on_bodies.setdefault(self._names.index(attachment.to), Held())
            else:
                held = to_nodes
                for n in own:
                    target, weight, offset = nearest_on(meshes[attachment.to], meshes[attachment.object].nodes[n])
                    held.target.append(np.where(target >= 0, target + first[attachment.to], -1).astype(np.int32))
                    held.weight.append(weight)
                    held.offset.append(offset)
            held.node.extend(rows)
            held.attachment.extend([a] * len(rows))
        self._breakable = any(a.release is not None or a.strength is not None for a in world.attachments)
        self.fastenings = self._fastenings()
        self._motion = self._motions()
        self._on_world = _on_world(to_world, self._w)
        self._on_bodies = _on_bodies(on_bodies, self._w)
        self._on_jointed = carried is not None and any(
            buffers.read(carried.mechanisms.first)[b] >= 0 for b in on_bodies
        )
        self._on_nodes = _on_nodes(to_nodes, self._w)

    def _fastenings(self) -> layout.Fastenings:
        w, count = self._w, max(len(self.attachments), 1)
        f = layout.Fastenings()
        f.released, f.when = buffers.zeros((w, count), wp.int32), buffers.zeros((w, count), wp.float64)
        f.impulse, f.force = buffers.zeros((w, count), wp.vec3d), buffers.zeros((w, count), wp.vec3d)
        never, unbreakable = np.inf, -1.0
        f.release = buffers.doubles([never if a.release is None else a.release for a in self.attachments] or [never])
        strengths = [unbreakable if a.strength is None else a.strength for a in self.attachments]
        f.strength = buffers.doubles(strengths or [unbreakable])
        f.last_h = buffers.zeros((w,), wp.float64)
        return f

    def _motions(self) -> layout.Motion:
        """Displacements count from where the object's nodes are when it joins."""
        motion = layout.Motion()
        rows: list[Array] = []
        first = [0]
        for attachment in self.attachments:
            table = np.array(attachment.motion, dtype=float).reshape(-1, 4)
            start = float(getattr(self.world.deformable(attachment.object), "start_time", 0.0))
            if len(table) and table[0, 0] > start:  # on the way to the first row from the start
                table = np.concatenate([[[start, 0.0, 0.0, 0.0]], table])
            elif len(table):
                table[:, 1:] -= [np.interp(start, table[:, 0], table[:, k]) for k in (1, 2, 3)]
            rows.extend(table)
            first.append(len(rows))
        values = np.array(rows, dtype=float).reshape(-1, 4)
        motion.first = buffers.ints(first)
        motion.time = buffers.doubles(values[:, 0])
        motion.displacement = buffers.array(values[:, 1:], wp.vec3d)
        return motion

    def hold(self, inverse_mass: Array) -> Array:
        """Return inverse masses (R, N), 0 for the nodes held to the world; W rows where they may be released."""
        if not self._on_world.node.shape[0]:
            return inverse_mass
        rows = self._w if self._breakable else len(inverse_mass)
        held = np.broadcast_to(inverse_mass, (rows, inverse_mass.shape[1])).copy()
        held[:, buffers.read(self._on_world.node)] = 0.0
        return held

    def reset(self, nodes: Nodes) -> None:
        """Hold everything again, where the nodes and bodies are now: at their start."""
        f = self.fastenings
        buffers.write(f.released, 0)
        buffers.write(f.when, np.nan)
        kept: tuple[Any, ...] = (f.impulse, f.force, f.last_h, self._on_nodes.last, self._on_bodies.last)
        for values in kept:
            buffers.write(values, 0.0)
        x = buffers.read(nodes.x)
        buffers.write(self._on_world.position, x[:, buffers.read(self._on_world.node)])
        held = self._on_bodies
        node, first, bodies = buffers.read(held.node), buffers.read(held.first), buffers.read(held.body)
        if len(bodies):
            state = buffers.read(self._bodies)
            for g, body in enumerate(bodies):
                rows = slice(first[g], first[g + 1])
                arms = x[:, node[rows]] - state["x"][:, body, None, :]
                buffers.write(
                    held.position, np.einsum("wji,wkj->wki", state["rotation"][:, body], arms), np.s_[:, rows]
                )

    def launch_begin(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the start of a coupling step: forces of the last one, and releases."""
        if not self.attachments:
            return
        f = self.fastenings
        buffers.launch(kernels.begin_step, (self._w, len(self.attachments)), [clock, f])
        buffers.launch(kernels.note_length, self._w, [clock, f])
        if self._breakable and self._on_world.node.shape[0]:
            buffers.launch(kernels.free_nodes, self._w, [clock, nodes, self._on_world, f])

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """Launch what reads the forces on held nodes, once the stages have added theirs."""
        if self._on_world.node.shape[0]:
            buffers.launch(kernels.resist_forces, self._w, [clock, nodes, self._on_world, self.fastenings])

    def launch_tensions(self, nodes: Nodes, clock: Clock, links: tuple[Any, Any]) -> None:
        """Launch what reads the tensions of ropes at held nodes, once they are found. links: of the rope's stage."""
        held = self._on_world
        if held.node.shape[0]:
            from polyworld.solver.coupled.attachment_ropes import resist_tensions

            dim = (self._w, held.node.shape[0])
            buffers.launch(resist_tensions, dim, [clock, nodes, held, *links, self.fastenings])

    def launch_push(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the impulses of the inner step before, which the next solution starts from."""
        if self._on_bodies.body.shape[0]:
            dim = (self._w, self._on_bodies.body.shape[0])
            inputs = [clock, nodes, self._bodies, self._mechanisms, self._on_bodies, self.fastenings]
            buffers.launch(kernels.push_on_bodies, dim, inputs)
            if self._on_jointed:
                buffers.launch(jointed.push_on_jointed, self._w, inputs)
        if self._on_nodes.node.shape[0]:
            buffers.launch(kernels.push_on_nodes, self._w, [clock, nodes, self._on_nodes, self.fastenings])

    def launch_velocities(self, nodes: Nodes, clock: Clock, reaction: Any) -> None:
        """Launch what holds the nodes in one inner step. reaction (W, N): impulses of contacts on held nodes."""
        f = self.fastenings
        if self._on_bodies.body.shape[0]:
            dim = (self._w, self._on_bodies.body.shape[0])
            inputs = [clock, nodes, self._bodies, self._mechanisms, self._on_bodies, f]
            buffers.launch(kernels.hold_to_bodies, dim, inputs)
            if self._on_jointed:
                buffers.launch(jointed.hold_to_jointed, self._w, inputs)
        if self._on_nodes.node.shape[0]:
            buffers.launch(kernels.hold_to_nodes, self._w, [clock, nodes, self._on_nodes, f])
        if self._on_world.node.shape[0]:
            inputs = [clock, nodes, self._on_world, self._motion, reaction, f]
            buffers.launch(kernels.hold_to_world, self._w, inputs)

    def forces(self) -> dict[str, Array]:
        """Attachment -> force (W, 3) on the deformable object, mean of the last coupling step [N]."""
        force = buffers.read(self.fastenings.force)
        return {
            a.name: force[:, k].copy() for k, a in enumerate(self.attachments) if not held_by_rope_stage(a, self.world)
        }

    def events(self, w: int) -> tuple[Event, ...]:
        """Return the releases of attachments of world w."""
        released, when = buffers.read(self.fastenings.released)[w], buffers.read(self.fastenings.when)[w]
        return tuple(
            Event("release", float(when[k]), (a.object,) if a.to is None else (a.object, a.to))
            for k, a in enumerate(self.attachments)
            if released[k] and not held_by_rope_stage(a, self.world)
        )


def _on_world(held: Held, w: int) -> layout.OnWorld:
    record = layout.OnWorld()
    record.node, record.attachment = buffers.ints(held.node), buffers.ints(held.attachment)
    record.position = buffers.zeros((w, len(held.node)), wp.vec3d)
    return record


def _on_bodies(held: dict[int, Held], w: int) -> layout.OnBodies:
    """held: by body."""
    groups = sorted(held)
    record = layout.OnBodies()
    record.body = buffers.ints(groups)
    record.first = buffers.ints(np.cumsum([0, *(len(held[g].node) for g in groups)]))
    record.node = buffers.ints([n for g in groups for n in held[g].node])
    record.attachment = buffers.ints([a for g in groups for a in held[g].attachment])
    record.position = buffers.zeros((w, record.node.shape[0]), wp.vec3d)
    record.last = buffers.zeros((w, record.node.shape[0]), wp.vec3d)
    return record


def _on_nodes(held: Held, w: int) -> layout.OnNodes:
    record = layout.OnNodes()
    record.node, record.attachment = buffers.ints(held.node), buffers.ints(held.attachment)
    record.target = buffers.array(np.array(held.target, dtype=np.int32).reshape(-1, 3), wp.vec3i)
    record.weight = buffers.array(np.array(held.weight).reshape(-1, 3), wp.vec3d)
    record.offset = buffers.array(np.array(held.offset).reshape(-1, 3), wp.vec3d)
    record.last = buffers.zeros((w, len(held.node)), wp.vec3d)
    record.wanted = buffers.zeros((w, len(held.node)), wp.vec3d)
    return record
