"""Compare simulated motion with a run of a recording: positions, turns and spins at its own instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Run
from polyworld.estimation.noise import RunNoise
from polyworld.estimation.rotation_counting import counted_angles, counted_vectors
from polyworld.model import mesh_of
from polyworld.probing.readouts.material_points import MaterialPoints, material_points
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World, geometry
from polyworld.world.observer import observe, observed_spins
from polyworld.world.symmetry import smallest_rotation, turn_about

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

CHANNELS = 9  # of an object: position, turn, spin


def owner(name: str) -> str:
    """Return the object that a recorded name belongs to: itself, or of a marker `NAME#k` the deformable object."""
    return name.split("#", 1)[0]


class RunReadout:
    """Standardised residuals of a run, in the order of time.

    Channels (9 n): of each object three of position, three of the turn from the observed to the simulated orientation
    (in planar worlds one, about the normal), three of spin. measured (T, 9 n): which were.
    """

    def __init__(self, world: World, run: Run, noise: RunNoise) -> None:
        t, n = len(run.times), len(run.names)
        self.run, self.planar = run, world.planar
        self.normal = geometry.plane_axes(world.environment.motion_plane)[2]
        measured = np.zeros((t, n, CHANNELS), dtype=bool)
        measured[..., :3] = np.isfinite(run.positions)
        turned = np.isfinite(run.orientations).all(axis=-1) & np.array(["#" not in name for name in run.names])
        measured[..., 3:6] = turned[..., None] & (np.arange(3) == 2 if world.planar else True)
        measured[..., 6:] = np.isfinite(run.angular_velocities)
        if world.planar:
            measured[..., :3] &= np.abs(self.normal) < 1.0 - 1e-9  # heights above a motion plane cannot change
            measured[..., 6:] &= np.abs(self.normal) > 1e-9
        self.turned = turned
        sigma = np.concatenate([noise.position, noise.turn, noise.spin], axis=1)
        self.sigma = sigma.reshape(-1)  # (9 n,)
        self.measured: Bools = measured.reshape(t, -1)
        self.size = int(self.measured.sum())
        self._markers: dict[int, MaterialPoints] = {}
        for column, name in enumerate(run.names):
            if "#" in name:
                rows = np.flatnonzero(np.isfinite(run.positions[:, column]).all(axis=-1))
                if not len(rows):
                    raise ValueError(f"marker {name!r} of run {run.name!r} is never seen in all three components")
                mesh = mesh_of(world, world.deformable(owner(name)))
                self._markers[column] = material_points(mesh, run.positions[rows[0], column][None])

    def residuals(self, batch: BatchTrajectory, samples: int) -> Array:
        """Return standardised residuals (k, m) within the first `samples` instants."""
        run = self.run
        s = min(samples, batch.positions.shape[1], len(run.times))
        k, n = len(batch.positions), len(run.names)
        found = np.zeros((k, s, n, CHANNELS))
        columns = [batch.names.index(owner(name)) for name in run.names]
        places = batch.positions[:, :s][:, :, columns]
        for column, marker in self._markers.items():
            points = batch.deformables[owner(run.names[column])].points[:, :s]
            places[:, :, column] = marker.places(points)[..., 0, :]
        found[..., :3] = places - run.positions[:s]
        found[..., 6:] = batch.angular_velocities[:, :s][:, :, columns] - run.angular_velocities[:s]
        for column in np.flatnonzero(self.turned[:s].any(axis=0)).tolist():
            rows = np.flatnonzero(self.turned[:s, column])
            simulated = batch.orientations[:, rows, columns[column]]
            observed = run.orientations[rows, column]
            order = run.symmetry[column]
            if self.planar:
                turn = turn_about(simulated, observed, self.normal, np.full(len(rows), max(order, 1)))
                found[:, rows, column, 5] = counted_angles(turn, np.pi / max(order, 1))
                continue
            vectors = smallest_rotation(simulated, observed, np.full(len(rows), order))
            if order == 1:
                vectors = counted_vectors(vectors, simulated, observed)
            found[:, rows, column, 3:6] = vectors
        standardised: Array = found.reshape(k, s, -1) / self.sigma
        chosen: Array = standardised[:, self.measured[:s]]
        return chosen

    def grid(self, residuals: Array) -> Array:
        """Return residuals (m,) of leading instants as (T, 9 n), NaN where nothing was measured or reached."""
        found = np.full(self.measured.shape, np.nan)
        reached = self.measured & (np.cumsum(self.measured).reshape(self.measured.shape) <= len(residuals))
        found[reached] = residuals
        return found

    def rows(self) -> NDArray[np.int64]:
        """Return the instant (m,) that each residual belongs to."""
        return np.nonzero(self.measured)[0].astype(np.int64)

    def columns(self) -> NDArray[np.int64]:
        """Return the channel (m,) that each residual belongs to."""
        return np.nonzero(self.measured)[1].astype(np.int64)


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
