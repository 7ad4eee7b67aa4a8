"""Small planar worlds the verification cases are made of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.solver.rollout import simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Cylinder, Plane

Array = NDArray[np.float64]
G = 9.81

SIDE_VIEW = MotionPlane(normal=(0.0, -1.0, 0.0))  # plane x = world x, plane y = world z


def disc(radius: float = 0.2) -> Cylinder:
    """An upright cylinder: a disc for a world seen from above."""
    return Cylinder(radius=radius, half_height=0.2)


def body(name: str, shape: Any, position: tuple[float, float, float], **fields: Any) -> RigidObject:
    """A planar object, frictionless by default."""
    return RigidObject(
        name=name, representation="rigid_planar", shape=shape, position=position, **{"friction": 0.0, **fields}
    )


def top_view(*objects: RigidObject, gravity: float = G, substep: float = 0.002, **fields: Any) -> World:
    """Objects sliding on a table."""
    environment = Environment(gravity=(0.0, 0.0, -gravity), motion_plane=fields.pop("motion_plane", MotionPlane()))
    return World(objects=objects, environment=environment, time=TimeBase(substep=substep), **fields)


def side_view(
    *objects: RigidObject,
    slope: float = 0.0,
    substep: float = 0.002,
    gravity: float = G,
    **floor: Any,
) -> World:
    """Objects on a floor at z = 0, gravity tilted by `slope` [rad] towards +x."""
    environment = Environment(
        gravity=(gravity * float(np.sin(slope)), 0.0, -gravity * float(np.cos(slope))), motion_plane=SIDE_VIEW
    )
    statics = (StaticObject(name="floor", shape=Plane(), **floor),)
    return World(objects=objects, statics=statics, environment=environment, time=TimeBase(substep=substep))


def run(world: World, end: float, interval: float = 0.01, **fields: Any) -> BatchTrajectory:
    """One run, sampled at equal intervals."""
    times = np.arange(round(end / interval) + 1) * interval
    return simulator(world, times, record_events=True, threads=1, **fields).run()
