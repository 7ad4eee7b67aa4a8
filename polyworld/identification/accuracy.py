"""Plain readouts of how well a trajectory follows tracks and shapes: root mean square errors in their own units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.readout import Entries, Readout
from polyworld.identification.shape_entries import ShapeEntries
from polyworld.tracks import ObservedTracks
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Accuracy:
    """Root mean square errors: position [m], rotation [rad], each overall and by object.

    position over all observed samples (square root of the mean squared distance), NaN where none;
    worst_position [m] is the largest single distance; samples counts the positions compared. shape_by_readout:
    object -> kind of readout -> root mean square error in the readout's unit; shape_score: the same over all shapes,
    in standard deviations, NaN where there are none.
    """

    position: float
    rotation: float
    worst_position: float
    samples: int
    position_by_object: dict[str, float]
    rotation_by_object: dict[str, float]
    shape_by_readout: dict[str, dict[str, float]] = field(default_factory=dict)
    shape_score: float = float("nan")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values, NaN as None."""
        return {
            "position_rmse": _finite(self.position),
            "rotation_rmse": _finite(self.rotation),
            "worst_position": _finite(self.worst_position),
            "samples": self.samples,
            "position_rmse_by_object": {k: _finite(v) for k, v in self.position_by_object.items()},
            "rotation_rmse_by_object": {k: _finite(v) for k, v in self.rotation_by_object.items()},
            **(
                {
                    "shape_rmse": {
                        name: {kind: _finite(v) for kind, v in kinds.items()}
                        for name, kinds in self.shape_by_readout.items()
                    },
                    "shape_rms_in_sigma": _finite(self.shape_score),
                }
                if self.shape_by_readout
                else {}
            ),
        }


def accuracy(world: World, tracks: ObservedTracks, trajectory: Trajectory) -> Accuracy:
    """Compare a trajectory of `world`, sampled at the frames of `tracks`, with them.

    Only observed samples count (confidence > 0, not before start_time); planar worlds are compared in their
    plane. Raises ValueError when the trajectory's samples are not at the tracks' frames, or when the trajectory
    ended before the last of them (a diverged rollout has no error, it has none of the later states).
    """
    readout = Readout.of(world, tracks)
    times = readout.sample_times
    if trajectory.times.shape != times.shape or not np.allclose(trajectory.times, times, rtol=0.0, atol=1e-9):
        raise ValueError(
            f"the trajectory has {len(trajectory.times)} samples, the tracks {len(times)} frames: "
            "sample it at the tracks' frames times seconds_per_frame"
        )
    batch = BatchTrajectory(
        names=trajectory.names,
        times=trajectory.times[None],
        positions=trajectory.positions[None],
        orientations=trajectory.orientations[None],
        velocities=trajectory.velocities[None],
        angular_velocities=trajectory.angular_velocities[None],
        active=trajectory.active,
        diverged=np.zeros(1, dtype=bool),
        diverged_time=np.full(1, np.nan),
        diverged_object=np.full(1, -1, dtype=np.int64),
        events=((),),
        deformables={name: motion.select(None) for name, motion in trajectory.deformables.items()},
    )
    distance = np.linalg.norm(readout.position_differences(batch)[0], axis=-1)
    angle = np.linalg.norm(readout.rotation_differences(batch)[0], axis=-1)
    series = [s for s in tracks.shapes if s.object in world.moving_names]
    by_readout, score = _shapes([ShapeEntries.of(world, s, times) for s in series], batch)
    return Accuracy(
        position=_rms(distance),
        rotation=_rms(angle),
        worst_position=float(distance.max()) if len(distance) else float("nan"),
        samples=len(distance),
        position_by_object=_by_object(tracks, readout.positions, distance),
        rotation_by_object=_by_object(tracks, readout.rotations, angle),
        shape_by_readout=by_readout,
        shape_score=score,
    )


def trajectory_rmse(world: World, tracks: ObservedTracks, trajectory: Trajectory) -> float:
    """Square root of the mean squared position error over all observed samples [m]; see `accuracy`."""
    return accuracy(world, tracks, trajectory).position


def _shapes(shapes: list[ShapeEntries], batch: BatchTrajectory) -> tuple[dict[str, dict[str, float]], float]:
    squares: dict[str, dict[str, list[Array]]] = {}
    standardised: list[Array] = []
    for shape in shapes:
        difference = shape.differences(batch)[0]
        if len(difference):
            found = squares.setdefault(shape.series.object, {}).setdefault(shape.readout.kind, [])
            found.append((difference**2).sum(axis=-1))
            standardised.append(shape.standardised(batch)[0].ravel())
    by_readout = {
        name: {kind: float(np.sqrt(np.mean(np.concatenate(parts)))) for kind, parts in kinds.items()}
        for name, kinds in squares.items()
    }
    return by_readout, _rms(np.concatenate(standardised)) if standardised else float("nan")


def _by_object(tracks: ObservedTracks, entries: Entries, sizes: Array) -> dict[str, float]:
    return {tracks.names[t]: _rms(sizes[entries.track == t]) for t in np.unique(entries.track)}


def _rms(sizes: Array) -> float:
    return float(np.sqrt(np.mean(sizes**2))) if len(sizes) else float("nan")


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
