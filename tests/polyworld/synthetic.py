"""Motion written down rather than simulated: rollouts of deformable objects whose every point is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.study import Study, StudyRun
from polyworld.trajectory import Event, PointMotion, Rollout, Trajectory
from polyworld.trajectory.events import all_events
from polyworld.world import World

Array = NDArray[np.float64]


def rollout_of(
    world: World,
    times: Array,
    points: Mapping[str, Array],
    *,
    bodies: Mapping[str, tuple[Array, Array]] | None = None,
    quantities: Mapping[str, Mapping[str, Array]] | None = None,
    contacts: tuple[Event, ...] = (),
) -> Rollout:
    """A rollout whose deformable objects have the given points (T, k, 3) and its rigid ones the given positions (T, 3)
    and orientations (T, 4); velocities are differences in time."""
    count, names = len(times), world.moving_names
    positions, velocities = np.zeros((count, len(names), 3)), np.zeros((count, len(names), 3))
    orientations = np.tile([1.0, 0.0, 0.0, 0.0], (count, len(names), 1))
    motions: dict[str, PointMotion] = {}
    for i, name in enumerate(names):
        if name in points:
            p = np.asarray(points[name], dtype=float)
            v = np.gradient(p, times, axis=0)
            motions[name] = PointMotion(p, v, dict((quantities or {}).get(name, {})))
            known = np.isfinite(p).all(axis=-1)
            with np.errstate(invalid="ignore"):
                positions[:, i] = np.nan_to_num(p).sum(axis=1) / known.sum(axis=1)[:, None]
        else:
            positions[:, i], orientations[:, i] = (bodies or {})[name]
        velocities[:, i] = np.gradient(positions[:, i], times, axis=0)
    trajectory = Trajectory(
        names=names,
        times=np.asarray(times, dtype=float),
        positions=positions,
        orientations=orientations,
        velocities=velocities,
        angular_velocities=np.zeros((count, len(names), 3)),
        active=np.ones((count, len(names)), dtype=bool),
        deformables=motions,
    )
    return Rollout(world.id, float(times[-1]), trajectory, all_events(world, trajectory, contacts))


def camera_above(
    height: float = 10.0, focal: float = 600.0, width: int = 320, image_height: int = 240
) -> dict[str, Any]:
    """Fields of a camera that looks straight down from `height` [m]: u along x, v against y."""
    return {
        "width": width,
        "height": image_height,
        "intrinsics": ((focal, 0.0, width / 2), (0.0, focal, image_height / 2), (0.0, 0.0, 1.0)),
        "rotation": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        "translation": (0.0, 0.0, height),
    }


def of_one(world: World, tracks: ObservedTracks) -> Study:
    """Return the study of a single run."""
    return Study((StudyRun("run", world, tracks),))
