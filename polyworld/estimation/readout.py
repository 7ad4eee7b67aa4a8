"""Observed values as entries of a fit, and by how much a batch of rollouts differs from them.

Every observed position, orientation and value of a shape becomes one entry. Planar worlds are compared in their
motion plane only: what happens along its normal is outside the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import ObservedTracks
from polyworld.model import model_of
from polyworld.probing.readouts import Centreline, check_readable, read
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World, geometry
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import smallest_rotation, turn_about

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Standardised difference of a value where the rollout has nothing to compare, such as the front of a fluid that has
# not flowed yet: far more than any misfit, and finite, so that such a world is bad rather than undefined.
ABSENT = 100.0


@dataclass(frozen=True)
class Entries:
    """Observed values of one kind in the order of time, so that a shorter horizon is a prefix.

    kind: "position" [m], "rotation" [rad], or that of a shape's readout, in the readout's unit. names: objects, to
    which `owner` (n,) points. sample (n,): frame rows. column (n,): which of the values that an object shows at one
    instant. sigma, weight (n,): standard deviations and confidences. spread (n, components): one more standard
    deviation along a direction, as `ObservedTracks` has it; None where there is none. components: of one value.
    compare: (batch, count) -> simulated minus observed values (W, count, components) of the first entries.
    """

    kind: str
    names: tuple[str, ...]
    owner: Ints
    sample: Ints
    column: Ints
    sigma: Array
    weight: Array
    components: int
    compare: Callable[[BatchTrajectory, int], Array]
    spread: Array | None = None

    def before(self, samples: int) -> int:
        """Return how many entries belong to the first `samples` sample times."""
        return int(np.searchsorted(self.sample, samples, side="left"))

    def differences(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return simulated minus observed values (W, n, c) within the first sample times."""
        return self.compare(batch, self.before(samples))

    def standardised(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return the same over their standard deviations; `ABSENT` where the rollout has nothing."""
        difference = self.differences(batch, samples)
        residual = difference / self.sigma[: difference.shape[1], None]
        if self.spread is not None:
            residual = self._shortened(residual)
        return np.where(np.isfinite(residual), residual, ABSENT)

    def _shortened(self, residual: Array) -> Array:
        """Return residuals (W, n, c) over sigma, shortened along the direction in which there is more to deviate."""
        assert self.spread is not None
        spread = self.spread[: residual.shape[1]]
        length = np.linalg.norm(spread, axis=1)
        direction = spread / np.maximum(length, 1e-300)[:, None]
        sigma = self.sigma[: residual.shape[1]]
        excess = 1.0 - sigma / np.hypot(sigma, length)
        along = np.einsum("wnc,nc->wn", residual, direction) * excess
        shortened: Array = residual - along[..., None] * direction
        return shortened


def sample_times(world: World, tracks: ObservedTracks) -> Array:
    """Return the times (T,) [s] of the frames at the world's own seconds_per_frame."""
    times: Array = tracks.frames.astype(np.float64) * world.time.seconds_per_frame
    return times


def observed_entries(world: World, tracks: ObservedTracks) -> tuple[Entries, ...]:
    """Match what was observed to the world's objects by name: positions, rotations, then each shape.

    Observations before an object's start_time are left out, as are those of confidence 0. Raises ValueError when no
    name matches, no frame is left, a frame number is negative, or the world has no such readout.
    """
    known = tracks.observed_names
    if not set(known) & set(world.moving_names):
        objects = list(world.moving_names)
        raise ValueError(f"no track belongs to an object of the world; tracks {list(known)}, objects {objects}")
    if len(tracks.frames) == 0 or tracks.frames[0] < 0:
        raise ValueError("tracks must have at least one frame, and frame numbers must not be negative")
    shapes = [_shape(world, tracks, s) for s in tracks.shapes if s.object in world.moving_names]
    return (*_tracks(world, tracks), *shapes)


def _present(world: World, tracks: ObservedTracks, names: tuple[str, ...]) -> NDArray[np.bool_]:
    """Return which objects have joined at each frame (T, n); none that the world lacks. Fluids are there at once."""
    starts = [getattr(world.item(n), "start_time", 0.0) if n in world.moving_names else np.inf for n in names]
    present: NDArray[np.bool_] = sample_times(world, tracks)[:, None] >= np.array(starts) - 1e-9  # a frame's, rounded
    return present


def _tracks(world: World, tracks: ObservedTracks) -> tuple[Entries, Entries]:
    """Return positions, and rotations from observed to simulated orientation, whose sigma is that of the position.

    Planar: the angle about the plane's normal, folded into the object's symmetry of order n. Spatial: the rotation
    vector, the smallest over the n turns about the body's z axis that look alike; for order 0 the turn about that axis
    is removed and only its tilt remains.
    """
    names = list(world.moving_names)
    columns = np.array([names.index(n) if n in names else -1 for n in tracks.names], dtype=np.int64)
    axes = geometry.plane_axes(world.environment.motion_plane)
    fluids = {d.name for d in world.of_form("liquid")}
    order = np.array(tracks.symmetry, dtype=np.int64)
    round_ = {o.name for o in world.objects if isinstance(o.shape, Sphere)}
    tilts = np.array([not world.planar and n not in round_ for n in tracks.names], dtype=bool)
    turns = np.array([n not in fluids for n in tracks.names], dtype=bool) & ((order != 0) | tilts)
    turned = turns & (tracks.orientation_confidence > 0.0) & np.all(np.isfinite(tracks.orientations), axis=-1)

    def moved(batch: BatchTrajectory, rows: Ints, owner: Ints) -> Array:
        apart: Array = batch.positions[:, rows, columns[owner]] - tracks.positions[rows, owner]
        return apart @ axes[:2].T if world.planar else apart

    def rotated(batch: BatchTrajectory, rows: Ints, owner: Ints) -> Array:
        simulated, seen = batch.orientations[:, rows, columns[owner]], tracks.orientations[rows, owner]
        if world.planar:
            return turn_about(simulated, seen, axes[2], order[owner])[..., None]
        return smallest_rotation(simulated, seen, order[owner])

    def entries(
        kind: str, seen: NDArray[np.bool_], confidence: Array, components: int, compare: Callable[..., Array]
    ) -> Entries:
        rows, owner = np.nonzero(seen & _present(world, tracks, tracks.names))  # row-major: ordered by time
        sigma, weight, none = tracks.position_sigma[rows, owner], confidence[rows, owner], np.zeros_like(rows)

        def differences(batch: BatchTrajectory, count: int) -> Array:
            return compare(batch, rows[:count], owner[:count])

        spread = None
        if kind == "position" and tracks.position_spread is not None:
            spread = tracks.position_spread[rows, owner]
            spread = spread @ axes[:2].T if world.planar else spread
        return Entries(kind, tracks.names, owner, rows, none, sigma, weight, components, differences, spread)

    return (
        entries("position", tracks.confidence > 0.0, tracks.confidence, 2 if world.planar else 3, moved),
        entries("rotation", turned, tracks.orientation_confidence, 1 if world.planar else 3, rotated),
    )


def _shape(world: World, tracks: ObservedTracks, series: ShapeSeries) -> Entries:
    readout = series.readout
    check_readable(readout, world)
    sample, entry = np.nonzero((series.confidence > 0.0) & _present(world, tracks, (series.object,)))
    in_space = series.values.shape[2] == 3 and getattr(readout, "view", "image") == "world"
    axes = geometry.plane_axes(world.environment.motion_plane)[:2] if world.planar and in_space else None

    def compare(batch: BatchTrajectory, count: int) -> Array:
        observed = series.values[: batch.positions.shape[1]]
        simulated = read(readout, world, batch, observed)
        if simulated.shape[-2:] != observed.shape[-2:]:
            raise ValueError(
                f"{readout.kind} of {series.object!r}: observed {observed.shape[1:]} entries and components, "
                f"the world has {simulated.shape[-2:]}"
            )
        difference = simulated - observed
        if isinstance(readout, Centreline) and not readout.directed:
            difference = _nearer_direction(series, difference, simulated[..., ::-1, :] - observed)
        chosen: Array = difference[:, sample[:count], entry[:count]]
        return chosen if axes is None else chosen @ axes.T

    return Entries(
        readout.kind,
        (series.object,),
        np.zeros(len(sample), dtype=np.int64),
        sample,
        entry,
        series.sigma[sample, entry],
        series.confidence[sample, entry],
        series.values.shape[2] if axes is None else 2,
        compare,
    )


def _nearer_direction(series: ShapeSeries, forward: Array, backward: Array) -> Array:
    """Return differences (W, T, n, c) along the direction of a line that is nearer, frame by frame."""
    weight = np.nan_to_num(series.confidence[: forward.shape[-3]])
    cost = [((np.nan_to_num(d) ** 2).sum(axis=-1) * weight).sum(axis=-1) for d in (forward, backward)]
    return np.where((cost[1] < cost[0])[..., None, None], backward, forward)


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


class TracksReadout:
    """Residuals against tracks and shapes. sigma (n,) [m]: of the positions of each track, instead of that stated.

    A rotation has the sigma of the position over the radius of gyration, so that turning an object counts as much as
    the mean displacement of its substance. `ObservedTracks.confidence` weighs an entry.
    """

    def __init__(self, world: World, tracks: ObservedTracks, sigma: Array) -> None:
        positions, rotations, *shapes = observed_entries(world, tracks)
        normal = geometry.plane_axes(world.environment.motion_plane)[2] if world.planar else None
        lengths = [gyration_radius(world, n, normal) if n in world.moving_names else 1.0 for n in rotations.names]
        self.entries = (
            replace(positions, sigma=sigma[positions.owner]),
            replace(rotations, sigma=(sigma / np.array(lengths))[rotations.owner]),
            *shapes,
        )
        self.size = sum(len(e.sample) * e.components for e in self.entries)

    def residuals(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return standardised residuals (k, m) within the first `samples` instants, by kind, then time."""
        found = []
        for e in self.entries:
            n = e.before(samples)
            own = e.standardised(batch, samples) * np.sqrt(e.weight[:n])[:, None]
            found.append(own.reshape(len(own), -1))
        return np.concatenate(found, axis=1)

    def owners(self, samples: int) -> list[str]:
        """Return the object to which each residual (m,) belongs."""
        found: list[str] = []
        for e in self.entries:
            own = e.owner[: e.before(samples)]
            found += [e.names[i] for i in np.repeat(own, e.components)]
        return found
