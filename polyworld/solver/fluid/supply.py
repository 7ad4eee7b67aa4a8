"""A world's emitters and drains as the arrays the kernels read, and how many particles they need."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.fluid.sources import Sources
from polyworld.world import World
from polyworld.world.representations.fluid import Drain, Emitter

Array = NDArray[np.float64]

MOST_PARTICLES = 8_000_000  # in one world


def build_sources(world: World, fluids: tuple[str, ...], n_worlds: int, thin: int) -> Sources:
    """Emitters and drains of a world; ValueError for an emitter that does not lie in the plane of its fluid."""
    s = Sources()
    emitters, drains = world.emitters, world.drains
    directions = np.array([e.direction for e in emitters], dtype=float).reshape(-1, 3)
    lengths = np.linalg.norm(directions, axis=1)
    for e, d, length in zip(emitters, directions, lengths, strict=True):
        if length < 1e-9:
            raise ValueError(f"emitter {e.name!r}: its direction must not be zero")
        if thin >= 0 and abs(d[thin]) > 1e-6 * length:
            raise ValueError(
                f"emitter {e.name!r}: direction {e.direction} leaves the motion plane, whose normal is "
                f"{world.environment.motion_plane.normal}"
            )
    s.fluid = _array([fluids.index(e.fluid) for e in emitters], wp.int32)
    s.position = _array([e.position for e in emitters], wp.vec3d)
    s.direction = _array(directions / np.maximum(lengths, 1e-12)[:, None], wp.vec3d)
    s.radius = _array([e.radius for e in emitters], wp.float64)
    s.rate = buffers.array(np.array([[e.rate for e in emitters] or [0.0]]), wp.float64)
    s.lower = _array([d.lower for d in drains], wp.vec3d)
    s.upper = _array([d.upper for d in drains], wp.vec3d)
    s.drain_rate = _array([-1.0 if d.rate is None else d.rate for d in drains], wp.float64)
    both: list[Emitter | Drain] = [*emitters, *drains]
    s.start = _array([b.start for b in both], wp.float64)
    s.end = _array([np.inf if b.end is None else b.end for b in both], wp.float64)
    s.first = _array(np.concatenate([[0], np.cumsum([len(b.schedule) for b in both])]), wp.int32)
    knots = [sorted(b.schedule, key=lambda knot: knot[0]) for b in both]
    s.times = _array([t for line in knots for t, _ in line], wp.float64)
    s.factors = _array([f for line in knots for _, f in line], wp.float64)
    s.emitters, s.drains = len(emitters), len(drains)
    w, e, d = n_worlds, max(len(emitters), 1), max(len(drains), 1)
    s.due, s.allowed = (buffers.zeros((w, n), wp.float64) for n in (e, d))
    s.emitted, s.drained = (buffers.zeros((w, n), wp.int32) for n in (e, d))
    s.full = buffers.zeros((w,), wp.int32)
    return s


def particles_needed(world: World, seeded: int, rates: dict[str, float], volume: float, horizon: float) -> int:
    """Rows for the particles of one world: those at the start and all that its emitters send within the horizon.

    rates: highest rate of each emitter. Raises ValueError naming the numbers where they are too many.
    """
    emitted = {e.name: int(np.ceil(rates[e.name] * open_time(e, horizon) / volume)) + 2 for e in world.emitters}
    total = seeded + sum(emitted.values())
    if total > MOST_PARTICLES:
        raise ValueError(
            f"{total} fluid particles of {volume:.3g} m^3 are more than {MOST_PARTICLES}: {seeded} at the start, and "
            f"from the emitters within {horizon:g} s {emitted}; use a larger cell, a lower rate or a shorter horizon"
        )
    return max(total, 1)


def open_time(source: Emitter | Drain, horizon: float) -> float:
    """Seconds of full flow until the horizon: the integral of the schedule's factor while it is on."""
    start, end = source.start, min(horizon, np.inf if source.end is None else source.end)
    if end <= start:
        return 0.0
    if not source.schedule:
        return end - start
    times, factors = np.array(sorted(source.schedule)).T
    inner = times[(times > start) & (times < end)]
    t = np.concatenate([[start], inner, [end]])
    f = np.interp(t, times, factors)
    return float(np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(t)))


def _array(rows: Any, dtype: Any) -> Any:
    if len(rows) == 0:
        return buffers.zeros(1, dtype)
    return buffers.array(np.asarray(rows), dtype)
