"""Ropes in the coupled solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.model.rope import Threading, threading, unit_axis
from polyworld.solver.coupled.mechanism import Mechanisms, groups
from polyworld.solver.coupled.needs import Need
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes, parameter_row
from polyworld.solver.rope import bending, curve, pace, passing, stretch, tensions, twist
from polyworld.solver.rope.ends import hold_ends
from polyworld.solver.rope.fields import ROPE_FIELDS, WHEEL_FIELDS, Array, chain_curvature, float_row, mass_of, offsets
from polyworld.solver.rope.frames import across, curvatures, parallel_angle, reference_frames
from polyworld.solver.rope.layout import NO_BODY, Ropes, RopeState, Wheel
from polyworld.solver.spatial.layout import Body
from polyworld.world import World, geometry
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rope import Rope

SHARED_SWEEPS = 10  # over the ropes of a world, where a body is held by more than one of their links
SWING = 3.0  # tension of a pendulum that falls from the horizontal, over its weight
SAFETY = 0.6  # of the longest stable step


class RopeStage:
    """See `polyworld.solver.coupled.stage.MaterialStage`."""

    def __init__(self, world: World, items: Sequence[Rope], nodes_first: Mapping[str, int], n_worlds: int) -> None:
        self.world = world
        self.items = tuple(items)
        self.n_worlds = n_worlds
        self.threads = [threading(world, rope) for rope in self.items]
        self._group = groups(world)
        self._ropes = self._describe(nodes_first)
        self._state = self._allocate()
        self._sweeps = SHARED_SWEEPS if self._shares_bodies() else 1
        self._clamped = bool(buffers.read(self._ropes.clamped).any())
        self._twists = bool(buffers.read(self._ropes.clamped).all(axis=1).any())
        self._fields: Fields = {}

    def bind(self, bodies: Any) -> None:
        """Take the array (W, n + s) of rigid bodies, before the first launch."""
        self._state.bodies = bodies

    def bind_mechanisms(self, mechanisms: Mechanisms) -> None:
        """See `polyworld.solver.coupled.stage.HeldByBodies`."""
        self._state.mechanisms = mechanisms

    # --- set-up --------------------------------------------------------------------------------

    def _describe(self, nodes_first: Mapping[str, int]) -> Any:
        count = len(self.items)
        pulleys = [p for thread in self.threads for p in thread.pulleys]
        indices = {o.name: i for i, o in enumerate(self.world.objects)}
        ropes = Ropes()
        ropes.first_node = buffers.ints([nodes_first[r.name] for r in self.items])
        ropes.nodes = buffers.ints([len(t.nodes) for t in self.threads])
        ropes.first_link = buffers.ints(offsets([len(t.rest) for t in self.threads]))
        ropes.first_wheel = buffers.ints(offsets([len(t.pulleys) for t in self.threads]))
        ropes.wheels = buffers.ints([len(t.pulleys) for t in self.threads])
        ropes.segment_length = float_row([t.segment_length for t in self.threads])
        ends = [self._ends(rope, thread, indices) for rope, thread in zip(self.items, self.threads, strict=True)]
        ropes.end_body = buffers.array([[e["body"] for e in pair] for pair in ends], wp.int32)
        ropes.clamped = buffers.array([[e["clamped"] for e in pair] for pair in ends], wp.int32)
        for name in ("anchor", "direction", "director"):
            rows = np.array([[e[name] for e in pair] for pair in ends]).reshape(count, 2, 3)
            setattr(ropes, f"end_{name}", buffers.array(rows, wp.vec3d))
        for name in ("release", "strength"):
            rows = np.array([[e[name] for e in pair] for pair in ends])
            setattr(ropes, f"end_{name}", buffers.array(rows, wp.float64))
        carriers = [NO_BODY if p.object is None else indices[p.object] for p in pulleys]
        centres, axes = [], []
        for pulley in pulleys:
            centre, axis = np.asarray(pulley.centre, dtype=float), unit_axis(pulley)
            if pulley.object is not None:
                centre, axis = self._into_axes(pulley.object, centre), self._rotate_into(pulley.object, axis)
            centres.append(centre)
            axes.append(axis)
        angles = [parallel_angle(t.nodes, e[0]["held"], e[1]["held"]) for t, e in zip(self.threads, ends, strict=True)]
        ropes.twist_at_start = float_row(angles)
        ropes.curved = buffers.ints([int(r.curved_at_rest) for r in self.items])
        self._frames = [
            reference_frames(t.nodes, e[0]["held"]) if rope.curved_at_rest else (np.zeros((len(t.rest), 3)),) * 2
            for rope, t, e in zip(self.items, self.threads, ends, strict=True)
        ]
        curves = np.concatenate([curvatures(*frames) for frames in self._frames])
        ropes.curvature = buffers.array(curves, wp.vec2d)
        ropes.wheel_body = buffers.ints(carriers)
        ropes.wheel_centre = buffers.array(np.array(centres).reshape(-1, 3), wp.vec3d)
        ropes.wheel_axis = buffers.array(np.array(axes).reshape(-1, 3), wp.vec3d)
        ropes.wheel_radius = float_row([p.radius for p in pulleys])
        ropes.wheel_fixed = buffers.ints([int(p.fixed_wheel) for p in pulleys])
        met = [self._times_met(k, ends, carriers) for k in range(count)]
        shares = [[met[k].get(e["body"], 1) for e in pair] for k, pair in enumerate(ends)]
        ropes.end_share = buffers.array(np.array(shares, dtype=float), wp.float64)
        owners = [k for k, thread in enumerate(self.threads) for _ in thread.pulleys]
        ropes.wheel_share = float_row([met[k].get(b, 1) for k, b in zip(owners, carriers, strict=True)])
        return ropes

    def _ends(self, rope: Rope, thread: Threading, indices: Mapping[str, int]) -> list[dict[str, Any]]:
        """List what holds the start and the end of a rope, as far as this stage solves it."""
        found: list[dict[str, Any]] = []
        for name, node, towards in (("start", 0, 1), ("end", -1, -2)):
            point = thread.nodes[node]
            direction = thread.nodes[towards] - point
            direction = direction / np.linalg.norm(direction) * (1.0 if name == "start" else -1.0)
            row: dict[str, Any] = {
                "body": NO_BODY,
                "anchor": np.zeros(3),
                "clamped": 0,
                "direction": direction,
                "director": across(direction),
                "held": (direction, across(direction)),
                "release": np.inf,
                "strength": np.inf,
            }
            for attachment in self.world.attachments:
                if attachment.object != rope.name or attachment.end != name:
                    continue
                row["clamped"] = max(row["clamped"], int(attachment.clamped and self._clamps(attachment, indices)))
                if attachment.to in indices:
                    row["body"] = indices[attachment.to]
                    row["anchor"] = self._into_axes(attachment.to, point)
                    for vector in ("direction", "director"):
                        row[vector] = self._rotate_into(attachment.to, row[vector])
                    row["release"] = np.inf if attachment.release is None else attachment.release
                    row["strength"] = np.inf if attachment.strength is None else attachment.strength
            found.append(row)
        return found

    def _clamps(self, attachment: Attachment, indices: Mapping[str, int]) -> bool:
        if attachment.to is not None and attachment.to not in indices:
            raise ValueError(
                f"attachment {attachment.name!r}: clamped holds a rope's direction to the world or to a rigid object, "
                f"not to {attachment.to!r}; rigid objects: {sorted(indices)}"
            )
        return True

    def _into_axes(self, name: str, point: Array) -> Array:
        return self._rotate_into(name, point - np.asarray(self.world.object(name).position))

    def _rotate_into(self, name: str, vector: Array) -> Array:
        orientation = geometry.quaternion_matrix(np.asarray(self.world.object(name).orientation))
        local: Array = orientation.T @ vector
        return local

    def _times_met(self, k: int, ends: list[list[dict[str, Any]]], carriers: list[int]) -> dict[int, int]:
        """Count the links' ends of a rope at each body and at those that joints hold together with it."""
        first = sum(len(t.pulleys) for t in self.threads[:k])
        bodies = [e["body"] for e in ends[k]] + carriers[first : first + len(self.threads[k].pulleys)]
        held = [int(self._group[b]) for b in bodies if b != NO_BODY]
        return {b: held.count(int(self._group[b])) for b in bodies if b != NO_BODY}

    def _shares_bodies(self) -> bool:
        bodies = [int(b) for b in buffers.read(self._ropes.end_body).ravel()] + [
            int(b) for b in buffers.read(self._ropes.wheel_body)
        ]
        held = [int(self._group[b]) for b in bodies if b != NO_BODY]
        return len(set(held)) < len(held)

    def _allocate(self) -> Any:
        w, n = self.n_worlds, len(self.items)
        links = sum(len(t.rest) for t in self.threads)
        pulleys = sum(len(t.pulleys) for t in self.threads)
        state = RopeState()
        state.bodies = buffers.zeros((1, 1), Body)
        state.order = buffers.zeros((w, links + n), wp.int32)
        state.need = buffers.zeros((w,), wp.float64)
        state.least_steps = buffers.zeros((w,), wp.int32)
        state.elements = buffers.zeros((w, n), wp.int32)
        state.attached = buffers.zeros((w, n, 2), wp.int32)
        state.held = buffers.zeros((w, links), wp.int32)
        state.direction = buffers.zeros((w, links), wp.vec3d)
        state.reference = buffers.zeros((w, links), wp.vec3d)
        state.heading = buffers.zeros((w, links), wp.vec3d)
        state.before = buffers.zeros((w, n), wp.float64)
        state.twist = buffers.zeros((w, n), wp.float64)
        state.wheels = buffers.zeros((w, pulleys), Wheel)
        state.end_mobility = buffers.zeros((w, n, 2), wp.mat33d)
        state.end_kept = buffers.zeros((w, n, 2), wp.vec3d)
        state.end_lag = buffers.zeros((w, n, 2), wp.vec3d)
        state.end_split = buffers.zeros((w, n, 2), wp.mat33d)
        for name in (
            "rest",
            "tension",
            "elongation",
            "compliance",
            "target",
            "diagonal",
            "coupled",
            "right",
            "forward",
            "change",
            "theta",
            "reference_twist",
            "mean_tension",
        ):
            setattr(state, name, buffers.zeros((w, links), wp.float64))
        return state

    # --- one run -------------------------------------------------------------------------------

    def write(self, fields: Fields) -> bool:
        """See `MaterialStage.write`."""
        self._fields = fields
        for rope, thread in zip(self.items, self.threads, strict=True):
            if thread.pulleys and rope.curved_at_rest:
                raise ValueError(
                    f"rope {rope.name!r} runs over pulleys and cannot be curved_at_rest: give it curved_at_rest false"
                )
            if thread.pulleys and np.any(fields[rope.name]["twist_stiffness"] > 0.0):
                raise ValueError(
                    f"rope {rope.name!r} runs over pulleys: twist is not computed for it; give twist_stiffness 0"
                )
        names = tuple(r.name for r in self.items)
        pulleys = tuple(p.name for thread in self.threads for p in thread.pulleys)
        rows = {name: parameter_row(fields, names, name) for name in ROPE_FIELDS}
        rows.update({ours: parameter_row(fields, pulleys, theirs) for ours, theirs in WHEEL_FIELDS.items()})
        reallocated = False
        for name, values in rows.items():
            kept = getattr(self._ropes, name)
            if kept is not None and kept.shape == values.shape:
                buffers.write(kept, buffers.read(values))
            else:
                setattr(self._ropes, name, values)
                reallocated = True
        return reallocated

    def reset(self) -> None:
        """See `MaterialStage.reset`."""
        s = self._state
        buffers.write(s.order, np.concatenate([t.order for t in self.threads]))
        buffers.write(s.elements, [len(t.order) for t in self.threads])
        buffers.write(s.rest, np.concatenate([t.rest for t in self.threads]))
        buffers.write(s.attached, buffers.read(self._ropes.end_body) >= 0)
        buffers.write(s.elongation, np.nan)
        buffers.write(s.heading, np.concatenate([headings for headings, _ in self._frames]))
        buffers.write(s.reference, np.concatenate([frames for _, frames in self._frames]))
        for name in ("tension", "mean_tension", "held", "change", "theta", "reference_twist", "direction", "end_kept"):
            buffers.write(getattr(s, name), 0)
        buffers.write(s.twist, buffers.read(self._ropes.twist_at_start))
        buffers.write(s.before, 1.0)
        buffers.write(s.least_steps, 0)
        buffers.write(s.need, 0.0)
        if s.wheels.shape[1] > 0:
            rows = np.zeros(s.wheels.shape, dtype=Wheel.numpy_dtype())
            at = 0
            for thread in self.threads:
                for p, pulley in enumerate(thread.pulleys):
                    rows["index"][:, at] = int(np.flatnonzero(thread.order == -1 - p)[0])
                    rows["wrap"][:, at] = thread.wrap[p]
                    slides = pulley.fixed_wheel or pulley.radius == 0.0
                    resists = self._fields[pulley.name]["friction" if slides else "bearing_friction"] > 0.0
                    rows["mode"][:, at] = np.where(resists, 0, 1)
                    at += 1
            buffers.assign(s.wheels, rows)

    def stable_step(self) -> Array:
        """See `MaterialStage.stable_step`.

        Waves across the rope and bending waves are explicit: of the shortest wave, omega^2 = 16 EI/(rho l^4) +
        4 T/(rho l^2). T is that of the loads at rest and of the stretch at the start; where it grows, the stage takes
        more inner steps (`pace`).
        """
        steps = [np.full(1, np.inf)]
        for rope, thread in zip(self.items, self.threads, strict=True):
            bending, swing = self._squares(rope, thread)
            omega = np.sqrt(np.maximum(bending + swing, 1e-12))
            zeta = 0.5 * self._fields[rope.name]["bending_damping"] * bending / omega
            steps.append(SAFETY * 2.0 / omega * (np.sqrt(1.0 + zeta**2) - zeta))
        size = max(len(s) for s in steps)
        shortest: Array = np.min([np.broadcast_to(s, (size,)) for s in steps], axis=0)
        return shortest

    def _squares(self, rope: Rope, thread: Threading) -> tuple[Array, Array]:
        """Squares (1,) or (W,) of the highest angular frequencies of bending and of swing under tension [1/s^2]."""
        f = self._fields[rope.name]
        density, cell = f["linear_density"], thread.segment_length
        tension = self._first_tension(rope, thread, f)
        return 16.0 * f["bending_stiffness"] / (density * cell**4), 4.0 * tension / (density * cell**2)

    def needs(self) -> list[Need]:
        """See `MaterialStage.needs`."""
        found = []
        for rope, thread in zip(self.items, self.threads, strict=True):
            squares = [float(np.max(s)) for s in self._squares(rope, thread)]
            step = SAFETY * 2.0 / np.sqrt(max(sum(squares), 1e-12))
            stiff = squares[0] > squares[1]
            motion = "bending" if stiff else "swing under tension"
            longer = step * (4.0 if stiff else 2.0)
            cure = f"with {max(rope.segments // 2, 1)} segments instead of {rope.segments} {longer:.2g} s"
            why = f"rope {rope.name!r}: {motion} of its {thread.segment_length:.2g} m segments"
            found.append(Need(float(step), why, cure))
        return found

    def _first_tension(self, rope: Rope, thread: Threading, f: Mapping[str, Array]) -> Array:
        """Tension to reckon with at the start [N]: its stretch, the weight of the loads and of itself, their snatch.

        A load of mass M that a slack rope stops from the speed v makes v sqrt(M EA/L).
        """
        gravity = float(np.linalg.norm(self.world.environment.gravity))
        load = sum(mass_of(self.world, name) for name in self._loads(rope))
        length = float(thread.rest.sum())
        weight = SWING * (load + f["linear_density"] * length) * gravity
        chord = np.linalg.norm(np.diff(thread.nodes, axis=0), axis=1).mean()
        strain = thread.stretch - 1.0 if thread.pulleys else max(float(chord) / thread.segment_length - 1.0, 0.0)
        slack = 0.0 if thread.pulleys else max((thread.segment_length - float(chord)) * rope.segments, 0.0)
        speeds = [np.linalg.norm(self.world.object(name).velocity) for name in self._loads(rope)]
        square = max(speeds, default=0.0) ** 2 + 2.0 * gravity * slack
        snatch = np.sqrt(square * load * f["stretch_stiffness"] / length)
        tension: Array = np.atleast_1d(weight + snatch + f["stretch_stiffness"] * strain)
        return tension

    def _loads(self, rope: Rope) -> set[str]:
        """Rigid objects that the rope holds."""
        rigid = {o.name for o in self.world.objects}
        held = {a.to for a in self.world.attachments if a.object == rope.name and a.to in rigid}
        return {str(name) for name in held} | {
            p.object for p in self.world.pulleys if p.rope == rope.name and p.object is not None
        }

    # --- the loop --------------------------------------------------------------------------------

    def launch_begin(self, nodes: Nodes, clock: Clock) -> None:
        """See `Paced.launch_begin`."""
        buffers.launch(pace.choose_inner_steps, self.n_worlds, [clock, nodes, self._ropes, self._state])

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """See `MaterialStage.launch_forces`."""
        self._launch(hold_ends, nodes, clock)
        self._launch(bending.bend, nodes, clock)
        if self._clamped:
            self._launch(bending.bend_clamped_ends, nodes, clock)
        if any(rope.curved_at_rest for rope in self.items):
            self._launch(curve.bend_curved, nodes, clock)
        if self._twists:
            self._launch(twist.twist, nodes, clock)

    def launch_velocities(self, nodes: Nodes, clock: Clock) -> None:
        """See `MaterialStage.launch_velocities`."""
        self._launch(stretch.prepare_links, nodes, clock)
        for _ in range(self._sweeps):
            self._launch(stretch.solve_tensions, nodes, clock)

    def launch_positions(self, nodes: Nodes, clock: Clock) -> None:
        """See `MaterialStage.launch_positions`."""
        averaged = [self._state.tension, self._state.mean_tension]
        buffers.launch(tensions.average_tensions, self._state.tension.shape, [clock, *averaged])
        if self._state.wheels.shape[1] > 0:
            self._launch(passing.pass_wheels, nodes, clock)

    def quantities(self, nodes: Nodes) -> dict[str, dict[str, Array]]:
        """{rope: {"tension": (W, segments), "curvature": (W, segments - 1)}}.

        Tension of each segment, positive in pull [N], the mean over the last coupling step; a segment that runs over
        wheels has the mean of its parts' tensions. Curvature at the inner nodes, 2 tan(phi/2)/l [1/m].
        """
        found: dict[str, dict[str, Array]] = {}
        tension, order = buffers.read(self._state.mean_tension), buffers.read(self._state.order)
        elements = buffers.read(self._state.elements)
        first = buffers.read(self._ropes.first_link)
        for r, (rope, thread) in enumerate(zip(self.items, self.threads, strict=True)):
            values = np.zeros((self.n_worlds, rope.segments))
            if not thread.pulleys:
                values[:] = tension[:, first[r] : first[r] + rope.segments]
            else:
                for w in range(self.n_worlds):
                    passed = order[w, first[r] + r : first[r] + r + elements[w, r]]
                    segment = np.maximum.accumulate(passed)[:-1]
                    links = tension[w, first[r] : first[r] + elements[w, r] - 1]
                    total = np.bincount(segment, weights=links, minlength=rope.segments)
                    values[w] = total / np.maximum(np.bincount(segment, minlength=rope.segments), 1)
            begin = int(buffers.read(self._ropes.first_node)[r])
            points = buffers.read(nodes.x)[:, begin : begin + len(thread.nodes)]
            found[rope.name] = {"tension": values, "curvature": chain_curvature(points, thread.segment_length)}
        return found

    @property
    def links(self) -> tuple[Any, Any]:
        """The ropes' `layout.Ropes` and `layout.RopeState`, for what holds their nodes."""
        return self._ropes, self._state

    def _launch(self, kernel: Any, nodes: Nodes, clock: Clock) -> None:
        inputs = [clock, nodes, self._ropes, self._state]
        buffers.launch(kernel, (self.n_worlds, len(self.items)), inputs)
