"""Roll out settings of many blocks together: equal worlds share one simulator, whatever their initial states."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.rollout import ScheduledSimulator, Simulator, scheduled_simulator, simulator
from polyworld.solver.work import points_of
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from polyworld.world.parameter_tables import ParameterSpec
from polyworld.world.parameters import parameter_paths, read_parameter

Array = NDArray[np.float64]

MOST_BYTES = 500_000_000  # of the motion that one batch of rollouts keeps
BYTES_OF_BODY, BYTES_OF_POINT = 104, 48  # pose and rates, and position and velocity, of one sample
KEPT = 64  # simulators: as many as one step of a search compares
ROOM = 1.5  # times as many worlds as are asked for, that a simulator is made for
STATE_FIELDS = ("position", "velocity", "angular_velocity")


@dataclass(frozen=True)
class Seat:
    """Where a block is simulated. constants: parameters in which its world differs from the machine's."""

    machine: Machine
    slot: int
    constants: Mapping[str, float]
    world: World


@dataclass(frozen=True)
class Job:
    """Settings (k) of one block: parameters by path (k,), how many samples to reach, and the observer's parameters."""

    seat: Seat
    overrides: Mapping[str, Array]
    count: int
    samples: int
    observed: Mapping[str, Array] = field(default_factory=dict)


@dataclass
class Machine:
    """Simulators of one world, with lists of instants. alone: whether one list must do."""

    world: World
    alone: bool
    lists: list[Array] = field(default_factory=list)
    _scheduled: ScheduledSimulator | None = None
    _sized: dict[int, Simulator] = field(default_factory=dict)

    def roll(self, jobs: Sequence[Job]) -> list[BatchTrajectory]:
        """Return the motion of each job's worlds; chunks of as many worlds as may be kept."""
        most = most_worlds(self.world, max(self.lists, key=len))
        found: list[BatchTrajectory] = []
        waiting: list[Job] = []
        for job in jobs:
            if waiting and sum(j.count for j in waiting) + job.count > most:
                found += self._together(waiting)
                waiting = []
            waiting.append(job)
        return found + (self._together(waiting) if waiting else [])

    def _together(self, jobs: Sequence[Job]) -> list[BatchTrajectory]:
        total = sum(j.count for j in jobs)
        paths = dict.fromkeys(path for j in jobs for path in (*j.seat.constants, *j.overrides))
        values: dict[str, Array] = {}
        for path in paths:
            parts = []
            for j in jobs:
                own = j.overrides.get(path)
                if own is None:
                    value = j.seat.constants.get(path)
                    own = np.full(j.count, (read_parameter(j.seat.world, path) or 0.0) if value is None else value)
                parts.append(own)
            values[path] = np.concatenate(parts)
        if self.world.coupled:
            if total not in self._sized:
                self._sized = dict(list(self._sized.items())[-2:])
                self._sized[total] = simulator(self.world, self.lists[0], n_worlds=total)
            batch = self._sized[total].run(values, samples=max(j.samples for j in jobs))
        else:
            if self._scheduled is None or self._scheduled.n_worlds < total:
                times = np.full((len(self.lists), max(len(own) for own in self.lists)), np.nan)
                for row, own in zip(times, self.lists, strict=True):
                    row[: len(own)] = own
                self._scheduled = scheduled_simulator(self.world, times, n_worlds=int(ROOM * total) + 1)
            counts = [j.count for j in jobs]
            samples = np.repeat([j.samples for j in jobs], counts)
            schedule = np.repeat([j.seat.slot for j in jobs], counts)
            batch = self._scheduled.run(values, samples=samples, schedule=schedule)
        if len(jobs) == 1:
            return [batch]
        first = np.concatenate([[0], np.cumsum([j.count for j in jobs])])
        return [_rows(batch, slice(a, b)) for a, b in pairwise(first)]


class Machines:
    """Machines of one problem, or of several in turn: the last `KEPT` are kept. A block takes a seat in one."""

    def __init__(self) -> None:
        self._known: dict[str, Machine] = {}
        self._structures: dict[int, tuple[World, str]] = {}
        self._paths: dict[int, tuple[World, dict[str, ParameterSpec]]] = {}

    def paths(self, world: World) -> dict[str, ParameterSpec]:
        """Return every parameter path of a world with its specification."""
        if id(world) not in self._paths:
            self._paths[id(world)] = (world, parameter_paths(world))
        return self._paths[id(world)][1]

    def _structure_of(self, world: World) -> str:
        if id(world) not in self._structures:
            self._structures[id(world)] = (world, _structure(world))
        return self._structures[id(world)][1]

    def seat(self, world: World, times: Array) -> Seat:
        """Return a seat for a block with its world and instants (T,) [s]."""
        alone = world.coupled or any(o.start_time > 0.0 for o in world.objects)
        key = self._structure_of(world) + (times.tobytes().hex() if alone else "")
        machine = self._known[key] = self._known.pop(key) if key in self._known else Machine(world, alone)
        self._known = dict(list(self._known.items())[-KEPT:])
        constants: dict[str, float] = {}
        if machine.world is not world:
            for item, other in zip(world.objects, machine.world.objects, strict=True):
                for name in STATE_FIELDS:
                    pairs = zip("xyz", getattr(item, name), getattr(other, name), strict=True)
                    constants |= {f"objects.{item.name}.{name}.{a}": v for a, v, w in pairs if v != w}
            if world.time.origin != machine.world.time.origin:
                constants["time.origin"] = world.time.origin
        slot = next((i for i, own in enumerate(machine.lists) if np.array_equal(own, times)), len(machine.lists))
        if slot == len(machine.lists):
            machine.lists.append(times)
            machine._scheduled = None
        return Seat(machine, slot, constants, world)


def roll(jobs: Sequence[Job]) -> list[BatchTrajectory]:
    """Return the motion of every job, machines one after another."""
    by_machine: dict[int, list[int]] = {}
    for i, job in enumerate(jobs):
        by_machine.setdefault(id(job.seat.machine), []).append(i)
    found: dict[int, BatchTrajectory] = {}
    for members in by_machine.values():
        batches = jobs[members[0]].seat.machine.roll([jobs[i] for i in members])
        found |= dict(zip(members, batches, strict=True))
    return [found[i] for i in range(len(jobs))]


def most_worlds(world: World, times: Array) -> int:
    """Return of how many worlds one batch of rollouts may keep the motion: at least 1."""
    bytes_of_sample = BYTES_OF_BODY * len(world.moving_names)
    if world.deformables:  # particles of all liquids are kept with each of them
        copies = max(len(world.of_form("liquid")), 1)
        bytes_of_sample += BYTES_OF_POINT * sum(points_of(world, float(times[-1])).values()) * copies
    return max(MOST_BYTES // max(bytes_of_sample * len(times), 1), 1)


def _structure(world: World) -> str:
    """Return what worlds have in common that differ in initial positions and velocities of rigid bodies alone."""
    content = json.loads(world.canonical_json())
    for item in content["objects"]:
        for name in STATE_FIELDS:
            item[name] = None
    content["time"].pop("origin", None)
    return json.dumps(content, sort_keys=True)


def _rows(batch: BatchTrajectory, rows: slice) -> BatchTrajectory:
    return replace(
        batch,
        times=batch.times[rows],
        positions=batch.positions[rows],
        orientations=batch.orientations[rows],
        velocities=batch.velocities[rows],
        angular_velocities=batch.angular_velocities[rows],
        diverged=batch.diverged[rows],
        diverged_time=batch.diverged_time[rows],
        diverged_object=batch.diverged_object[rows],
        events=batch.events[rows],
        deformables={n: m.select(rows) for n, m in batch.deformables.items()},
        truncated={w - rows.start: t for w, t in batch.truncated.items() if rows.start <= w < rows.stop},
    )
