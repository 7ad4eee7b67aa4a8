"""Classify the motion of each object at each measured instant: flying, touching, sliding, rolling, resting, just
hit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.readout import owner
from polyworld.gap.fitting import Fitted
from polyworld.solver.rollout import simulator
from polyworld.trajectory import Event
from polyworld.trajectory.events import REST_SPEED, REST_SPIN
from polyworld.world import World
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

AFTER = 0.1  # [s] that count as just after a collision
LASTING = 0.05  # [s] from which on a contact is more than a collision
GRIP = 0.05  # slip over speed, below which a ball rolls


@dataclass(frozen=True)
class Motion:
    """One recorded name in one run: positions (T, 3), speeds (T,) and phases (T,), as the fitted world has them."""

    positions: Array
    speeds: Array
    phases: Texts


def motions(fitted: Fitted, index: int) -> dict[str, Motion]:
    """Return how the fitted world moves in one run, by recorded name."""
    run, block = fitted.ground.recording.runs[index], fitted.problem.runs[index][0]
    values = block.overrides(fitted.values[None], fitted.of_states()[index][None])
    times = run.times - run.times[0] + run.lead
    rolled = simulator(block.world, times, n_worlds=1, record_events=True, threads=1)
    batch = rolled.run({p: v for p, v in values.items() if not p.startswith("observer.")} or None)
    trajectory = batch.world(0)
    rows = np.minimum(np.arange(len(times)), len(trajectory.times) - 1)  # beyond a divergence the last state stays
    found = {}
    for name in run.names:
        i = trajectory.index(owner(name))
        velocity, spin = trajectory.velocities[rows, i], trajectory.angular_velocities[rows, i]
        phases = _phases(block.world, owner(name), times, velocity, spin, batch.events[0])
        found[name] = Motion(trajectory.positions[rows, i], np.linalg.norm(velocity, axis=1), phases)
    return found


def _phases(world: World, name: str, times: Array, velocity: Array, spin: Array, events: Sequence[Event]) -> Texts:
    speed = np.linalg.norm(velocity, axis=1)
    slow = (speed < REST_SPEED) & (np.linalg.norm(spin, axis=1) < REST_SPIN)
    contacts = _contacts(name, events, float(times[-1]))
    touching = np.zeros(len(times), dtype=bool)
    for begin, end in contacts:
        if end - begin >= LASTING:
            touching |= (times >= begin) & (times <= end)
    if world.planar:  # it slides over the plane of motion
        phases = np.full(len(times), "sliding", dtype="U24")
    else:
        phases = np.where(touching, _in_contact(world, name, velocity, spin, speed), "free").astype("U24")
    for begin, _ in contacts:
        phases[(times > begin) & (times <= begin + AFTER) & ~touching] = "just after a collision"
    phases[slow & (touching | world.planar)] = "at rest"
    return phases


def _in_contact(world: World, name: str, velocity: Array, spin: Array, speed: Array) -> Texts:
    """Return whether a ball slides or rolls; any other body touches."""
    shape = getattr(world.item(name), "shape", None)
    if not isinstance(shape, Sphere):
        return np.full(len(speed), "touching", dtype="U24")
    up = -np.asarray(world.environment.gravity)
    up = up / max(float(np.linalg.norm(up)), 1e-12)
    slip = velocity - np.cross(spin, shape.radius * up)
    slip = slip - (slip @ up)[:, None] * up
    rolls = np.linalg.norm(slip, axis=1) < GRIP * np.maximum(speed, REST_SPEED)
    return np.where(rolls, "rolling", "sliding").astype("U24")


def _contacts(name: str, events: Sequence[Event], last: float) -> list[tuple[float, float]]:
    """Return begin and end [s] of every contact of an object."""
    found: list[tuple[float, float]] = []
    open_since: dict[tuple[str, ...], float] = {}
    for e in events:
        if name not in e.participants:
            continue
        if e.kind == "contact_begin":
            open_since[e.participants] = e.time
        elif e.kind == "contact_end" and e.participants in open_since:
            found.append((open_since.pop(e.participants), e.time))
    return found + [(begin, last) for begin in open_since.values()]
