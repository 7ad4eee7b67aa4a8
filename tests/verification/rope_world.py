"""Small worlds with ropes, for the verification cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld import BatchTrajectory, World, rollout, simulator
from polyworld.trajectory import PointMotion, Trajectory

Array = NDArray[np.float64]
G = 9.81


def ball(name: str, position: Sequence[float], mass: float, **more: Any) -> dict[str, Any]:
    """A small sphere."""
    shape = {"kind": "sphere", "radius": 0.02}
    return {
        "name": name,
        "representation": "rigid_spatial",
        "shape": shape,
        "position": position,
        "mass": mass,
        **more,
    }


def rope(points: Sequence[Sequence[float]], segments: int, **more: Any) -> dict[str, Any]:
    """A rope called `rope`."""
    return {"name": "rope", "representation": "rope", "points": points, "segments": segments, **more}


def held(end: str, to: str | None = None, clamped: bool = False) -> dict[str, Any]:
    """An attachment of one end of `rope`."""
    return {"name": f"at-{end}", "object": "rope", "end": end, "to": to, "clamped": clamped}


def world(
    *deformables: dict[str, Any],
    objects: Sequence[dict[str, Any]] = (),
    attachments: Sequence[dict[str, Any]] = (),
    gravity: Sequence[float] = (0.0, 0.0, -G),
    substep: float = 0.002,
    **more: Any,
) -> World:
    """A world without floor."""
    return World.model_validate(
        {
            "objects": objects,
            "deformables": deformables,
            "attachments": attachments,
            "environment": {"gravity": gravity, **more.pop("environment", {})},
            "time": {"substep": substep},
            **more,
        }
    )


def run(scene: World, horizon: float, interval: float | None = None) -> tuple[Trajectory, PointMotion]:
    """Trajectory, and the motion of `rope`; fails where the rollout diverged."""
    result = rollout(scene, horizon, sample_interval=interval or horizon)
    assert result.status == "completed", result
    return result.trajectory, result.trajectory.deformables["rope"]


def run_batch(scene: World, horizon: float, overrides: Mapping[str, Array]) -> BatchTrajectory:
    """The same scene with different parameters, at its start and at the horizon."""
    count = len(next(iter(overrides.values())))
    batch = simulator(scene, np.array([0.0, horizon]), n_worlds=count).run(overrides)
    assert not batch.diverged.any()
    return batch


def frequency(times: Array, values: Array) -> float:
    """Frequency [Hz] of a slowly decaying oscillation, from the first to the last upward crossing of its mean."""
    y = values - values.mean()
    up = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    crossing = times[up] - y[up] * (times[up + 1] - times[up]) / (y[up + 1] - y[up])
    assert len(crossing) >= 2
    return float((len(crossing) - 1) / (crossing[-1] - crossing[0]))
