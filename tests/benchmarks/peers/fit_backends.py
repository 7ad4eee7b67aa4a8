"""Other forward models for the fit of a planar world: MuJoCo's batch, and straight lines with constant deceleration.

Each is made and run as `polyworld.solver.rollout.simulator` is, so that one search serves all of them.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.model.arrays import RigidArrays
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from polyworld.world.shapes import Box, Cylinder, Sphere

Array = NDArray[np.float64]

# Steps of MuJoCo in a frame of 0.028 s: 2.8 ms, near its default of 2 ms.
STEPS_OF_FRAME = 10
# Of contacts with restitution [1/s^2]: a half oscillation takes pi / sqrt(k), four steps of 2.8 ms.
STIFFNESS = (np.pi / 0.0112) ** 2


class Straight:
    """Objects on straight lines, slowed by friction alone until they stand, that pass through one another."""

    def __init__(self, world: World, sample_times: Array, *, n_worlds: int = 1) -> None:
        self.names, self.n_worlds = tuple(o.name for o in world.objects), n_worlds
        self._model, self._times = model_of(world), np.asarray(sample_times, dtype=float)
        self._gravity = float(np.linalg.norm(world.environment.gravity))

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """See `Simulator.run`."""
        arrays, w, n = self._model.arrays(overrides), self.n_worlds, len(self.names)
        times = self._times[:samples]
        velocity = _spread(arrays.velocity, w)[:, None]
        speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
        slowing = self._gravity * _spread(arrays.friction, w)[:, None, :, None]
        passed = np.minimum(times[None, :, None, None], speed / np.maximum(slowing, 1e-12))
        along = velocity / np.maximum(speed, 1e-12)
        positions = _spread(arrays.position, w)[:, None] + along * (speed * passed - 0.5 * slowing * passed**2)
        half = 0.5 * _spread(arrays.angular_velocity, w)[:, None, :, 2] * times[None, :, None]
        start = np.broadcast_to(_spread(arrays.orientation, w)[:, None], (w, len(times), n, 4))
        turned = _turned(start, half)
        return _batch(self.names, times, positions, turned, along * (speed - slowing * passed))


class Mujoco:
    """Free bodies on a floor in MuJoCo 4, a simulation each with parameters of its own (`mujoco.batch`).

    As in the planar world each body has its mass, Coulomb friction, spinning friction, linear and angular damping, and
    quadratic damping in each coordinate; restitution by a spring with the damping that returns it.
    """

    def __init__(self, world: World, sample_times: Array, *, n_worlds: int = 1, threads: int = 1) -> None:
        self.names, self.n_worlds = tuple(o.name for o in world.objects), n_worlds
        self._description, self._times = model_of(world), np.asarray(sample_times, dtype=float)
        frame = float(self._times[1] - self._times[0])
        if not np.allclose(np.diff(self._times), frame) or self._times[0] != 0.0:
            raise ValueError("MuJoCo is sampled at equally spaced times from 0 on")
        self._model = mujoco.MjModel.from_xml_string(_mjcf(world, frame / STEPS_OF_FRAME))
        self._unit_inertia = self._model.body_inertia[1:].copy()  # of mass 1
        self._batch = mujoco.batch.Batch(self._model, nsim=n_worlds, nthread=threads)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._fields = {
            name: self._batch.expand(name)
            for name in ("body_mass", "body_inertia", "geom_friction", "geom_solref", "dof_damping", "dof_dampingpoly")
        }

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """See `Simulator.run`."""
        times, n, w = self._times[:samples], len(self.names), self.n_worlds
        self._write(self._description.arrays(overrides))
        poses, rates = np.empty((w, len(times), n, 7)), np.empty((w, len(times), n, 6))
        for k in range(len(times)):
            if k:
                self._batch.step(nstep=STEPS_OF_FRAME)
            poses[:, k], rates[:, k] = self._qpos.reshape(w, n, 7), self._qvel.reshape(w, n, 6)
        return _batch(self.names, times, poses[..., :3], poses[..., 3:], rates[..., :3])

    def contacts(self) -> list[tuple[float, tuple[str, str]]]:
        """Return times [s] at which pairs of bodies touch, step by step, of the first simulation of the batch."""
        self._write(self._description.arrays(None))
        model, data = self._batch.get_model(0), self._batch.get_data(0)
        found = []
        while data.time < self._times[-1]:
            mujoco.mj_step(model, data)
            for pair in data.contact.geom:
                if 0 not in pair:
                    first, second = sorted(self.names[g - 1] for g in pair)
                    found.append((float(data.time), (first, second)))
        return found

    def _write(self, arrays: RigidArrays) -> None:
        """Fill states and parameters of all simulations."""
        fields, w, n = self._fields, self.n_worlds, len(self.names)
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        mass = _spread(arrays.mass, w)
        fields["body_mass"][:, 1:] = mass
        fields["body_inertia"][:, 1:] = mass[..., None] * self._unit_inertia
        friction = _spread(arrays.friction, w)
        fields["geom_friction"][:, 1:, 0] = friction
        fields["geom_friction"][:, 1:, 1] = friction * _spread(arrays.torsional_radius, w)
        fields["geom_solref"][:, 1:, 0] = -STIFFNESS
        fields["geom_solref"][:, 1:, 1] = -_damping(_spread(arrays.restitution, w))
        fields["dof_damping"][:].reshape(w, n, 6)[..., :3] = (mass * _spread(arrays.linear_damping, w))[..., None]
        inertia = fields["body_inertia"][:, 1:]
        fields["dof_damping"][:].reshape(w, n, 6)[..., 3:] = _spread(arrays.angular_damping, w)[..., None] * inertia
        rate = _spread(arrays.effect_parameters, w).reshape(w, -1)[:, :1] if len(arrays.effect_kind) else 0.0
        fields["dof_dampingpoly"][:].reshape(w, n, 6, -1)[..., :3, 0] = (mass * rate)[..., None]
        self._batch.set_const()
        pose, rates = self._qpos.reshape(w, n, 7), self._qvel.reshape(w, n, 6)
        pose[..., :3], pose[..., 3:] = _spread(arrays.position, w), _spread(arrays.orientation, w)
        rates[..., :3], rates[..., 3:] = _spread(arrays.velocity, w), _spread(arrays.angular_velocity, w)


def _mjcf(world: World, step: float) -> str:
    bodies = []
    for item in world.objects:
        shape = item.shape
        if isinstance(shape, Sphere):
            geom = f'type="sphere" size="{shape.radius}"'
        elif isinstance(shape, Cylinder):
            geom = f'type="cylinder" size="{shape.radius} {shape.half_height}"'
        elif isinstance(shape, Box):
            geom = 'type="box" size="{} {} {}"'.format(*shape.half_extents)
        else:
            raise TypeError(f"{item.name}: spheres, cylinders and boxes are written for MuJoCo, not {shape.kind}")
        place = "{} {} {}".format(*item.position)
        bodies.append(f'<body pos="{place}"><freejoint/><geom {geom} mass="1" condim="4"/></body>')
    return f"""<mujoco>
<option timestep="{step}" cone="elliptic" integrator="implicitfast"/>
<worldbody><geom type="plane" size="50 50 1" friction="0 0 0"/>{"".join(bodies)}</worldbody>
</mujoco>"""


def _restitution(ratio: Array) -> Array:
    """Return the restitution of a damped spring that pushes and never pulls, at damping ratios other than 1.

    Schwager & Poeschel, Granular Matter 9 (2007) 465: the contact ends where the force falls to zero.
    """
    below = np.sqrt(np.maximum(1.0 - ratio**2, 1e-12))
    above = np.sqrt(np.maximum(ratio**2 - 1.0, 1e-12))
    slow = ratio / below * (np.pi - np.arctan2(2.0 * ratio * below, below**2 - ratio**2))
    fast = ratio / above * np.log((ratio + above) / np.maximum(ratio - above, 1e-12))
    found: Array = np.exp(-np.where(ratio < 1.0, slow, fast))
    return found


RATIOS = np.geomspace(1e-3, 4.001, 2000)  # the last returns 1% of a speed
RESTITUTIONS = _restitution(RATIOS)


def _damping(restitution: Array) -> Array:
    """Return the damping [1/s] with which a contact's spring returns a restitution."""
    damping: Array = 2.0 * np.sqrt(STIFFNESS) * np.interp(-restitution, -RESTITUTIONS, RATIOS)
    return damping


def _spread(values: Array, worlds: int) -> Array:
    return np.broadcast_to(values, (worlds, *values.shape[1:]))


def _turned(orientation: Array, half: Array) -> Array:
    """Turn quaternions (..., 4) about z by twice an angle."""
    c, s = np.cos(half), np.sin(half)
    w, x, y, z = np.moveaxis(orientation, -1, 0)
    return np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)


def _batch(
    names: tuple[str, ...], times: Array, positions: Array, orientations: Array, velocities: Array
) -> BatchTrajectory:
    worlds, count, n = positions.shape[:3]
    broken = ~np.isfinite(positions).all(axis=(1, 2, 3))
    return BatchTrajectory(
        names=names,
        times=np.repeat(times[None], worlds, axis=0),
        positions=positions,
        orientations=orientations,
        velocities=np.broadcast_to(velocities, positions.shape),
        angular_velocities=np.zeros_like(positions),
        active=np.ones((count, n), dtype=bool),
        diverged=broken,
        diverged_time=np.where(broken, 0.0, np.nan),
        diverged_object=np.where(broken, 0, -1),
        events=((),) * worlds,
    )
