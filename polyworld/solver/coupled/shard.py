"""The coupled solver's loop over some of the worlds: one thread runs one shard."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers, interruption
from polyworld.model import Model
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.time_table import TimeTable
from polyworld.solver.coupled import room, step
from polyworld.solver.coupled.assembly import (
    allocate_nodes,
    clock_of,
    first_nodes,
    fluid_of,
    stages_of,
    write_in_place,
)
from polyworld.solver.coupled.attachment import Attachments
from polyworld.solver.coupled.contact import Contacts
from polyworld.solver.coupled.contact_bodies import CarriedBodies
from polyworld.solver.coupled.kernels import load_kernels
from polyworld.solver.coupled.mass_effects import MassEffects
from polyworld.solver.coupled.nodes import Fields, parameter_row
from polyworld.solver.coupled.stage import HeldByBodies
from polyworld.trajectory import Event, Truncation
from polyworld.world.materials import material_of

if TYPE_CHECKING:
    from polyworld.solver.fluid.solver import FluidSolver

Array = NDArray[np.float64]

LONGEST_INNER_STEP = 1e-3  # contacts are first order in it [s]
TRUNCATED = 1 << 28  # in place of a node that diverged, where nothing did
FLUID_DIVERGED = 1 << 29  # added to the index of a particle where it, not a node, diverged
RIGID_DIVERGED = 1 << 30  # added to the index of a rigid object where it, not a node, diverged


class Shard:
    """W worlds that differ in parameters only; buffers and graphs are kept from one run to the next."""

    def __init__(self, model: Model, table: TimeTable, n_worlds: int, record_events: bool) -> None:
        self.model, self.world = model, model.world
        world, meshes = model.world, model.meshes
        self.n_worlds = n_worlds
        self.table = table
        self.meshes = meshes
        self.solids: tuple[Any, ...] = world.of_form("line", "sheet", "solid")
        self.owners = {d.name: i for i, d in enumerate(world.deformables)}
        self.first = first_nodes(self.solids, meshes)
        self.nodes = allocate_nodes(world, self.solids, meshes, n_worlds)
        self.clock = clock_of(n_worlds)
        self.start = buffers.doubles([getattr(d, "start_time", 0.0) for d in world.deformables])
        self.time_scale: Any = None  # (R,) of the start times
        self.damping: Any = None  # (R, D) by deformable [1/s]
        self.before = buffers.zeros(self.nodes.v.shape, wp.vec3d)  # velocities when the inner step began
        load_kernels(world)
        interruption.check()  # each of these takes seconds for many points
        self.stages = stages_of(world, self.first, n_worlds)
        self.effects = MassEffects(world)
        self.record_events = record_events
        self._graphs: step.Graphs | None = None
        self.diverged_node = buffers.full((n_worlds,), -1, wp.int32)
        self.diverged_time = buffers.full((n_worlds,), np.nan, wp.float64)
        self.truncated: dict[int, Truncation] = {}
        self._build_rigid()
        bodies = None if self.rigid is None else self.rigid.bodies
        interruption.check()
        self.fluid = fluid_of(world, n_worlds, float(table.end[-1]))
        if self.fluid is not None:
            self.fluid.bind(bodies, self.nodes, self.first)
        self.attachments = Attachments(world, meshes, self.first, self.nodes, self.carried)
        self.contacts = Contacts(
            world, meshes, self.first, self.nodes, self.carried, self.rigid, record_events=record_events
        )

    # --- set-up --------------------------------------------------------------------------------

    def _build_rigid(self) -> None:
        self.rigid: Any = None
        self.carried: CarriedBodies | None = None
        if not self.world.objects and not self.world.statics:
            return
        from polyworld.solver.spatial.stepper import RigidStepper

        self.rigid = RigidStepper(self.model, self.n_worlds, record_events=self.record_events)
        bodies = self.rigid.bodies
        self.carried = CarriedBodies(self.world, self.rigid)
        for stage in self.stages:
            stage.bind(bodies)
            if isinstance(stage, HeldByBodies):
                stage.bind_mechanisms(self.carried.mechanisms)

    # --- one run -------------------------------------------------------------------------------

    def write(self, arrays: RigidArrays, fields: Fields) -> None:
        """Take parameters and go back to the initial state."""
        recapture = self._write_nodes(fields)
        recapture |= self.contacts.write(fields)
        recapture |= self.effects.write(arrays)
        if self.fluid is not None:
            recapture |= self.fluid.write(fields)
        for stage in self.stages:
            recapture |= stage.write(fields)
        gravity: Any = buffers.array(arrays.gravity, wp.vec3d)
        recapture |= write_in_place(self.clock, "gravity", gravity)
        recapture |= write_in_place(self, "time_scale", buffers.array(arrays.time_scale[:, 0], wp.float64))
        if self.rigid is not None:
            self.rigid.write(arrays)
        if recapture:
            self._graphs = None
        self._reset(arrays, fields)

    def _write_nodes(self, fields: Fields) -> bool:
        nodes = self.nodes
        masses = []
        for item in self.solids:
            density = np.atleast_1d(fields[item.name][material_of(item).density])
            masses.append(density[:, None] * self.meshes[item.name].measure[None, :])
        rows = max((len(m) for m in masses), default=1)
        mass = np.concatenate([np.broadcast_to(m, (rows, m.shape[1])) for m in masses] or [np.zeros((1, 0))], axis=1)
        with np.errstate(divide="ignore"):
            inverse = self.attachments.hold(np.where(mass > 0, 1.0 / mass, 0.0))
        names = tuple(self.owners)
        zero = np.zeros(1)
        for name in names:  # a fluid has neither friction nor restitution nor damping of its own
            for parameter in ("friction", "restitution", "linear_damping"):
                fields[name].setdefault(parameter, zero)
        recapture = write_in_place(nodes, "mass", buffers.array(mass, wp.float64))
        recapture |= write_in_place(nodes, "inverse_mass", buffers.array(inverse, wp.float64))
        recapture |= write_in_place(self, "damping", parameter_row(fields, names, "linear_damping"))
        return recapture

    def _reset(self, arrays: RigidArrays, fields: Fields) -> None:
        x, v = np.zeros((*self.nodes.x.shape, 3)), np.zeros((*self.nodes.v.shape, 3))
        for item in self.solids:
            mesh = self.meshes[item.name]
            keep = self.rows(item.name)
            state = {k: np.broadcast_to(fields[item.name][k], (self.n_worlds,)) for k in material_of(item).state}
            shift = np.stack([state[f"shift.{a}"] for a in "xyz"], axis=1)
            velocity = np.stack([state[f"velocity.{a}"] for a in "xyz"], axis=1)
            x[:, keep] = mesh.nodes[None] + shift[:, None]
            v[:, keep] = velocity[:, None]
            if "angular_velocity.x" in state:
                spin = np.stack([state[f"angular_velocity.{a}"] for a in "xyz"], axis=1)
                centre = (mesh.measure[:, None] * mesh.nodes).sum(axis=0) / mesh.measure.sum()
                v[:, keep] += np.cross(spin[:, None], (mesh.nodes - centre)[None])
        buffers.write(self.nodes.x, x)
        buffers.write(self.nodes.v, v)
        buffers.write(self.nodes.active, 0)
        buffers.write(self.clock.time, 0.0)
        buffers.write(self.diverged_node, -1)
        buffers.write(self.diverged_time, np.nan)
        self.truncated = {}
        for stage in self.stages:
            stage.reset()
        if self.rigid is not None and self.carried is not None:
            self.rigid.reset()
            self.carried.reset()
        if self.fluid is not None:
            self.fluid.reset()
        self.attachments.reset(self.nodes)
        self.contacts.reset()
        longest = self.world.time.substep * np.broadcast_to(arrays.time_scale[:, 0], (self.n_worlds,))
        stable = np.full(self.n_worlds, LONGEST_INNER_STEP)
        for stage in self.stages:
            stable = np.minimum(stable, stage.stable_step())
        if not np.all(stable > 0.0):  # not a number too
            raise ValueError(f"no step is stable for these parameters: {stable.tolist()} s")
        buffers.write(self.clock.inner_steps, np.maximum(np.ceil(longest / stable * (1.0 - 1e-12)), 1))

    def advance(self, segment: int, used_up: Callable[[int], str | None] = lambda _: None) -> None:
        """Run the steps of one segment of the time table.

        used_up: given how many steps of it are done, says why all worlds have to end here, None where they go on.
        """
        self.prepare()
        end = self.table.end[segment] * np.broadcast_to(buffers.read(self.time_scale), (self.n_worlds,))
        steps = int(self.table.steps[segment])
        for left in range(steps, 0, -1):
            interruption.check()
            time, goes_on = buffers.read(self.clock.time), self.live()
            buffers.write(self.clock.h, np.where(goes_on, (end - time) / left, 0.0))
            if self.rigid is not None:
                self.rigid.reserve()
            self.contacts.reserve()
            with self._halting():
                step.advance(self)
            room.check_bodies(self)
            self._note_diverged_bodies()
            if self.fluid is not None:
                self._note_diverged_fluid(self.fluid)
            reason = used_up(steps - left + 1)
            if reason is not None:
                for w in np.flatnonzero(self.live()):
                    self.truncate(int(w), reason)
        buffers.write(self.clock.time, np.where(self.live(), end, buffers.read(self.clock.time)))

    def _halting(self) -> AbstractContextManager[None]:
        """Return what ends a coupling step of fluids, which takes all its sub-steps in one launch, where asked to."""
        return nullcontext() if self.fluid is None else interruption.current().stopping(self.fluid.halt)

    def live(self) -> NDArray[np.bool_]:
        """Return which worlds (W,) have not diverged."""
        found: NDArray[np.bool_] = buffers.read(self.diverged_node) < 0
        return found

    def stop(self, w: int, node: int) -> None:
        """End world w here: at a node that diverged, or what else `diverged_node` may hold."""
        if self.live()[w]:
            buffers.write(self.diverged_node, node, w)
            buffers.write(self.diverged_time, buffers.read(self.clock.time)[w], w)
            buffers.write(self.clock.h, 0.0, w)

    def truncate(self, w: int, reason: str) -> None:
        """End world w here, though nothing diverged; the other worlds go on."""
        if self.live()[w]:
            self.stop(w, TRUNCATED)
            self.truncated[int(w)] = Truncation(float(buffers.read(self.clock.time)[w]), reason)

    def _note_diverged_fluid(self, fluid: FluidSolver) -> None:
        """End a world whose particle diverges."""
        particle = buffers.read(fluid.diverged)
        for w in np.flatnonzero((particle >= 0) & self.live()):
            self.stop(w, FLUID_DIVERGED + particle[w])

    def _note_diverged_bodies(self) -> None:
        """Rigid objects whose state cannot be trusted end their world as nodes do."""
        if not self.world.objects:
            return
        body = self.rigid.diverged()
        for w in np.flatnonzero((body >= 0) & self.live()):
            self.stop(w, RIGID_DIVERGED + body[w])

    # --- what it is at this moment -------------------------------------------------------------

    def point_counts(self) -> dict[str, int]:
        """Number of points of each deformable object."""
        counts = {d.name: len(self.meshes[d.name].nodes) for d in self.solids}
        if self.fluid is not None:
            counts.update(dict.fromkeys(self.fluid.names, self.fluid.particles()[0].shape[1]))
        return counts

    def rows(self, name: str) -> slice:
        """Rows of a rope, cloth or soft body among the nodes."""
        return slice(self.first[name], self.first[name] + len(self.meshes[name].nodes))

    def points(self) -> dict[str, tuple[Array, Array]]:
        """Positions and velocities (W, k, 3) of each deformable object's points."""
        x, v = buffers.read(self.nodes.x), self._settled_velocities()
        found = {}
        for name in self.first:
            keep = self.rows(name)
            found[name] = (x[:, keep], v[:, keep])
        if self.fluid is not None:
            x, v, fluid = self.fluid.particles()
            for number, name in enumerate(self.fluid.names):
                own = (fluid == number)[..., None]
                found[name] = (np.where(own, x, np.nan), np.where(own, v, np.nan))
        return found

    def _settled_velocities(self) -> Array:
        """Velocities (W, N, 3) of the nodes now. What they carry is half a step of gravity ahead of how they move (see
        `motion.move`) where gravity is held up, so that much is taken off; where they fall freely, it is right.
        """
        now, before = buffers.read(self.nodes.v), buffers.read(self.before)
        gravity = buffers.read(self.clock.gravity)[:, None]
        dt = buffers.read(self.clock.h) / np.maximum(buffers.read(self.clock.inner_steps), 1)
        dt = np.where(buffers.read(self.clock.time) > 0.0, dt, 0.0)[:, None]
        moves = (buffers.read(self.nodes.inverse_mass) > 0.0) & (buffers.read(self.nodes.active) > 0)
        pull = np.maximum(dt * (gravity**2).sum(axis=-1), 1e-300)
        falls = np.clip(((now - before) * gravity).sum(axis=-1) / pull, 0.0, 1.0)
        corrected: Array = now - (0.5 * dt * moves * (1.0 - falls))[..., None] * gravity
        return corrected

    def quantities(self) -> dict[str, dict[str, Array]]:
        """Readable quantities of each deformable object, values (W, m)."""
        found: dict[str, dict[str, Array]] = {}
        for stage in self.stages:
            for name, values in stage.quantities(self.nodes).items():
                found.setdefault(name, {}).update(values)
        return found

    def divergence(self) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
        """Return time [s], index of the moving object and of its element where each world diverged; NaN, -1, -1."""
        node = buffers.read(self.diverged_node)
        rigid_count = len(self.world.objects)
        objects = np.full(self.n_worlds, -1, dtype=np.int64)
        elements = np.full(self.n_worlds, -1, dtype=np.int64)
        for w in np.flatnonzero((node >= 0) & (node != TRUNCATED)):
            if node[w] >= RIGID_DIVERGED:
                objects[w], elements[w] = node[w] - RIGID_DIVERGED, 0
                continue
            if node[w] >= FLUID_DIVERGED and self.fluid is not None:
                number = int(self.fluid.particles()[2][w, node[w] - FLUID_DIVERGED])
                objects[w] = rigid_count + self.owners[self.fluid.names[max(number, 0)]]
                elements[w] = node[w] - FLUID_DIVERGED
                continue
            owner = int(buffers.read(self.nodes.owner)[node[w]])
            name = self.world.deformables[owner].name
            objects[w] = rigid_count + owner
            elements[w] = node[w] - self.first[name]
        return np.where(node == TRUNCATED, np.nan, buffers.read(self.diverged_time)), objects, elements

    def events(self, w: int, end: float) -> tuple[Event, ...]:
        """Contacts of world w up to the time `end`, or to where it stopped, in order of time."""
        if not self.record_events:
            return ()
        end = float(np.fmin(end, buffers.read(self.diverged_time)[w]))
        found = [] if self.rigid is None else list(self.rigid.events(w, end))
        found += [*self.contacts.events(w, end), *self.attachments.events(w)]
        return tuple(sorted(found, key=lambda e: (e.time, e.participants, e.kind)))

    def contacts_until(self, w: int) -> float | None:
        """Return the time [s] up to which the contacts of world w are recorded; None where all are."""
        if not self.record_events:
            return 0.0
        logs = [self.contacts.complete_until(w), None if self.rigid is None else self.rigid.log.complete_until(w)]
        return min((t for t in logs if t is not None), default=None)

    @property
    def longest_inner_step(self) -> float:
        """Longest inner step that a world takes, whatever its materials allow [s]."""
        return min(LONGEST_INNER_STEP, self.world.time.substep)

    def prepare(self) -> step.Graphs:
        """Load the kernels and capture the graphs, before threads run them, where that is to be done; return them."""
        if self._graphs is None:
            self._graphs = step.capture(self)
        return self._graphs

    def recapture(self) -> None:
        """Have the graphs captured again: arrays that they hold were replaced."""
        self._graphs = None
