"""The loss of a fit: how far a batch of rollouts is from observed tracks and shapes, in units of the noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.readout import Readout, turning_length
from polyworld.identification.shape_entries import ShapeEntries
from polyworld.tracks import ObservedTracks
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World

Array = NDArray[np.float64]

# A diverged world is worse than anything finite, and comparable: the later it diverged, the better.
DIVERGED = 1e12


@dataclass(frozen=True)
class ObjectiveSettings:
    """How observations are weighed.

    position_tolerance [m]: standard deviation added in quadrature to every position_sigma; what the model is
    not asked to reproduce. rotation_sigma [rad]: standard deviation of an observed rotation; default the
    position's divided by the object's radius of gyration, so that turning an object counts as much as the
    mean displacement of its substance. huber: residual, in standard deviations, beyond which the loss grows
    linearly instead of quadratically (Huber 1964); infinity for least squares.
    """

    position_tolerance: float = 0.0
    rotation_sigma: float | None = None
    huber: float = 5.0

    def __post_init__(self) -> None:
        if self.position_tolerance < 0.0 or not np.isfinite(self.position_tolerance):
            raise ValueError(f"position_tolerance must be >= 0 m, got {self.position_tolerance}")
        if self.rotation_sigma is not None and not self.rotation_sigma > 0.0:
            raise ValueError(f"rotation_sigma must be > 0 rad, got {self.rotation_sigma}")
        if not self.huber > 0.0:
            raise ValueError(f"huber must be > 0, got {self.huber}")


@dataclass(frozen=True)
class Objective:
    """Loss of batches of rollouts of one world against one track record, its shapes included.

    Loss of a world: sum of c rho(r) / sum of c d over entries, where c is the confidence, r the residual of an
    entry over its standard deviation, d its number of components and rho Huber's function, r^2 up to the
    threshold k and 2 k r - k^2 beyond. A perfect model with correctly stated noise has a loss near 1.
    """

    world: World
    tracks: ObservedTracks
    settings: ObjectiveSettings = ObjectiveSettings()
    readout: Readout = field(init=False)
    shapes: tuple[ShapeEntries, ...] = field(init=False)
    _position_sigma: Array = field(init=False, repr=False)
    _position_weight: Array = field(init=False, repr=False)
    _rotation_sigma: Array = field(init=False, repr=False)
    _rotation_weight: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        readout = Readout.of(self.world, self.tracks)
        at = readout.positions
        sigma = self.tracks.position_sigma[at.sample, at.track]
        if np.any(~np.isfinite(sigma) | (sigma < 0.0)):
            raise ValueError("position_sigma must be finite and >= 0 wherever confidence is above 0")
        sigma = np.hypot(sigma, self.settings.position_tolerance)
        if np.any(sigma <= 0.0):
            raise ValueError("position_sigma is 0 for some observations: state their noise, or a position_tolerance")
        turn = readout.rotations
        if self.settings.rotation_sigma is not None:
            rotation_sigma = np.full(len(turn.sample), self.settings.rotation_sigma)
        else:
            lengths = np.ones(len(self.world.moving_names))
            for column in np.unique(turn.column):
                lengths[column] = turning_length(self.world, self.world.moving_names[column], readout.normal)
            own = self.tracks.position_sigma[turn.sample, turn.track]
            own = np.where(np.isfinite(own), own, np.nanmedian(sigma) if len(sigma) else 0.0)
            rotation_sigma = np.hypot(own, self.settings.position_tolerance) / lengths[turn.column]
        shapes = [s for s in self.tracks.shapes if s.object in self.world.moving_names]
        entries = [ShapeEntries.of(self.world, s, readout.sample_times) for s in shapes]
        object.__setattr__(self, "readout", readout)
        object.__setattr__(self, "shapes", tuple(entries))
        object.__setattr__(self, "_position_sigma", sigma)
        object.__setattr__(self, "_position_weight", self.tracks.confidence[at.sample, at.track])
        object.__setattr__(self, "_rotation_sigma", rotation_sigma)
        object.__setattr__(self, "_rotation_weight", self.tracks.orientation_confidence[turn.sample, turn.track])

    def weight(self, samples: int) -> float:
        """Sum of confidences times components over the first `samples` sample times: the loss's normaliser."""
        readout = self.readout
        count, turns = readout.positions.before(samples), readout.rotations.before(samples)
        dims = 1 if readout.normal is not None else 3
        total = self._position_weight[:count].sum() * len(readout.axes) + self._rotation_weight[:turns].sum() * dims
        shapes = sum(s.weight[: s.before(samples)].sum() * s.components for s in self.shapes)
        return float(total + shapes)

    @property
    def sample_times(self) -> Array:
        """Times (T,) [s] at which rollouts are compared."""
        return self.readout.sample_times

    def losses(self, batch: BatchTrajectory) -> Array:
        """Loss of every world, shape (W,), over the samples the batch holds.

        Diverged worlds get `DIVERGED` times the share of the horizon they did not reach, plus `DIVERGED`.
        """
        total, weight = np.zeros(batch.positions.shape[0]), 0.0
        for residual, confidence in self._standardised(batch):
            size = np.linalg.norm(residual, axis=-1)
            total = total + huber(size, self.settings.huber) @ confidence
            weight += float(confidence.sum()) * residual.shape[-1]
        if weight == 0.0:
            raise ValueError("nothing was observed within the horizon")
        losses: Array = total / weight
        broken = batch.diverged | ~np.isfinite(losses)
        if broken.any():
            end = max(float(batch.times[:, -1].max()), 1e-12)
            reached = np.nan_to_num(batch.diverged_time[broken], nan=0.0) / end
            losses[broken] = DIVERGED * (2.0 - np.clip(reached, 0.0, 1.0))
        return losses

    def residuals(self, batch: BatchTrajectory) -> Array:
        """Weighted standardised residuals (W, r): sqrt(c) times every component; positions, rotations, shapes.

        Their sum of squares is the least-squares (not Huber) form of the loss times its normaliser.
        """
        parts = [
            (residual * np.sqrt(confidence)[:, None]).reshape(residual.shape[0], -1)
            for residual, confidence in self._standardised(batch)
        ]
        return np.concatenate(parts, axis=1)

    def huber_weights(self, batch: BatchTrajectory) -> Array:
        """Weights (W, r) min(1, k / r) by which iterated least squares reproduces Huber's loss."""
        parts = []
        for residual, _ in self._standardised(batch):
            size = np.linalg.norm(residual, axis=-1, keepdims=True)
            weight = np.minimum(1.0, self.settings.huber / np.maximum(size, 1e-300))
            parts.append(np.broadcast_to(weight, residual.shape).reshape(residual.shape[0], -1))
        return np.concatenate(parts, axis=1)

    def series(self, samples: int) -> list[NDArray[np.int64]]:
        """Rows (T, d) of `residuals` of each object and kind: T times in order, d components."""
        dims = (len(self.readout.axes), 1 if self.readout.normal is not None else 3)
        rows: list[NDArray[np.int64]] = []
        offset = 0
        for entries, d in zip((self.readout.positions, self.readout.rotations), dims, strict=True):
            count = entries.before(samples)
            for track in np.unique(entries.track[:count]):
                at = np.flatnonzero(entries.track[:count] == track)
                rows.append(offset + at[:, None] * d + np.arange(d))
            offset += count * d
        for shape in self.shapes:
            d = shape.components
            for group in shape.groups(samples):
                rows.append((offset + group[..., None] * d + np.arange(d)).reshape(len(group), -1))
            offset += shape.before(samples) * d
        return rows

    def _standardised(self, batch: BatchTrajectory) -> list[tuple[Array, Array]]:
        if batch.names != self.world.moving_names:
            raise ValueError(f"the rollouts hold {batch.names}, the world {self.world.moving_names}")
        position = self.readout.position_differences(batch)
        count = position.shape[1]
        parts = [(position / self._position_sigma[:count, None], self._position_weight[:count])]
        if self.readout.rotations.before(batch.orientations.shape[1]):
            rotation = self.readout.rotation_differences(batch)
            count = rotation.shape[1]
            parts.append((rotation / self._rotation_sigma[:count, None], self._rotation_weight[:count]))
        parts += [(s.standardised(batch), s.weight[: s.before(batch.positions.shape[1])]) for s in self.shapes]
        return parts


def huber(size: Array, threshold: float) -> Array:
    """Huber's function of residual sizes >= 0: r^2 up to the threshold k, 2 k r - k^2 beyond (Huber 1964)."""
    if not np.isfinite(threshold):
        return size**2
    core = np.minimum(size, threshold)
    loss: Array = core * (2.0 * size - core)
    return loss
