"""A forward model solved in closed form: bodies thrown in a linear drag, turning about z and slowing down.

dv/dt = g - c v and domega/dt = -d omega, c and d being linear_damping and angular_damping; nothing collides.
It stands in for the engine where a test is about the search, not about contacts.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.model import model_of
from polyworld.trajectory import BatchTrajectory
from polyworld.world import TimeBase, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

Array = NDArray[np.float64]


class ClosedForm:
    def __init__(self, world: World, sample_times: Array, *, n_worlds: int) -> None:
        self.world, self.sample_times, self.n_worlds = world, np.asarray(sample_times), n_worlds
        self.names = tuple(o.name for o in world.objects)
        self.runs = 0

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        self.runs += 1
        a = model_of(self.world).arrays(overrides)
        w = self.n_worlds
        full = [
            np.broadcast_to(f, (w, *f.shape[1:]))
            for f in (a.position, a.velocity, a.linear_damping, a.angular_damping, a.orientation, a.angular_velocity)
        ]
        position, velocity, c, d, orientation, spin = full
        gravity = np.broadcast_to(a.gravity, (w, 3))[:, None, None, :]
        start = np.array([o.start_time for o in self.world.objects])
        scale = np.broadcast_to(a.time_scale, (w, 1))
        times = scale * self.sample_times[None, :samples]
        t = np.maximum(times[:, :, None] - start * scale[:, :, None], 0.0)[..., None]
        c, d = np.maximum(c, 1e-9)[:, None, :, None], np.maximum(d, 1e-9)[:, None, :, None]
        decay = -np.expm1(-c * t) / c
        positions = position[:, None] + velocity[:, None] * decay + gravity * (t - decay) / c
        angle = spin[:, None] * -np.expm1(-d * t) / d
        orientations = geometry.quaternion_product(
            geometry.rotation_quaternion(angle), np.broadcast_to(orientation[:, None], (*angle.shape[:-1], 4))
        )
        return BatchTrajectory(
            names=self.names,
            times=times,
            positions=positions,
            orientations=orientations,
            velocities=np.zeros_like(positions),
            angular_velocities=np.zeros_like(positions),
            active=times[0][:, None] >= start - 1e-9,
            diverged=np.zeros(w, dtype=bool),
            diverged_time=np.full(w, np.nan),
            diverged_object=np.full(w, -1, dtype=np.int64),
            events=((),) * w,
        )


def thrown_ball(**changes: object) -> World:
    """A ball thrown in a viscous medium, 25 frames of 0.04 s."""
    ball = {
        "name": "ball",
        "shape": Sphere(radius=0.1),
        "position": (0.0, 0.0, 1.0),
        "velocity": (2.0, 1.0, 3.0),
        "angular_velocity": (0.0, 0.0, 2.0),
        "linear_damping": 0.5,
        "angular_damping": 0.3,
    }
    return World(objects=(RigidObject(**{**ball, **changes}),), time=TimeBase(seconds_per_frame=0.04, frame_count=25))


def observe(
    world: World,
    *,
    frames: int = 25,
    sigma: float = 0.01,
    turn_sigma: float = 0.05,
    seed: int = 0,
    symmetry: int = 1,
) -> ObservedTracks:
    """Tracks of a world as `ClosedForm` moves it, with white noise on positions [m] and rotations [rad]."""
    rng = np.random.default_rng(seed)
    step = world.time.seconds_per_frame
    truth = ClosedForm(world, np.arange(frames) * step, n_worlds=1).run().world(0)
    n = len(truth.names)
    turns = geometry.rotation_quaternion(rng.normal(0.0, turn_sigma, (frames, n, 3)))
    return ObservedTracks(
        names=truth.names,
        frames=np.arange(frames),
        seconds_per_frame=step,
        positions=truth.positions + rng.normal(0.0, sigma, truth.positions.shape),
        position_sigma=np.full((frames, n), sigma),
        orientations=geometry.quaternion_product(turns, truth.orientations),
        confidence=np.where(truth.active, 1.0, 0.0),
        orientation_confidence=np.where(truth.active, 1.0, 0.0),
        symmetry=(symmetry,) * n,
    )
