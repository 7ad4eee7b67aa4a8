"""Compiling every kernel ahead of time: later calls then start in milliseconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from polyworld.render import render
from polyworld.representations.rigid import RigidObject
from polyworld.rollout import rollout
from polyworld.shapes import Box, Plane, Sphere, TriangleMesh
from polyworld.world import StaticObject, World


def warm_up() -> Iterator[tuple[str, float]]:
    """Run each kind of work once on a tiny world; yields its name and how long it took [s]."""
    for name, work in (
        ("planar worlds", lambda: _roll("rigid_planar")),
        ("spatial worlds", lambda: _roll("rigid_spatial")),
        ("pictures", _draw),
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


def _draw() -> None:
    world = _world("rigid_spatial")
    render(
        world,
        np.array([item.position for item in world.objects]),
        np.array([item.orientation for item in world.objects]),
    )
