"""What is ordinary in a recorded motion: its speed, extent, duration, sampling and spin."""

from __future__ import annotations

import numpy as np

from polyworld import geometry
from polyworld.estimation.design import Design
from polyworld.estimation.profile import Fit
from polyworld.gap.residual_terms import Scales
from polyworld.world import World

SPANS = 20  # stretches of a run over which speeds are taken, so that noise does not pass for speed
OUTSIDE = 1.0  # per cent of the places at either end that do not count for the extent
FLAT = 0.02  # an axis along which the motion extends less than this part of the whole is none of its axes


def scales_of(design: Design, world: World, fitted: Fit) -> Scales:
    """Scales of the motion of all runs; the spin is that of the world and of the fitted initial states."""
    speeds, places, durations, intervals = [np.zeros(0)], [], [], []
    for r in design.runs:
        run = r.run
        durations.append(float(r.times[-1] - r.times[0]))
        intervals.append(float(np.median(np.diff(run.times))))
        stride = max(1, len(run.times) // SPANS)
        seconds = (run.times[stride:] - run.times[:-stride])[:, None, None]
        velocity = (run.positions[stride:] - run.positions[:-stride]) / seconds
        seen = np.isfinite(velocity).any(axis=-1)
        speeds.append(np.sqrt(np.nansum(velocity**2, axis=-1))[seen])
        places.append(run.positions.reshape(-1, 3))
    low, high = np.zeros(3), np.zeros(3)
    for i, values in enumerate(np.concatenate(places).T):
        values = values[np.isfinite(values)]
        if len(values):
            low[i], high[i] = np.percentile(values, [OUTSIDE, 100.0 - OUTSIDE])
    extent = high - low
    length = max(float(extent.max()) / 2.0, 1e-6)
    axes = "".join(a for i, a in enumerate("xyz") if extent[i] > FLAT * length)
    if world.planar:
        normal = geometry.plane_axes(world.environment.motion_plane)[2]
        axes = "".join(a for i, a in enumerate("xyz") if abs(normal[i]) < 1.0 - 1e-9)
    middle = (low + high) / 2.0
    squares = np.concatenate(speeds) ** 2
    return Scales(
        speed=max(float(np.sqrt(squares.mean())) if len(squares) else 0.0, 1e-6),
        length=length,
        centre=(float(middle[0]), float(middle[1]), float(middle[2])),
        duration=max(durations),
        interval=min(intervals),
        spin=_spin(design, world, fitted),
        axes=axes,
    )


def _spin(design: Design, world: World, fitted: Fit) -> float:
    spins = [float(np.linalg.norm(o.angular_velocity)) for o in world.objects]
    for r in design.runs:
        turning = [i for i, label in enumerate(r.labels) if ".angular_velocity." in label]
        spins.append(float(np.linalg.norm(fitted.states[r.index][turning])))
    return max(spins, default=0.0)
