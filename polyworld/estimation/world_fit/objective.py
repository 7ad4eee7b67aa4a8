"""The loss of a fit: how far a batch of rollouts is from observed tracks and shapes, in units of the noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit.observed import Entries, observed_entries, sample_times
from polyworld.model import model_of
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World, geometry

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

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
class Judged:
    """How far each of W worlds is from what was observed.

    losses (W,): what a fit minimises. errors (W,): root mean square distance of positions [m], or where none is
    observed the root of the loss, in standard deviations; NaN for diverged and truncated worlds.
    """

    losses: Array
    errors: Array


class Objective:
    """Loss of batches of rollouts of one world against one track record, its shapes included.

    Loss of a world: sum of c rho(r) / sum of c d over entries, where c is the confidence, r the residual of an
    entry over its standard deviation, d its number of components and rho Huber's function, r^2 up to the
    threshold k and 2 k r - k^2 beyond. A perfect model with correctly stated noise has a loss near 1.
    sample_times (T,) [s]: when rollouts are compared.
    """

    def __init__(self, world: World, tracks: ObservedTracks, settings: ObjectiveSettings | None = None) -> None:
        self.world = world
        self.settings = settings or ObjectiveSettings()
        self.sample_times = sample_times(world, tracks)
        positions, rotations, *shapes = observed_entries(world, tracks)
        sigma = positions.sigma
        if np.any(~np.isfinite(sigma) | (sigma < 0.0)):
            raise ValueError("position_sigma must be finite and >= 0 wherever confidence is above 0")
        sigma = np.hypot(sigma, self.settings.position_tolerance)
        if np.any(sigma <= 0.0):
            raise ValueError("position_sigma is 0 for some observations: state their noise, or a position_tolerance")
        self.entries = (replace(positions, sigma=sigma), self._rotations(rotations, sigma), *shapes)

    def _rotations(self, rotations: Entries, position_sigma: Array) -> Entries:
        if self.settings.rotation_sigma is not None:
            return replace(rotations, sigma=np.full(len(rotations.sample), self.settings.rotation_sigma))
        normal = geometry.plane_axes(self.world.environment.motion_plane)[2] if self.world.planar else None
        lengths = np.ones(len(rotations.names))
        for track in np.unique(rotations.owner):
            lengths[track] = gyration_radius(self.world, rotations.names[track], normal)
        usual = np.nanmedian(position_sigma) if len(position_sigma) else 0.0
        own = np.where(np.isfinite(rotations.sigma), rotations.sigma, usual)
        sigma = np.hypot(own, self.settings.position_tolerance) / lengths[rotations.owner]
        return replace(rotations, sigma=sigma)

    def weight(self, samples: int) -> float:
        """Sum confidences times components over the first `samples` sample times: the loss's normaliser."""
        return float(sum(e.weight[: e.before(samples)].sum() * e.components for e in self.entries))

    def losses(self, batch: BatchTrajectory) -> Array:
        """Return the loss (W,) of every world over the samples the batch holds.

        Diverged and truncated worlds get `DIVERGED` times the share of the horizon they did not reach, plus `DIVERGED`.
        """
        return self.judged(batch).losses

    @property
    def error_unit(self) -> str:
        """Unit of `Judged.errors`: "m" where positions are observed, else "sigma", standard deviations."""
        return "m" if len(self.entries[0].sample) else "sigma"

    def judged(self, batch: BatchTrajectory) -> Judged:
        """Return the losses as `losses` does, and the errors that a person reads beside them."""
        weight = self.weight(batch.positions.shape[1])
        if weight == 0.0:
            raise ValueError("nothing was observed within the horizon")
        total = np.zeros(batch.positions.shape[0])
        errors = None
        for residual, confidence, sigma in self._standardised(batch):
            size = np.linalg.norm(residual, axis=-1)
            total += huber(size, self.settings.huber) @ confidence
            if errors is None and self.error_unit == "m":  # positions come first
                errors = np.sqrt(np.mean((size * sigma) ** 2, axis=1))
        losses: Array = total / weight
        if errors is None:
            errors = np.sqrt(losses)
        broken = batch.stopped | ~np.isfinite(losses)
        if broken.any():
            end = max(float(batch.times[:, -1].max()), 1e-12)
            reached = np.nan_to_num(batch.end_times()[broken], nan=0.0) / end
            losses[broken] = DIVERGED * (2.0 - np.clip(reached, 0.0, 1.0))
            errors[broken] = np.nan
        return Judged(losses, errors)

    def residuals(self, batch: BatchTrajectory) -> Array:
        """Weighted standardised residuals (W, r): sqrt(c) times every component; NaN for diverged and truncated worlds.

        Their sum of squares is the least-squares (not Huber) form of the loss times its normaliser.
        """
        parts = [_flat(residual * np.sqrt(weight)[:, None]) for residual, weight, _ in self._standardised(batch)]
        return np.where(batch.stopped[:, None], np.nan, np.concatenate(parts, axis=1))

    def huber_weights(self, batch: BatchTrajectory) -> Array:
        """Return weights (W, r) min(1, k / r) by which iterated least squares reproduces Huber's loss."""
        parts = []
        for residual, _, _ in self._standardised(batch):
            size = np.linalg.norm(residual, axis=-1, keepdims=True)
            parts.append(_flat(np.broadcast_to(self.settings.huber / np.maximum(size, 1e-300), residual.shape)))
        return np.minimum(1.0, np.concatenate(parts, axis=1))

    def series(self, samples: int) -> list[tuple[Ints, Ints, Ints]]:
        """Return, by object and kind, places (n, d) in the residual vector, and sample and column (n,) of each."""
        found, offset = [], 0
        for e in self.entries:
            count = e.before(samples)
            places = offset + np.arange(count * e.components).reshape(count, e.components)
            for owner in np.unique(e.owner[:count]):
                own = e.owner[:count] == owner
                found.append((places[own], e.sample[:count][own], e.column[:count][own]))
            offset += places.size
        return found

    def _standardised(self, batch: BatchTrajectory) -> list[tuple[Array, Array, Array]]:
        if batch.names != self.world.moving_names:
            raise ValueError(f"the rollouts hold {batch.names}, the world {self.world.moving_names}")
        samples = batch.positions.shape[1]
        counted = [(e, e.before(samples)) for e in self.entries]
        return [(e.standardised(batch), e.weight[:count], e.sigma[:count]) for e, count in counted if count]


def _flat(values: Array) -> Array:
    return values.reshape(len(values), -1)


def huber(size: Array, threshold: float) -> Array:
    """Evaluate Huber's function of residual sizes >= 0: r^2 up to the threshold k, 2 k r - k^2 beyond (Huber 1964)."""
    if not np.isfinite(threshold):
        return size**2
    core = np.minimum(size, threshold)
    loss: Array = core * (2.0 * size - core)
    return loss


def gyration_radius(world: World, name: str, normal: Array | None) -> float:
    """Return the radius of gyration of an object [m]: about the motion plane's normal, or the mean over the axes.

    It is the length by which a rotation moves an object's substance, so it turns radians into metres. Deformable
    objects have that of their initial shape.
    """
    if world.is_rigid(name):
        item = world.object(name)
        properties = geometry.mass_properties(item.shape)
        axes = geometry.quaternion_matrix(np.asarray(item.orientation))
        inertia = axes @ properties.inertia @ axes.T / properties.volume
    else:
        mesh = model_of(world).mesh(name)
        share = mesh.measure / mesh.measure.sum()
        offset = mesh.nodes - share @ mesh.nodes
        spread = (offset.T * share) @ offset
        inertia = np.trace(spread) * np.eye(3) - spread
    return float(np.sqrt(np.trace(inertia) / 3.0 if normal is None else normal @ inertia @ normal))
