"""Clips of pucks on a table by SciPy, from event to event (`tests.scenes.discs`), with noise; and their worlds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.study import StudyRun
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.description import Appearance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Cylinder
from tests.scenes.discs import Discs, Law, Started, slide

Array = NDArray[np.float64]

RADIUS, FRAME, SIGMA = 0.1, 1.0 / 30.0, 0.004  # [m], [s], [m]
CROSSING = Started(  # they meet off centre after 0.5 s
    np.array([[-0.75, 0.0], [0.75, 0.06]]), np.array([[1.7, 0.0], [-1.9, 0.0]]), np.zeros(2)
)


def discs(
    friction: Sequence[float],
    *,
    restitution: float = 0.7,
    masses: Sequence[float] | None = None,
    forces: tuple[Law, ...] = (),
) -> Discs:
    """Pucks with coefficients of friction on the table."""
    count = len(friction)
    return Discs(
        np.ones(count) if masses is None else np.array(masses),
        np.full(count, RADIUS),
        np.array(friction),
        restitution,
        forces=forces,
    )


def names(count: int) -> tuple[str, ...]:
    """Names of the pucks."""
    return tuple("abcdef"[:count])


def tracks(path: Array, *, sigma: float = SIGMA, seed: int = 0) -> ObservedTracks:
    """Places (T, n, 2) measured with noise; rotations not."""
    count, n = path.shape[:2]
    seen = np.zeros((count, n, 3))
    seen[..., :2] = path[..., :2] + np.random.default_rng(seed).normal(0.0, sigma, (count, n, 2))
    seen[..., 2] = 0.05
    return ObservedTracks(
        names=names(n),
        frames=np.arange(count),
        seconds_per_frame=FRAME,
        positions=seen,
        position_sigma=np.full((count, n), sigma),
        orientations=np.full((count, n, 4), np.nan),
        confidence=np.ones((count, n)),
        orientation_confidence=np.zeros((count, n)),
        symmetry=(0,) * n,
    )


def world(
    count: int, *, masses: Sequence[float | None] | None = None, materials: Sequence[str | None] | None = None
) -> World:
    """Pucks on a table of which nothing is known but sizes, masses and materials, where given."""
    objects = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=Cylinder(radius=RADIUS, half_height=0.05),
            mass=mass,
            position=(0.0, 0.0, 0.05),
            appearance=Appearance(material=material),
        )
        for name, mass, material in zip(names(count), masses or [1.0] * count, materials or [None] * count, strict=True)
    )
    return World(
        objects=objects,
        environment=Environment(motion_plane=MotionPlane(friction=0.5 if count > 1 else None)),
        time=TimeBase(seconds_per_frame=FRAME),
    )


def clip(
    hidden: Discs,
    start: Started,
    frames: int,
    *,
    seed: int = 0,
    name: str = "clip",
    materials: Sequence[str] | None = None,
    sigma: float = SIGMA,
) -> StudyRun:
    """A clip of pucks whose masses are given."""
    path = slide(hidden, start, np.arange(frames) * FRAME)
    described = world(len(hidden.masses), masses=[float(m) for m in hidden.masses], materials=materials)
    return StudyRun(name, described, tracks(path, sigma=sigma, seed=seed))
