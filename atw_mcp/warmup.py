"""Compiling every kernel ahead of time: later calls then start in milliseconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from polyworld.pictures.render import render
from polyworld.probing.effect_accelerations import effect_accelerations
from polyworld.solver.rollout import rollout
from polyworld.world import Effect, StaticObject, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane, Sphere, TriangleMesh

MATERIALS: dict[str, dict[str, Any]] = {
    "rope": {
        "deformables": [
            {"name": "rope", "representation": "rope", "points": [[0, 0.3, 0.5], [0.3, 0.3, 0.5]], "segments": 6}
        ],
        "pulleys": [{"name": "wheel", "rope": "rope", "centre": [0.15, 0.3, 0.7], "radius": 0.05, "after": 0}],
        "attachments": [{"name": "knot", "object": "rope", "end": "start", "to": "ball"}],
    },
    "cloth": {
        "deformables": [
            {
                "name": "cloth",
                "representation": "cloth",
                "geometry": {
                    "kind": "sheet",
                    "corner": [0, 0, 0.22],
                    "edge_u": [0.3, 0, 0],
                    "edge_v": [0, 0.3, 0],
                    "divisions": [3, 3],
                },
            }
        ]
    },
    "soft": {
        "deformables": [
            {
                "name": "soft",
                "representation": "soft",
                "shape": {"kind": "box", "half_extents": [0.1, 0.1, 0.1]},
                "position": [0, 0.6, 0.1],
                "resolution": 0.1,
            }
        ]
    },
    "fluid": {
        "deformables": [
            {
                "name": "fluid",
                "representation": "fluid",
                "volumes": [{"shape": {"kind": "box", "half_extents": [0.2, 0.2, 0.1]}, "position": [0, 0, 0.1]}],
            }
        ],
        "fluid_grid": {"lower": [-0.4, -0.4, 0], "upper": [0.4, 0.4, 0.4], "cell": 0.1},
    },
}


def warm_up() -> Iterator[tuple[str, float]]:
    """Run each kind of work once on a tiny world; yields its name and how long it took [s]."""
    for name, work in (
        ("planar worlds", lambda: _roll("rigid_planar")),
        ("spatial worlds", lambda: _roll("rigid_spatial")),
        ("joints", _roll_jointed),
        ("ropes", lambda: _roll_deformable("rope")),
        ("cloth", lambda: _roll_deformable("cloth")),
        ("soft bodies", lambda: _roll_deformable("soft")),
        ("fluids", lambda: _roll_deformable("fluid")),
        ("pictures", _draw),
        ("reports", _push),
    ):
        yield name, _timed(work)


def _timed(work: Callable[[], None]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _world(representation: str) -> World:
    ball = {"name": "ball", "representation": representation, "shape": Sphere(radius=0.1), "position": (0.0, 0.0, 0.1)}
    box = {
        "name": "box",
        "representation": representation,
        "shape": Box(half_extents=(0.1, 0.1, 0.1)),
        "position": (0.25, 0.0, 0.1),
        "velocity": (-1.0, 0.0, 0.0),
    }
    ramp = TriangleMesh(vertices=((2, 0, 0), (3, 0, 0), (2, 1, 1)), faces=((0, 1, 2),))
    statics: tuple[StaticObject, ...] = ()
    if representation == "rigid_spatial":
        statics = (StaticObject(name="floor", shape=Plane()), StaticObject(name="ramp", shape=ramp))
    return World(objects=tuple(RigidObject.model_validate(item) for item in (ball, box)), statics=statics)


def _roll(representation: str) -> None:
    rollout(_world(representation), 0.2)


def _roll_jointed() -> None:
    """A ball on a hinge, and a box that hangs on it."""
    joints = (
        {"kind": "hinge", "name": "pivot", "object": "ball", "anchor": (0.0, 0.0, 0.4)},
        {"kind": "ball", "name": "elbow", "object": "box", "other": "ball", "anchor": (0.0, 0.0, 0.1)},
    )
    rollout(World.model_validate({**_world("rigid_spatial").model_dump(), "joints": joints}), 0.05)


def _roll_deformable(kind: str) -> None:
    """One deformable object falling on a box on the floor, for a few steps."""
    world = World.model_validate({**_world("rigid_spatial").model_dump(), **MATERIALS[kind]})
    rollout(world, 0.05)


def _push() -> None:
    """The acceleration that an effect gives, which a report shows."""
    wind = Effect(name="wind", kind="wind", parameters={"coefficient": 0.1, "velocity_x": 1.0})
    world = _world("rigid_spatial").model_copy(update={"effects": (wind,)})
    effect_accelerations(world, rollout(world, 0.05))


def _draw() -> None:
    everything = {key: value for parts in MATERIALS.values() for key, value in parts.items()}
    everything["deformables"] = [item for parts in MATERIALS.values() for item in parts["deformables"]]
    world = World.model_validate({**_world("rigid_spatial").model_dump(), **everything})
    n = len(world.moving_names)
    render(world, np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)))
