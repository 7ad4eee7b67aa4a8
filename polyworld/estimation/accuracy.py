"""Plain readouts of how well a trajectory follows tracks and shapes: root mean square errors in their own units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks, without_spread
from polyworld.estimation.readout import CHANNELS, RunReadout, sample_times, tracks_readout
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Accuracy:
    """Root mean square errors: position [m], rotation [rad], each overall and by object.

    position over all observed samples (square root of the mean squared distance), NaN where none; unexplained_by_object
    [m]: of positions without what the spread of measured places explains (`ObservedTracks.position_spread`);
    worst_position [m] is the largest single distance; samples counts the positions compared. shape_by_readout:
    object -> kind of readout -> root mean square error in the readout's unit; shape_score: the same over all shapes,
    in standard deviations, NaN where there are none.
    """

    position: float
    rotation: float
    worst_position: float
    samples: int
    position_by_object: dict[str, float]
    unexplained_by_object: dict[str, float]
    rotation_by_object: dict[str, float]
    shape_by_readout: dict[str, dict[str, float]]
    shape_score: float

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values, NaN as None."""
        found: dict[str, Any] = {
            "position_rmse": self.position,
            "rotation_rmse": self.rotation,
            "worst_position": self.worst_position,
            "samples": self.samples,
            "position_rmse_by_object": self.position_by_object,
            "rotation_rmse_by_object": self.rotation_by_object,
        }
        if self.shape_by_readout:
            found |= {"shape_rmse": self.shape_by_readout, "shape_rms_in_sigma": self.shape_score}
        ready: dict[str, Any] = json_ready(found)
        return ready


def accuracy(world: World, tracks: ObservedTracks, trajectory: Trajectory) -> Accuracy:
    """Compare a trajectory of `world`, sampled at the frames of `tracks`, with them.

    Only observed samples count (confidence > 0, not before start_time); planar worlds are compared in their
    plane. Raises ValueError when the trajectory's samples are not at the tracks' frames, or when the trajectory
    ended before the last of them (a diverged rollout has no error, it has none of the later states).
    """
    times = sample_times(world, tracks)
    if trajectory.times.shape != times.shape or not np.allclose(trajectory.times, times, rtol=0.0, atol=1e-9):
        raise ValueError(
            f"the trajectory has {len(trajectory.times)} samples, the tracks {len(times)} frames: "
            "sample it at the tracks' frames times seconds_per_frame"
        )
    return errors(tracks_readout(world, tracks), trajectory.batch(), 0, len(times))


def errors(readout: RunReadout, batch: BatchTrajectory, first: int, last: int) -> Accuracy:
    """Measure the errors of the first world of a batch over the samples `first` to before `last`."""
    shape = (*readout.measured.shape[:1], -1, CHANNELS)
    measured = readout.measured.reshape(shape)[first:last]
    apart = np.where(measured, readout.differences(batch, last)[0, first:], 0.0)
    sizes: list[dict[str, Array]] = [{}, {}, {}]
    for column, name in enumerate(readout.run.names):
        for kind, channels in enumerate((slice(0, 3), slice(3, 6))):
            rows = np.flatnonzero(measured[:, column, channels].any(axis=1))
            own = apart[rows, column, channels]
            if len(rows):
                sizes[kind][name] = np.linalg.norm(own, axis=1)
            if len(rows) and kind == 0:
                spread = np.zeros_like(own) if readout.spread is None else readout.spread[first:last][rows, column]
                sizes[2][name] = np.linalg.norm(without_spread(own, spread), axis=1)
    shapes: dict[str, dict[str, float]] = {}
    standardised = []
    for e in readout.shapes:
        keep = (e.sample >= first) & (e.sample < last)
        own = e.standardised(batch, last)[0]
        own = own[keep[: len(own)]]
        standardised.append(own.ravel())
        size = np.linalg.norm(own * e.sigma[keep][: len(own), None], axis=1)
        if keep.any():
            shapes.setdefault(e.object, {})[e.kind] = _rms([size])
    distances = np.concatenate([np.zeros(0), *sizes[0].values()])
    by_object = [{name: _rms([size]) for name, size in kind.items()} for kind in sizes]
    return Accuracy(
        position=_rms([distances]),
        rotation=_rms(list(sizes[1].values())),
        worst_position=float(distances.max()) if len(distances) else float("nan"),
        samples=len(distances),
        position_by_object=by_object[0],
        unexplained_by_object=by_object[2],
        rotation_by_object=by_object[1],
        shape_by_readout=shapes,
        shape_score=_rms(standardised),
    )


def _rms(parts: Sequence[Array]) -> float:
    sizes = np.concatenate([np.zeros(0), *parts])
    return float(np.sqrt(np.mean(sizes**2))) if len(sizes) else float("nan")


def json_ready(value: Any) -> Any:
    """Replace tuples by lists and numbers that are not finite by None."""
    if isinstance(value, dict):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
