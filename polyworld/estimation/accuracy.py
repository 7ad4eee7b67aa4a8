"""Measure how well a trajectory follows tracks and shapes, and how well a fit predicts.

Root mean square errors in their own units; frames that a fit left out, and how far its members spread beyond the clip.
Members share one model. That this is not quite right (the friction of a corner, a contact met otherwise) shows after
the data end and grows with the distance travelled; collisions multiply it, so its distribution has heavy tails
(Kennedy & O'Hagan, J. R. Stat. Soc. B 63, 2001, on model discrepancy).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.core.reported import json_ready
from polyworld.data.tracks import ObservedTracks, without_spread
from polyworld.estimation.fit_settings import ModelSettings
from polyworld.estimation.problem import Block
from polyworld.estimation.readout import CHANNELS, RunReadout, sample_times, tracks_readout
from polyworld.estimation.study import StudyRun
from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World, geometry

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


BEYOND = (0.5, 1.0)  # [s] after the last frame
CENTRAL = (0.1, 0.9)  # quantiles of an interval
QUANTILES = 19  # of the distribution of errors by which each member is widened
DECIDES = 0.3  # part of the spread that one constant explains, from which on it is said to decide


@dataclass(frozen=True)
class BodyPrediction:
    """One body. error: root mean square distance [m] to the frames that were left out, of the median prediction; last:
    at the last of them; stays: the same error of a body that stays where it was last seen; noise [m]: of a distance.
    spread: half the width of 80% intervals [m] at the cut and 0.5 and 1 s after the last frame, the wider axis, the
    model's own error included.
    decided_by: constants that explain most of the last spread, and which part of it."""

    object: str
    error: float
    last: float
    stays: float
    noise: float
    spread: tuple[float, ...]
    decided_by: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Prediction:
    """How a run is predicted from its frames before `frame`. inside: part of the held-out coordinates within their 80%
    intervals, widened by the noise."""

    frame: int
    bodies: tuple[BodyPrediction, ...]
    inside: float

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        rows = [
            {**vars(b), "spread": list(b.spread), "decided_by": [{"constant": n, "part": p} for n, p in b.decided_by]}
            for b in self.bodies
        ]
        return {"frame": self.frame, "bodies": rows, "inside": self.inside if np.isfinite(self.inside) else None}


def predicted(
    block: Block,
    overrides: dict[str, Array],
    run: StudyRun,
    sigma: Array,
    cut: int,
    begin: float,
    shared: Mapping[str, Array],
) -> Prediction | None:
    """Roll the members of a posterior out over the frames left out and beyond; None where most of them diverge, or no
    rigid body was observed.

    block: the run's last stretch, which begins at `begin` [s]; overrides: path -> values (N,); shared: constants (N,).
    """
    step = run.world.time.seconds_per_frame
    tracks = run.tracks.window(cut, int(run.tracks.frames[-1]))
    ends = float(tracks.moments[-1]) * step
    times = np.concatenate([tracks.moments * step, [ends + b for b in BEYOND]]) - begin
    count = len(next(iter(overrides.values())))
    batch = simulator(block.world, times, n_worlds=count).run(overrides)
    kept = ~batch.stopped
    if kept.sum() < 0.5 * count:
        return None
    normal = geometry.plane_axes(run.world.environment.motion_plane)[2] if run.world.planar else np.zeros(3)
    across = np.eye(3) - np.outer(normal, normal)
    measured, places = tracks.positions @ across, batch.positions[kept] @ across
    bodies, inside = [], []
    for item in (o for o in run.world.objects if o.name in tracks.names):
        column = tracks.names.index(item.name)
        own, seen = places[:, :, batch.names.index(item.name)], np.flatnonzero(tracks.confidence[:, column] > 0.0)
        apart = np.linalg.norm(own - own[:, :1], axis=-1, keepdims=True)
        low, high = np.quantile(with_model_error(own, apart), CENTRAL, axis=0)
        spread = tuple(float((high[k] - low[k]).max() / 2.0) for k in (0, -2, -1))
        decided = _decided(own[:, -1], {name: values[kept] for name, values in shared.items()})
        noise = float(sigma[column] * np.sqrt(2.0 if run.world.planar else 3.0))
        error = last = stays = np.nan
        if len(seen):
            there, margin = measured[seen, column], 1.28 * sigma[column]
            missed = np.linalg.norm(np.median(own, axis=0)[seen] - there, axis=1)
            error, last = float(np.sqrt(np.mean(missed**2))), float(missed[-1])
            before = np.flatnonzero((run.tracks.confidence[:, column] > 0.0) & (run.tracks.frames < cut))
            if len(before):
                stayed = there - run.tracks.positions[before[-1], column] @ across
                stays = float(np.sqrt(np.mean(np.sum(stayed**2, axis=1))))
            held = (there >= low[seen] - margin) & (there <= high[seen] + margin)
            inside.append(held[:, np.abs(normal) < 1.0 - 1e-9].ravel())
        bodies.append(BodyPrediction(item.name, error, last, stays, noise, spread, decided))
    if not bodies:
        return None
    return Prediction(cut, tuple(bodies), float(np.concatenate(inside).mean()) if inside else np.nan)


def _decided(places: Array, shared: Mapping[str, Array]) -> tuple[tuple[str, float], ...]:
    """Return constants whose scatter explains much of that of places (N, 3) along its main direction."""
    centred = places - places.mean(axis=0)
    if len(centred) < 8 or not np.any(centred):
        return ()
    main = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    found = []
    for name, values in shared.items():
        known = np.isfinite(values)
        if known.sum() >= 8 and values[known].std() > 0.0 and main[known].std() > 0.0:
            part = float(np.corrcoef(values[known], main[known])[0, 1] ** 2)
            if part >= DECIDES:
                found.append((name, part))
    return tuple(sorted(found, key=lambda d: -d[1])[:3])


def with_model_error(values: Array, travelled: Array, settings: ModelSettings | None = None) -> Array:
    """Return a sample (N * 19, ...) of coordinates of which members (N, ...) say `values`.

    travelled (N, ...): distance since the last fitted frame [m]. Each member becomes the quantiles of a Cauchy
    distribution about it, whose half width is a share of that distance.
    """
    half = (settings or ModelSettings()).path * travelled
    errors = np.tan(np.pi * ((np.arange(QUANTILES) + 0.5) / QUANTILES - 0.5))
    errors = errors.reshape(-1, *np.ones(values.ndim, dtype=int))
    widened: Array = values + errors * half
    return widened.reshape(-1, *values.shape[1:])


def travelled(positions: Array) -> Array:
    """Return the length of the path [m] from the first of positions (..., T, 3) to each of them, (..., T)."""
    steps = np.linalg.norm(np.diff(positions, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*positions.shape[:-2], 1)), np.cumsum(np.nan_to_num(steps), axis=-1)], axis=-1)


def travelled_by_axis(positions: Array, normal: Array | None = None) -> Array:
    """Return the distances [m] with which errors of positions (..., T, 3) go by axis, (..., T, 3).

    That of the whole path, along z that of its rise and fall alone, since what lies on a floor stays on it; none across
    a motion plane with this normal (3,).
    """
    whole, upright = travelled(positions), travelled(positions * [0.0, 0.0, 1.0])
    found: Array = np.stack([whole, whole, upright], axis=-1)
    return found if normal is None else found * (1.0 - np.abs(normal))
