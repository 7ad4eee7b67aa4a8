"""Compare simulated motion with what was measured: places, turns, spins and shapes, as standardised residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.hinge_angles import HingedBody
from polyworld.data.recording import Run
from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.noise import RunNoise
from polyworld.model import mesh_of, model_of
from polyworld.probing.readouts import Centreline, check_readable, read
from polyworld.probing.readouts.material_points import MaterialPoints, material_points
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World, geometry
from polyworld.world.observer import observe, observed_spins
from polyworld.world.shapes import Sphere
from polyworld.world.symmetry import smallest_rotation, turn_about

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CHANNELS = 9  # of an object: position, turn, spin
# Standardised difference of a value where the rollout has nothing to compare, such as the front of a fluid that has
# not flowed yet: far more than any misfit, and finite, so that such a world is bad rather than undefined.
ABSENT = 100.0


def owner(name: str) -> str:
    """Return the object that a recorded name belongs to: itself, or of a marker `NAME#k` the deformable object."""
    return name.split("#", 1)[0]


@dataclass(frozen=True)
class ShapeEntries:
    """Observed values of one readout of a deformable object in the order of time.

    sample (m,): frame rows. sigma, weight (m,): standard deviations and confidences. components: of one value. compare:
    (batch, count) -> simulated minus observed values (W, count, components) of the first entries.
    """

    kind: str
    object: str
    sample: Ints
    sigma: Array
    weight: Array
    components: int
    compare: Callable[[BatchTrajectory, int], Array]

    def standardised(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return differences (W, m, c) within the first samples over sigma; `ABSENT` where the rollout has nothing."""
        count = int(np.searchsorted(self.sample, samples, side="left"))
        residual = self.compare(batch, count) / self.sigma[:count, None]
        return np.where(np.isfinite(residual), residual, ABSENT)


class RunReadout:
    """Standardised residuals of a run, in the order of time, then those of shapes.

    Channels (9 n): of each object three of position, three of the turn from the observed to the simulated orientation
    (in planar worlds one, about the normal), three of spin. measured (T, 9 n): which were; of an angle the coordinate
    that moves most with it, since it is one number. sigma (T, 9 n): standard deviations. tangents: by column of such an
    object, unit vectors (T, 3) along its arc. weight (T, 9 n): confidences, 1 by default. spread (T, n, 3): one more
    standard deviation of positions along a direction, as `ObservedTracks` has it. Planar worlds are compared in their
    motion plane only: what happens along its normal is outside the model.
    """

    def __init__(
        self,
        world: World,
        run: Run,
        noise: RunNoise,
        *,
        weight: Array | None = None,
        spread: Array | None = None,
        shapes: Sequence[ShapeEntries] = (),
    ) -> None:
        t, n = len(run.times), len(run.names)
        self.run, self.planar = run, world.planar
        self.normal = geometry.plane_axes(world.environment.motion_plane)[2]
        measured = np.zeros((t, n, CHANNELS), dtype=bool)
        measured[..., :3] = np.isfinite(run.positions)
        sigma = np.concatenate([noise.position, noise.turn, noise.spin], axis=-1)
        sigma = np.broadcast_to(sigma, measured.shape).copy()
        self.tangents = {k: tangent for k, (_, tangent) in arcs(world, run).items()}
        for column, tangent in self.tangents.items():
            steepest = np.abs(tangent).argmax(axis=1)[:, None] == np.arange(3)
            measured[:, column, :3] &= steepest
            sigma[:, column, :3] = np.where(steepest, sigma[:, column, :3] * np.abs(tangent), 1.0)
        turned = np.isfinite(run.orientations).all(axis=-1) & np.array(
            ["#" not in name for name in run.names], dtype=bool
        )
        measured[..., 3:6] = turned[..., None] & (np.arange(3) == 2 if world.planar else True)
        measured[..., 6:] = np.isfinite(run.angular_velocities)
        self._oblique = world.planar and float(np.abs(self.normal).max()) < 1.0 - 1e-9
        if self._oblique:
            measured[..., :3] &= measured[..., :3].all(axis=-1, keepdims=True)
        if world.planar:
            measured[..., :3] &= np.abs(self.normal) < 1.0 - 1e-9  # heights above a motion plane cannot change
            measured[..., 6:] &= np.abs(self.normal) > 1e-9
        self.turned = turned
        self.sigma: Array = sigma.reshape(t, -1)
        self.measured: Bools = measured.reshape(t, -1)
        self.spread, self.shapes = spread, tuple(shapes)
        self._root = None if weight is None else np.sqrt(weight)
        self.size = int(self.measured.sum()) + sum(len(e.sample) * e.components for e in self.shapes)
        self._markers: dict[int, MaterialPoints] = {}
        for column, name in enumerate(run.names):
            if "#" in name:
                rows = np.flatnonzero(np.isfinite(run.positions[:, column]).all(axis=-1))
                if not len(rows):
                    raise ValueError(f"marker {name!r} of run {run.name!r} is never seen in all three components")
                mesh = mesh_of(world, world.deformable(owner(name)))
                self._markers[column] = material_points(mesh, run.positions[rows[0], column][None])

    def differences(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return simulated minus observed values (k, s, n, 9) of the first s instants; see `measured`."""
        run = self.run
        s = min(samples, batch.positions.shape[1], len(run.times))
        found = np.zeros((len(batch.positions), s, len(run.names), CHANNELS))
        columns = [batch.names.index(owner(name)) for name in run.names]
        places = batch.positions[:, :s][:, :, columns]
        for column, marker in self._markers.items():
            points = batch.deformables[owner(run.names[column])].points[:, :s]
            places[:, :, column] = marker.places(points)[..., 0, :]
        found[..., :3] = places - run.positions[:s]
        if self._oblique:
            found[..., :3] -= (found[..., :3] @ self.normal)[..., None] * self.normal
        found[..., 6:] = batch.angular_velocities[:, :s][:, :, columns] - run.angular_velocities[:s]
        for column in np.flatnonzero(self.turned[:s].any(axis=0)).tolist():
            rows = np.flatnonzero(self.turned[:s, column])
            simulated = batch.orientations[:, rows, columns[column]]
            observed = run.orientations[rows, column]
            order = run.symmetry[column]
            if self.planar:
                turn = turn_about(simulated, observed, self.normal, np.full(len(rows), max(order, 1)))
                found[:, rows, column, 5] = turn
            else:
                found[:, rows, column, 3:6] = smallest_rotation(simulated, observed, np.full(len(rows), order))
        return found

    def standardised(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return the same over standard deviations (k, s, 9 n), weighted."""
        found = self.differences(batch, samples)
        shape = found.shape
        s = shape[1]
        found = found.reshape(*shape[:2], self.measured.shape[1]) / self.sigma[:s]
        if self.spread is not None:
            sigma = self.sigma[:s].reshape(shape[1:])[..., 0]
            positions = found.reshape(shape)[..., :3]
            length = np.linalg.norm(self.spread[:s], axis=-1)
            direction = self.spread[:s] / np.maximum(length, 1e-300)[..., None]
            along = np.einsum("ktnc,tnc->ktn", positions, direction) * (1.0 - sigma / np.hypot(sigma, length))
            positions -= along[..., None] * direction
        weighted: Array = found if self._root is None else found * self._root[:s]
        return weighted

    def residuals(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return standardised residuals (k, m) within the first `samples` instants."""
        found = self.standardised(batch, samples)
        parts = [found[:, self.measured[: found.shape[1]]]]
        for e in self.shapes:
            own = e.standardised(batch, samples)
            parts.append((own * np.sqrt(e.weight[: own.shape[1], None])).reshape(len(own), -1))
        return np.concatenate(parts, axis=1) if self.shapes else parts[0]

    def owners(self, samples: int) -> list[str]:
        """Return the object to which each residual (m,) within the first `samples` instants belongs."""
        found = [owner(self.run.names[c // CHANNELS]) for c in np.nonzero(self.measured[:samples])[1]]
        for e in self.shapes:
            found += [e.object] * (int(np.searchsorted(e.sample, samples)) * e.components)
        return found

    def grid(self, residuals: Array) -> Array:
        """Return residuals (m,) of leading instants as (T, 9 n), NaN where nothing was measured or reached."""
        found = np.full(self.measured.shape, np.nan)
        reached = self.measured & (np.cumsum(self.measured).reshape(self.measured.shape) <= len(residuals))
        found[reached] = residuals
        return found

    def rows(self) -> Ints:
        """Return the instant (m,) that each residual belongs to."""
        return np.nonzero(self.measured)[0].astype(np.int64)

    def columns(self) -> Ints:
        """Return the channel (m,) that each residual belongs to."""
        return np.nonzero(self.measured)[1].astype(np.int64)


def arcs(world: World, run: Run) -> dict[int, tuple[Array, Array]]:
    """Return by column of what was measured as an angle its arc (T,) [m], NaN if unseen, and unit tangents (T, 3)."""
    found = {}
    for column in np.flatnonzero(np.isfinite(run.arms)).tolist():
        body, places = HingedBody.of(world, run.names[column]), run.positions[:, column]
        seen = np.isfinite(places).sum(axis=1) >= 2
        arm = np.where(seen[:, None], np.nan_to_num(places - body.anchor), body.arm)
        tangent, first = np.cross(body.axis, arm), np.cross(body.axis, body.arm)
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        arc = np.full(len(places), np.nan)
        arc[seen] = run.arms[column] * np.unwrap(np.arctan2(arm @ first, tangent @ first * run.arms[column])[seen])
        found[column] = arc, tangent
    return found


def tracks_readout(world: World, tracks: ObservedTracks, sigma: Array | None = None) -> RunReadout:
    """Return the readout of tracks and shapes. sigma (n,) [m]: of the positions of each track; default: as stated.

    A rotation has the sigma of the position over the radius of gyration, so that turning an object counts as much as
    the mean displacement of its substance. Observations before an object's start_time are left out, as are those of
    confidence 0, turns of balls and fluids, and of what looks the same at any angle about the plane's normal. Raises
    ValueError when no name matches, no frame is left, a frame number is negative, or the world has no such readout.
    """
    known, moving = tracks.observed_names, world.moving_names
    if not set(known) & set(moving):
        raise ValueError(f"no track belongs to an object of the world; tracks {list(known)}, objects {list(moving)}")
    if len(tracks.frames) == 0 or tracks.frames[0] < 0 or tracks.moments[0] < 0.0:
        raise ValueError("tracks must have at least one frame, and neither frame numbers nor times may be negative")
    shapes = [_shape(world, tracks, s) for s in tracks.shapes if s.object in moving]
    columns = [i for i, name in enumerate(tracks.names) if name in moving]
    names = [tracks.names[i] for i in columns]
    own = tracks.position_sigma[:, columns] if sigma is None else sigma[columns]
    normal = geometry.plane_axes(world.environment.motion_plane)[2] if world.planar else None
    spread = None if tracks.position_spread is None else tracks.position_spread[:, columns]
    if spread is not None and normal is not None:
        spread = spread - (spread @ normal)[..., None] * normal
    turns = [_turn_shows(world, n, tracks.symmetry[i]) for n, i in zip(names, columns, strict=True)]
    run = Run.of_tracks("tracks", tracks).columns(columns)
    present = _present(world, tracks, names)
    run = replace(
        run,
        times=sample_times(world, tracks),
        positions=np.where(present[..., None], run.positions, np.nan),
        orientations=np.where((present & np.array(turns, dtype=bool))[..., None], run.orientations, np.nan),
    )
    lengths = np.array([gyration_radius(world, n, normal) for n in names])
    position, turn = (np.repeat(v[..., None], 3, axis=-1) for v in (own, own / lengths))
    confidence = [c[:, columns, None] for c in (tracks.confidence, tracks.orientation_confidence, tracks.confidence)]
    weight = np.repeat(np.concatenate(confidence, axis=2), 3, axis=2).reshape(len(tracks.frames), -1)
    noise = RunNoise(position, turn, np.ones_like(position))
    return RunReadout(world, run, noise, weight=weight, spread=spread, shapes=shapes)


def _turn_shows(world: World, name: str, order: int) -> bool:
    """Return whether turns of an object of some symmetry are compared."""
    if name in {d.name for d in world.of_form("liquid")}:
        return False
    ball = world.is_rigid(name) and isinstance(world.object(name).shape, Sphere)
    return order != 0 or not (world.planar or ball)


def sample_times(world: World, tracks: ObservedTracks) -> Array:
    """Return the times (T,) [s] of the frames at the world's own seconds_per_frame."""
    times: Array = tracks.moments * world.time.seconds_per_frame
    return times


def _present(world: World, tracks: ObservedTracks, names: Sequence[str]) -> Bools:
    """Return which objects have joined at each frame (T, n). Fluids are there at once."""
    starts = [getattr(world.item(n), "start_time", 0.0) for n in names]
    present: Bools = sample_times(world, tracks)[:, None] >= np.array(starts) - 1e-9  # a frame's, rounded
    return present


def _shape(world: World, tracks: ObservedTracks, series: ShapeSeries) -> ShapeEntries:
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

    return ShapeEntries(
        readout.kind,
        series.object,
        sample,
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


class ObservedMotion:
    """Motion as a world's observer reports it at a run's stamps, from motion sampled about them."""

    def __init__(self, world: World, run: Run) -> None:
        self.observer, self.run = world.observer, run
        self.stamps: Array = run.times - run.times[0] + run.lead

    def __call__(self, batch: BatchTrajectory, parameters: Mapping[str, Array]) -> BatchTrajectory:
        """Return the batch at the stamps; parameters: paths `observer.*` -> values (k,)."""
        if not batch.positions.size:
            return batch
        of_run = (parameters, self.observer, self.run.name)
        seen, turned = observe(
            batch.positions, batch.orientations, batch.velocities, batch.angular_velocities, batch.times, self.stamps,
            *of_run,
        )  # fmt: skip
        spins = observed_spins(batch.angular_velocities, batch.times, self.stamps, *of_run)
        return replace(batch, positions=seen, orientations=turned, angular_velocities=spins)
