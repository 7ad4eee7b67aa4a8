"""Classify the motion of each object at each measured instant: flying, touching, sliding, rolling, resting, just
hit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import Design, RunDesign, owner
from polyworld.estimation.unknown import Unknown
from polyworld.gap.settings import LocaliseSettings
from polyworld.solver.rollout import simulator
from polyworld.trajectory import Event
from polyworld.trajectory.events import REST_SPEED, REST_SPIN
from polyworld.world import World
from polyworld.world.parameters import parameter_paths
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

FREE, TOUCHING, SLIDING, ROLLING, REST, HIT = (
    "free",
    "touching",
    "sliding",
    "rolling",
    "at rest",
    "just after a collision",
)


@dataclass(frozen=True)
class Motion:
    """One recorded name in one run: positions (T, 3), speeds (T,) and phases (T,), as the fitted world has them."""

    positions: Array
    speeds: Array
    phases: Texts


def motions(
    design: Design,
    run: RunDesign,
    values: Array,
    states: Array,
    unknowns: Sequence[Unknown] = (),
    settings: LocaliseSettings | None = None,
) -> dict[str, Motion]:
    """Simulate how the world moves in one run, by recorded name.

    values: of the unknowns, where there are any. states (N,): initial state of the run.
    """
    settings = settings or LocaliseSettings()
    world = run.world(design.world)
    known = {p for p in parameter_paths(world) if not p.startswith("observer.")}
    overrides = {
        path: np.array([v])
        for u, v in zip(unknowns, values, strict=False)
        for path in u.paths
        if path in known and u.is_of(run.run)
    }
    at, states_of = 0, dict[str, Array]()
    for coordinates in run.states:
        n = len(coordinates.labels)
        states_of |= coordinates.overrides(states[None, at : at + n], overrides)
        at += n
    batch = simulator(world, run.times, n_worlds=1, record_events=True, threads=1).run(overrides | states_of or None)
    trajectory = batch.world(0)
    count, length = len(trajectory.times), len(run.times)
    rows = np.minimum(np.arange(length), count - 1)  # beyond a divergence the last state stays
    found = {}
    for name in run.run.names:
        i = trajectory.index(owner(name))
        velocity, spin = trajectory.velocities[rows, i], trajectory.angular_velocities[rows, i]
        phases = _phases(world, owner(name), run.times, velocity, spin, batch.events[0], settings)
        found[name] = Motion(trajectory.positions[rows, i], np.linalg.norm(velocity, axis=1), phases)
    return found


def _phases(
    world: World,
    name: str,
    times: Array,
    velocity: Array,
    spin: Array,
    events: Sequence[Event],
    settings: LocaliseSettings,
) -> Texts:
    speed = np.linalg.norm(velocity, axis=1)
    slow = (speed < REST_SPEED) & (np.linalg.norm(spin, axis=1) < REST_SPIN)
    contacts = _contacts(name, events, float(times[-1]))
    touching = np.zeros(len(times), dtype=bool)
    for begin, end in contacts:
        if end - begin >= settings.lasting:
            touching |= (times >= begin) & (times <= end)
    if world.planar:  # it slides over the plane of motion
        phases = np.full(len(times), SLIDING, dtype="U24")
    else:
        phases = np.where(touching, _in_contact(world, name, velocity, spin, speed, settings.grip), FREE).astype("U24")
    for begin, _ in contacts:
        phases[(times > begin) & (times <= begin + settings.after) & ~touching] = HIT
    phases[slow & (touching | world.planar)] = REST
    return phases


def _in_contact(world: World, name: str, velocity: Array, spin: Array, speed: Array, grip: float) -> Texts:
    """Return whether a ball slides or rolls; any other body touches."""
    shape = getattr(world.item(name), "shape", None)
    if not isinstance(shape, Sphere):
        return np.full(len(speed), TOUCHING, dtype="U24")
    up = -np.asarray(world.environment.gravity)
    up = up / max(float(np.linalg.norm(up)), 1e-12)
    slip = velocity - np.cross(spin, shape.radius * up)
    slip = slip - (slip @ up)[:, None] * up
    rolls = np.linalg.norm(slip, axis=1) < grip * np.maximum(speed, REST_SPEED)
    return np.where(rolls, ROLLING, SLIDING).astype("U24")


def _contacts(name: str, events: Sequence[Event], last: float) -> list[tuple[float, float]]:
    """Begin and end [s] of every contact of an object."""
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
