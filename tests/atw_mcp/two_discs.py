"""A case with a committed world whose motion is known exactly: a disc meets an equal one at rest, without friction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from atw_mcp.calls.app import App
from evidence_store import Case
from polyworld.pictures.render import look_at
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Cylinder

SPEED, GAP, RADIUS = 1.0, 0.8, 0.1
MEETING = GAP / SPEED  # [s]
FRAME = 0.02  # [s]


def two_discs() -> World:
    """`striker` moves along +x at SPEED and meets `target` at MEETING; elastic, so it stops and the target leaves."""
    shape = Cylinder(radius=RADIUS, half_height=0.05)
    disc = {"representation": "rigid_planar", "shape": shape, "friction": 0.0, "restitution": 1.0, "mass": 1.0}
    return World(
        objects=(
            RigidObject(name="striker", position=(0.0, 0.0, 0.05), velocity=(SPEED, 0.0, 0.0), **disc),
            RigidObject(name="target", position=(GAP + 2 * RADIUS, 0.0, 0.05), **disc),
        ),
        environment=Environment(motion_plane=MotionPlane()),
        time=TimeBase(seconds_per_frame=FRAME, frame_count=61, substep=0.002),
        camera=look_at(np.array([0.7, -3.0, 2.0]), np.array([0.7, 0.0, 0.0]), focal=350.0, width=320, height=240),
    )


def case_with(app: App, world: World, *, committed: bool, video: Path | None = None, name: str = "discs") -> Case:
    """A case whose only world is `world`."""
    path = str(video or "discs.csv")
    app.store.cases.add(
        name, content=f"content of {path}", kind="video" if video else "data", path=path, facts={"bytes": 1}
    )
    case = app.store.cases.get(name)
    app.keep_world(case, world, how="built")
    if committed:
        app.store.cases.commit_world(case.id, world.id)
    return app.store.cases.get(name)
