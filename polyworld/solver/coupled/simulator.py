"""W variants of one world with deformable objects, spread over threads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context

import numpy as np
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.core.cores import available_cores
from polyworld.model import Model
from polyworld.model.arrays import RigidArrays
from polyworld.solver.core.patience import Watch
from polyworld.solver.core.time_table import time_table
from polyworld.solver.coupled.centres import centre_motion
from polyworld.solver.coupled.fields import deformable_fields, split_overrides
from polyworld.solver.coupled.needs import slowest_part
from polyworld.solver.coupled.nodes import Fields
from polyworld.solver.coupled.record import Record
from polyworld.solver.coupled.room import Restart
from polyworld.solver.coupled.shard import Shard
from polyworld.trajectory import BatchTrajectory, PointMotion

Array = NDArray[np.float64]


class CoupledSimulator:
    """See `polyworld.solver.rollout.simulator`. Each thread runs a shard of the worlds; they share nothing.

    Liquids, with rigid bodies, run on the device in use. Worlds with ropes, cloth or soft bodies run on the CPU:
    contacts of nodes are gathered by kernels that rely on its threads coming one after the other.
    """

    def __init__(
        self,
        model: Model,
        sample_times: Array,
        *,
        n_worlds: int = 1,
        record_events: bool = False,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
        patience: float = math.inf,
    ) -> None:
        self.world = world = model.world
        self.progress, self.patience = progress, patience
        self.names = world.moving_names
        self.n_worlds = n_worlds
        self.sample_times = np.asarray(sample_times, dtype=float)
        self._table = time_table(world, self.sample_times)
        self._model = model
        self._meshes = self._model.meshes
        with buffers.on_cpu():  # sums of many threads at once would not repeat to the bit
            count = min(n_worlds, threads or available_cores()) if buffers.threads_serve() else 1
            edges = np.linspace(0, n_worlds, count + 1).astype(int)
            self._spans = [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
            self._shards = [Shard(model, self._table, s.stop - s.start, record_events) for s in self._spans]

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """Roll all variants out from their initial state, to the first `samples` sample times."""
        with buffers.on_cpu():
            return self._run(overrides, samples)

    def slowest_part(self) -> str:
        """See `polyworld.solver.rollout.Simulator`."""
        return slowest_part(self._shards[0])

    def _run(self, overrides: Mapping[str, Array] | None, samples: int | None) -> BatchTrajectory:
        count = len(self.sample_times) if samples is None else samples
        if not 1 <= count <= len(self.sample_times):
            raise ValueError(f"samples must lie in 1..{len(self.sample_times)}, got {samples}")
        lengths = {len(np.atleast_1d(v)) for v in (overrides or {}).values()}
        if lengths - {self.n_worlds}:
            raise ValueError(f"overrides must hold {self.n_worlds} values, one a world; got {sorted(lengths)}")
        rigid, soft = split_overrides(self.world, overrides)
        arrays = self._model.arrays(rigid)
        fields = deformable_fields(self.world, soft)
        segments = int(np.flatnonzero(self._table.sample == count - 1)[0]) + 1

        def begin(number: int) -> Record:
            shard, span = self._shards[number], self._spans[number]
            shard.write(_rows(arrays, span), _field_rows(fields, span))
            shard.prepare()
            return Record(shard, count)

        records = [begin(number) for number in range(len(self._shards))]

        done = np.concatenate([[0], np.cumsum(self._table.steps[:segments])])
        horizon = float(self.sample_times[count - 1])

        def run_once(number: int) -> None:
            record = records[number]
            watch = Watch(self.patience, horizon, lambda: slowest_part(record.shard))
            for segment in range(segments):
                if self.progress is not None and number == 0:
                    self.progress(float(done[segment] / max(done[-1], 1)))
                record.shard.advance(segment, lambda steps, at=done[segment]: watch.used_up((at + steps) / done[-1]))
                if self._table.sample[segment] >= 0:
                    record.take(int(self._table.sample[segment]))

        def run(number: int) -> None:
            while True:
                try:
                    return run_once(number)
                except Restart:
                    records[number] = begin(number)

        if len(records) == 1:
            run(0)
        else:
            contexts = [copy_context() for _ in records]  # what may interrupt this thread may interrupt the others
            with ThreadPoolExecutor(len(records)) as pool:
                list(pool.map(lambda context, number: context.run(run, number), contexts, range(len(records))))
        return self._assemble(records, arrays, count)

    def _assemble(self, records: list[Record], arrays: RigidArrays, count: int) -> BatchTrajectory:
        times = np.broadcast_to(self.sample_times[None, :count] * arrays.time_scale, (self.n_worlds, count)).copy()
        rigid = [np.concatenate([r.rigid[k] for r in records]) for k in range(4)]
        diverged_time = np.concatenate([r.divergence()[0] for r in records])
        diverged_object = np.concatenate([r.divergence()[1] for r in records])
        diverged_element = np.concatenate([r.divergence()[2] for r in records])
        diverged = diverged_object >= 0
        deformables: dict[str, PointMotion] = {}
        columns = [rigid]
        for item in self.world.deformables:
            points = _joined([r.points[item.name] for r in records])
            velocities = _joined([r.velocities[item.name] for r in records])
            quantities = {
                name: _joined([r.quantities[item.name][name] for r in records])
                for name in records[0].quantities.get(item.name, {})
            }
            deformables[item.name] = PointMotion(points, velocities, quantities)
            mesh = self._meshes[item.name]
            is_fluid = self._model.materials[item.name].form == "liquid"
            mass = np.ones(points.shape[2]) if is_fluid else mesh.measure
            centre = centre_motion(points, velocities, mass, None if is_fluid else mesh.nodes)
            columns.append([c[:, :, None] for c in centre])
        motion = [np.concatenate([c[k] for c in columns], axis=2) for k in range(4)]
        truncated = {
            span.start + w: end
            for span, record in zip(self._spans, records, strict=True)
            for w, end in sorted(record.shard.truncated.items())
        }
        ends = diverged_time.copy()
        for w, end in truncated.items():
            ends[w] = end.time
        for w in np.flatnonzero(np.isfinite(ends)):
            gone = times[w] >= ends[w] * (1 - 1e-12)
            for values in motion:
                values[w, gone] = np.nan
        starts = np.array([getattr(o, "start_time", 0.0) for o in (*self.world.objects, *self.world.deformables)])
        events = [e for r in records for e in r.events(times)]
        return BatchTrajectory(
            names=self.names,
            times=times,
            positions=motion[0],
            orientations=motion[1],
            velocities=motion[2],
            angular_velocities=motion[3],
            active=self.sample_times[:count, None] >= starts[None, :],
            diverged=diverged,
            diverged_time=diverged_time,
            diverged_object=diverged_object,
            diverged_element=diverged_element,
            events=tuple(events),
            deformables=deformables,
            truncated=truncated,
            contacts_until=tuple(t for r in records for t in r.contacts_until()),
        )


def _joined(parts: list[Array]) -> Array:
    """Arrays (W, T, k, ...) one after the other; k is made the largest with NaN, as shards whose emitters run at other
    rates have room for other numbers of particles."""
    most = max(p.shape[2] for p in parts)
    padded = [
        np.pad(p, [(0, most - n if a == 2 else 0) for a, n in enumerate(p.shape)], constant_values=np.nan)
        for p in parts
    ]
    return np.concatenate(padded)


def _rows(arrays: RigidArrays, span: slice) -> RigidArrays:
    """Return the fields of some of the worlds: shared rows stay, others are cut."""
    fixed = {"effect_kind", "effect_acts", "effect_programs"}
    return RigidArrays(**{k: v if k in fixed or v.shape[0] == 1 else v[span].copy() for k, v in vars(arrays).items()})


def _field_rows(fields: Fields, span: slice) -> Fields:
    return {n: {p: v if len(v) == 1 else v[span].copy() for p, v in ps.items()} for n, ps in fields.items()}
