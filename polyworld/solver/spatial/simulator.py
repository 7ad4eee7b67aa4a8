"""W variants of one spatial world, run in one kernel launch per share of the worlds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.solver.arrays import RigidArrays, rigid_arrays
from polyworld.solver.spatial import layout
from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.scene import build_geometry
from polyworld.solver.spatial.step import roll_out
from polyworld.solver.time_table import time_table
from polyworld.trajectory import BatchTrajectory, Event
from polyworld.world import World

Array = NDArray[np.float64]

MERGE = 0.05  # a contact that opens for less than this goes on: rattling is one contact [s]
EPISODES = 1024  # contact episodes kept for a world; more is an error, not a silence
MESH_TRIANGLES = 24  # triangles of a mesh that one body is taken to touch at once, at most


class SpatialSimulator:
    """See `polyworld.rollout.simulator`. Buffers are allocated once and written in place on every run."""

    def __init__(
        self,
        world: World,
        sample_times: Array,
        *,
        n_worlds: int = 1,
        record_events: bool = False,
        threads: int | None = None,
    ) -> None:
        self.world = world
        self.names = tuple(o.name for o in world.objects)
        self.n_worlds = n_worlds
        self.sample_times = np.asarray(sample_times, dtype=float)
        self.record_events = record_events
        self.threads = threads or len(os.sched_getaffinity(0))
        self._all_names = self.names + tuple(s.name for s in world.statics)
        self._geometry, self._trees = build_geometry(world)
        self._table = time_table(world, self.sample_times)
        self._schedule = layout.Schedule()
        for name, dtype in (("end", wp.float64), ("steps", wp.int32), ("sample", wp.int32), ("joins", wp.int32)):
            setattr(self._schedule, name, wp.array(getattr(self._table, name), dtype=dtype, device="cpu"))
        # More launches than threads, so that a thread whose worlds are quick takes over from one whose are not.
        self._pieces = min(n_worlds, 1 if self.threads == 1 else 4 * self.threads)
        self._parameters: Any = None
        self._state: Any
        self._samples: Any
        self._log: Any
        self._allocate()

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """Roll all variants out from their initial state, to the first `samples` sample times."""
        count = len(self.sample_times) if samples is None else samples
        if not 1 <= count <= len(self.sample_times):
            raise ValueError(f"samples must lie in 1..{len(self.sample_times)}, got {samples}")
        lengths = {len(np.atleast_1d(v)) for v in (overrides or {}).values()}
        if lengths - {self.n_worlds}:
            raise ValueError(f"overrides must hold {self.n_worlds} values, one a world; got {sorted(lengths)}")
        arrays = rigid_arrays(self.world, overrides)
        self._write(arrays)
        self._launch(int(np.flatnonzero(self._table.sample == count - 1)[0]) + 1)
        return self._read(arrays, count)

    def _allocate(self) -> None:
        w, n, s = self.n_worlds, len(self.names), len(self.world.statics)
        k = self._pieces
        meshes = sum(static.shape.kind == "triangle_mesh" for static in self.world.statics)
        pairs = n * (n - 1) // 2 + n * (s - meshes) + n * meshes * MESH_TRIANGLES
        # Round bodies of similar size touch six others on average; twice that leaves room for overlaps.
        manifolds = max(1, min(pairs, 12 * n + n * s + n * meshes * MESH_TRIANGLES))
        contacts = layout.MAX_MANIFOLD_POINTS * (manifolds + 1)
        state = layout.State()
        state.bodies = _zeros((k, n + s), layout.Body)
        state.manifolds = _zeros((k, 2 * manifolds), layout.Manifold)
        state.contacts = _zeros((k, 2 * contacts), layout.Contact)
        state.rows = _zeros((k, ROWS * contacts), layout.Row)
        state.scratch = _zeros((k, 2 * layout.MAX_MANIFOLD_POINTS + 3 * layout.MAX_CLIPPED_POINTS), wp.vec3d)
        state.manifold_count = _zeros((k, 2), wp.int32)
        state.contact_count = _zeros((k, 2), wp.int32)
        state.crowded = _zeros((k,), wp.int32)
        state.objects, state.statics = n, s
        state.max_manifolds, state.max_contacts = manifolds, contacts
        samples = layout.Samples()
        shape = (w, len(self.sample_times), n)
        samples.position = _zeros(shape, wp.vec3d)
        samples.orientation = _zeros(shape, wp.quatd)
        samples.velocity = _zeros(shape, wp.vec3d)
        samples.angular_velocity = _zeros(shape, wp.vec3d)
        samples.diverged_object = _zeros((w,), wp.int32)
        samples.diverged_time = _zeros((w,), wp.float64)
        samples.crowded = _zeros((w,), wp.int32)
        log = layout.Log()
        log.record = int(self.record_events)
        log.merge = MERGE
        log.episodes = _zeros((w, EPISODES if self.record_events else 1), layout.Episode)
        log.count = _zeros((w,), wp.int32)
        log.open = _zeros((w, n, n + s) if self.record_events else (1, 1, 1), wp.int32)
        self._state, self._samples, self._log = state, samples, log

    def _write(self, arrays: RigidArrays) -> None:
        """Copy the parameters into the kernel's arrays, which are made anew only where a field changes its rows."""
        p = self._parameters or layout.Parameters()
        for name, dtype in PARAMETER_TYPES.items():
            values = getattr(arrays, name)
            if name == "orientation":
                values = np.roll(values, -1, axis=-1)
            if name == "time_scale":
                values = values[:, 0]
            kept = None if self._parameters is None else getattr(p, name)
            if kept is not None and kept.numpy().shape == values.shape:
                kept.numpy()[:] = values
            else:
                setattr(p, name, wp.array(values, dtype=dtype, device="cpu"))
        self._parameters = p
        for field in ("position", "orientation", "velocity", "angular_velocity"):
            getattr(self._samples, field).numpy()[:] = np.nan
        self._samples.diverged_object.numpy()[:] = -1
        self._samples.diverged_time.numpy()[:] = np.nan
        self._samples.crowded.numpy()[:] = 0
        self._log.open.numpy()[:] = -1
        self._log.count.numpy()[:] = 0

    def _launch(self, segments: int) -> None:
        if not self.names:
            return
        edges = np.linspace(0, self.n_worlds, self._pieces + 1).astype(int)

        def piece(index: int) -> None:
            first, last = int(edges[index]), int(edges[index + 1])
            wp.launch(
                roll_out,
                dim=last - first,
                inputs=[
                    self._geometry,
                    self._parameters,
                    self._schedule,
                    self._state,
                    self._samples,
                    self._log,
                    first,
                    index,
                    segments,
                ],
                device="cpu",
            )

        roll_out.module.load("cpu", block_dim=1)  # before the threads ask for it
        if self._pieces == 1:
            piece(0)
            return
        with ThreadPoolExecutor(min(self.threads, self._pieces)) as pool:
            list(pool.map(piece, range(self._pieces)))

    def _read(self, arrays: RigidArrays, count: int) -> BatchTrajectory:
        out = self._samples
        crowded = out.crowded.numpy()
        if crowded.any():
            raise RuntimeError(
                f"{np.count_nonzero(crowded)} of {self.n_worlds} worlds had more than "
                f"{self._state.max_manifolds} pairs in contact at once: the objects overlap too much, "
                "or a mesh is too fine for the objects on it"
            )
        diverged = out.diverged_object.numpy() >= 0
        starts = np.array([o.start_time for o in self.world.objects])
        times = np.broadcast_to(self.sample_times[None, :count] * arrays.time_scale, (self.n_worlds, count)).copy()
        return BatchTrajectory(
            names=self.names,
            times=times,
            positions=out.position.numpy()[:, :count].copy(),
            orientations=np.roll(out.orientation.numpy()[:, :count], 1, axis=-1),
            velocities=out.velocity.numpy()[:, :count].copy(),
            angular_velocities=out.angular_velocity.numpy()[:, :count].copy(),
            active=self.sample_times[:count, None] >= starts[None, :],
            diverged=diverged,
            diverged_time=out.diverged_time.numpy().copy(),
            diverged_object=out.diverged_object.numpy().astype(np.int64),
            events=tuple(self._events(w, float(times[w, -1])) for w in range(self.n_worlds)),
        )

    def _events(self, w: int, end: float) -> tuple[Event, ...]:
        """Contact events of one world in order of time."""
        if not self.record_events:
            return ()
        count = int(self._log.count.numpy()[w])
        if count > EPISODES:
            raise RuntimeError(f"{count} contacts began; room for {EPISODES}: shorten the horizon")
        events = []
        for e in self._log.episodes.numpy()[w, :count]:
            names = tuple(sorted((self._all_names[e["a"]], self._all_names[e["b"]])))
            x, y, z = (float(v) for v in e["position"])
            begin, last = float(e["begin"]), float(e["last"])
            events.append(Event("contact_begin", begin, names, (x, y, z), float(e["first_impulse"]), float(e["speed"])))
            if last < end - 2.0 * self.world.time.substep:
                events.append(Event("contact_end", last, names, None, float(e["impulse"])))
        return tuple(sorted(events, key=lambda e: (e.time, e.participants, e.kind)))


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
    "static_friction": wp.float64,
    "static_restitution": wp.float64,
    "gravity": wp.vec3d,
    "time_scale": wp.float64,
    "effect_parameters": wp.float64,
    "effect_kind": wp.int32,
    "effect_acts": wp.int32,
}


def _zeros(shape: tuple[int, ...], dtype: Any) -> Any:
    return wp.zeros(shape, dtype=dtype, device="cpu")
