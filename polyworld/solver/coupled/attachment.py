"""Attachments of ropes, cloth and soft bodies to the world, to rigid bodies and to each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh
from polyworld.solver.coupled import attachment_kernels as kernels
from polyworld.solver.coupled.attachment_targets import Held, held_by_rope_stage, held_nodes, nearest_on
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.trajectory import Event
from polyworld.world import World

Array = NDArray[np.float64]


class Attachments:
    """The attachments of W worlds, but for those of a rope's end to a rigid body, which the rope's solver holds."""

    def __init__(self, world: World, meshes: dict[str, DeformableMesh], nodes: Nodes, bodies: Any) -> None:
        """bodies: (W, B) of rigid bodies, or None."""
        self.world = world
        self.attachments = world.attachments
        self._bodies = bodies
        self._w = nodes.x.shape[0]
        self._names = [o.name for o in world.objects]
        self._to_world, self._to_nodes = Held(), Held()
        on_bodies: dict[int, Held] = {}
        for a, attachment in enumerate(world.attachments):
            if held_by_rope_stage(attachment, world):
                continue
            own = held_nodes(meshes, attachment)
            rows = [int(n) + nodes.first[attachment.object] for n in own]
            if attachment.to is None:
                held = self._to_world
            elif attachment.to in self._names:
                held = on_bodies.setdefault(self._names.index(attachment.to), Held())
            else:
                held = self._to_nodes
                for n in own:
                    target, weight, offset = nearest_on(meshes[attachment.to], meshes[attachment.object].nodes[n])
                    first = nodes.first[attachment.to]
                    held.target.append(np.where(target >= 0, target + first, -1).astype(np.int32))
                    held.weight.append(weight)
                    held.offset.append(offset)
            held.node.extend(rows)
            held.attachment.extend([a] * len(rows))
        self._breakable = any(a.release is not None or a.strength is not None for a in world.attachments)
        self._allocate(on_bodies)

    def _allocate(self, on_bodies: dict[int, Held]) -> None:
        w, count = self._w, max(len(self.attachments), 1)
        f = kernels.Fastenings()
        f.released, f.when = buffers.zeros((w, count), wp.int32), buffers.zeros((w, count), wp.float64)
        f.impulse, f.force = buffers.zeros((w, count), wp.vec3d), buffers.zeros((w, count), wp.vec3d)
        never, unbreakable = np.inf, -1.0
        f.release = _floats([never if a.release is None else a.release for a in self.attachments] or [never])
        f.strength = _floats([unbreakable if a.strength is None else a.strength for a in self.attachments] or [-1.0])
        self.fastenings = f
        self._last_h = buffers.zeros((w,), wp.float64)
        self._motion = self._motions()
        self._world_node, self._world_attachment = _ints(self._to_world.node), _ints(self._to_world.attachment)
        self._world_place = buffers.zeros((w, len(self._to_world.node)), wp.vec3d)
        groups = sorted(on_bodies)
        self._body = _ints(groups)
        self._body_first = _ints(np.cumsum([0, *(len(on_bodies[g].node) for g in groups)]))
        self._body_node = _ints([n for g in groups for n in on_bodies[g].node])
        self._body_attachment = _ints([a for g in groups for a in on_bodies[g].attachment])
        self._body_place = buffers.zeros((w, self._body_node.shape[0]), wp.vec3d)
        held = self._to_nodes
        self._node_node, self._node_attachment = _ints(held.node), _ints(held.attachment)
        self._target: Any = buffers.array(np.array(held.target, dtype=np.int32).reshape(-1, 3), wp.vec3i)
        self._weight: Any = buffers.array(np.array(held.weight).reshape(-1, 3), wp.vec3d)
        self._offset: Any = buffers.array(np.array(held.offset).reshape(-1, 3), wp.vec3d)
        self._body_last: Any = buffers.zeros((w, self._body_node.shape[0]), wp.vec3d)
        self._last: Any = buffers.zeros((w, len(held.node)), wp.vec3d)
        self._wanted = buffers.zeros((w, len(held.node)), wp.vec3d)

    def _motions(self) -> kernels.Motion:
        """Displacements count from where the object's nodes are when it joins."""
        motion = kernels.Motion()
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
        motion.first = _ints(first)
        motion.time = _floats(values[:, 0])
        motion.displacement = buffers.array(values[:, 1:], wp.vec3d)
        return motion

    def hold(self, inverse_mass: Array) -> Array:
        """Return inverse masses (R, N), 0 for the nodes held to the world; W rows where they may be released."""
        if not self._to_world.node:
            return inverse_mass
        rows = self._w if self._breakable else len(inverse_mass)
        held = np.broadcast_to(inverse_mass, (rows, inverse_mass.shape[1])).copy()
        held[:, self._to_world.node] = 0.0
        return held

    def reset(self, nodes: Nodes) -> None:
        """Hold everything again, where the nodes and bodies are now: at their start."""
        f = self.fastenings
        f.released.numpy()[:] = 0
        f.when.numpy()[:] = np.nan
        kept: tuple[Any, ...] = (f.impulse, f.force, self._last, self._body_last, self._last_h)
        for values in kept:
            values.numpy()[:] = 0.0
        x = nodes.x.numpy()
        self._world_place.numpy()[:] = x[:, self._to_world.node]
        node, first, bodies = self._body_node.numpy(), self._body_first.numpy(), self._body.numpy()
        if len(bodies):
            state = self._bodies.numpy()
            for g, body in enumerate(bodies):
                rows = slice(first[g], first[g + 1])
                arms = x[:, node[rows]] - state["x"][:, body, None, :]
                self._body_place.numpy()[:, rows] = np.einsum("wji,wkj->wki", state["rotation"][:, body], arms)

    def launch_begin(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the start of a coupling step: forces of the last one, and releases."""
        if not self.attachments:
            return
        buffers.launch(
            kernels.begin_step, (self._w, len(self.attachments)), [clock.time, clock.h, self._last_h, self.fastenings]
        )
        buffers.launch(kernels.note_length, self._w, [clock.h, self._last_h])
        if self._breakable and self._to_world.node:
            buffers.launch(
                kernels.free_nodes,
                self._w,
                [
                    clock.h,
                    self._world_node,
                    self._world_attachment,
                    nodes.mass,
                    nodes.inverse_mass,
                    self.fastenings,
                ],
            )

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """Launch what reads the forces on held nodes, once the stages have added theirs."""
        if self._to_world.node:
            held = [self._world_node, self._world_attachment]
            buffers.launch(kernels.resist_forces, self._w, [clock.dt, *held, nodes.active, nodes.f, self.fastenings])

    def launch_tensions(self, nodes: Nodes, clock: Clock, links: tuple[Any, Any]) -> None:
        """Launch what reads the tensions of ropes at held nodes, once they are found. links: of the rope's stage."""
        if self._to_world.node:
            from polyworld.solver.coupled.attachment_ropes import resist_tensions

            held = [self._world_node, self._world_attachment]
            dim = (self._w, len(self._to_world.node))
            buffers.launch(resist_tensions, dim, [clock.dt, *held, *links, nodes.active, self.fastenings])

    def launch_push(self, nodes: Nodes, clock: Clock) -> None:
        """Launch the impulses of the inner step before, which the next solution starts from."""
        if self._body.shape[0]:
            held = [self._body, self._body_first, self._body_node, self._body_attachment]
            state = [nodes.inverse_mass, nodes.active, self._bodies, nodes.x, nodes.v, self._body_last]
            dim = (self._w, self._body.shape[0])
            buffers.launch(kernels.push_on_bodies, dim, [clock.dt, *held, *state, self.fastenings])
        if self._to_nodes.node:
            held = [self._node_node, self._node_attachment, self._target, self._weight]
            state = [nodes.inverse_mass, nodes.active, nodes.v, self._last]
            buffers.launch(kernels.push_on_nodes, self._w, [clock.dt, *held, *state, self.fastenings])

    def launch_velocities(self, nodes: Nodes, clock: Clock, reaction: Any) -> None:
        """Launch what holds the nodes in one inner step. reaction (W, N): impulses of contacts on held nodes."""
        f = self.fastenings
        if self._body.shape[0]:
            buffers.launch(
                kernels.hold_to_bodies,
                (self._w, self._body.shape[0]),
                [
                    clock.dt,
                    self._body,
                    self._body_first,
                    self._body_node,
                    self._body_attachment,
                    self._body_place,
                    nodes.mass,
                    nodes.inverse_mass,
                    nodes.active,
                    self._bodies,
                    nodes.x,
                    nodes.v,
                    self._body_last,
                    f,
                ],
            )
        if self._to_nodes.node:
            buffers.launch(
                kernels.hold_to_nodes,
                self._w,
                [
                    clock.dt,
                    self._node_node,
                    self._node_attachment,
                    self._target,
                    self._weight,
                    self._offset,
                    nodes.inverse_mass,
                    nodes.active,
                    nodes.x,
                    nodes.v,
                    self._last,
                    self._wanted,
                    f,
                ],
            )
        if self._to_world.node:
            buffers.launch(
                kernels.hold_to_world,
                self._w,
                [
                    clock.time,
                    clock.dt,
                    clock.inner,
                    self._world_node,
                    self._world_attachment,
                    self._world_place,
                    self._motion,
                    nodes.mass,
                    nodes.active,
                    nodes.x,
                    nodes.v,
                    reaction,
                    f,
                ],
            )

    def forces(self) -> dict[str, Array]:
        """Attachment -> force (W, 3) on the deformable object, mean of the last coupling step [N]."""
        force = self.fastenings.force.numpy()
        return {
            a.name: force[:, k].copy() for k, a in enumerate(self.attachments) if not held_by_rope_stage(a, self.world)
        }

    def events(self, w: int) -> tuple[Event, ...]:
        """Return the releases of attachments of world w."""
        released, when = self.fastenings.released.numpy()[w], self.fastenings.when.numpy()[w]
        return tuple(
            Event("release", float(when[k]), (a.object,) if a.to is None else (a.object, a.to))
            for k, a in enumerate(self.attachments)
            if released[k] and not held_by_rope_stage(a, self.world)
        )


def _ints(values: Any) -> Any:
    return buffers.array(np.asarray(values, dtype=np.int32).reshape(-1), wp.int32)


def _floats(values: Any) -> Any:
    return buffers.array(np.asarray(values, dtype=np.float64).reshape(-1), wp.float64)
