"""Short-hand for the small spatial worlds that the verification cases run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.model import model_of
from polyworld.solver.spatial.simulator import SpatialSimulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Effect, Environment, StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]
FLOOR = StaticObject(name="floor", shape=Plane())  # takes friction and restitution of what touches it


def slope(angle: float) -> StaticObject:
    """A plane through the origin that falls towards +x by `angle` [rad]."""
    return StaticObject(name="slope", shape=Plane(normal=(np.sin(angle), 0.0, np.cos(angle))))


def body(name: str, shape: Any, position: Any, **fields: Any) -> RigidObject:
    """A spatial object of 1 kg by default."""
    fields.setdefault("mass", 1.0)
    vectors = {k: tuple(map(float, v)) if np.ndim(v) else v for k, v in fields.items()}
    return RigidObject(name=name, shape=shape, position=tuple(map(float, position)), **vectors)


def make_world(
    *objects: RigidObject,
    statics: tuple[StaticObject, ...] = (FLOOR,),
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY),
    substep: float = 0.002,
    effects: tuple[Effect, ...] = (),
) -> World:
    return World(
        objects=objects,
        statics=statics,
        environment=Environment(gravity=gravity),
        effects=effects,
        time=TimeBase(substep=substep),
    )


def run(
    world: World,
    duration: float,
    *,
    samples: int = 101,
    n_worlds: int = 1,
    overrides: Mapping[str, Array] | None = None,
    threads: int = 1,
) -> BatchTrajectory:
    """The world's motion at `samples` equally spaced times from 0 to `duration` [s], events recorded."""
    times = np.linspace(0.0, duration, samples)
    simulator = SpatialSimulator(model_of(world), times, n_worlds=n_worlds, record_events=True, threads=threads)
    return simulator.run(overrides)
