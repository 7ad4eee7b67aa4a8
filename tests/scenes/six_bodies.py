"""Two cylinders, two balls and two cubes sliding and colliding on a plane."""

from __future__ import annotations

from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere

DURATION = 5.0  # [s]
SUBSTEP = 0.002  # [s]
FRICTION = 0.3
RESTITUTION = 0.5
MASS = 1.0  # [kg]
RADIUS = 0.2  # [m] of balls and cylinders; half the edge of the cubes

# name, kind, position on the plane [m], velocity [m/s]: three pairs that run into each other near the middle.
BODIES = (
    ("cylinder_a", "cylinder", (-1.6, 0.1), (2.5, 0.0)),
    ("cylinder_b", "cylinder", (1.6, -0.1), (-2.0, 0.2)),
    ("ball_a", "sphere", (-0.2, -1.6), (0.3, 2.2)),
    ("ball_b", "sphere", (0.3, 1.6), (0.0, -2.4)),
    ("cube_a", "box", (-1.3, -1.3), (1.8, 1.7)),
    ("cube_b", "box", (1.4, 1.3), (-1.9, -1.6)),
)


def six_body_world(*, planar: bool) -> World:
    """The scene as a world of planar or of spatial objects."""
    shapes = {
        "sphere": Sphere(radius=RADIUS),
        "cylinder": Cylinder(radius=RADIUS, half_height=RADIUS),
        "box": Box(half_extents=(RADIUS, RADIUS, RADIUS)),
    }
    objects = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar" if planar else "rigid_spatial",
            shape=shapes[kind],
            mass=MASS,
            friction=FRICTION,
            restitution=RESTITUTION,
            position=(x, y, RADIUS),
            velocity=(u, v, 0.0),
        )
        for name, kind, (x, y), (u, v) in BODIES
    )
    floor = StaticObject(name="floor", shape=Plane(), friction=FRICTION, restitution=RESTITUTION)
    return World(
        objects=objects,
        statics=(floor,),
        environment=Environment(motion_plane=MotionPlane(friction=FRICTION)),
        time=TimeBase(seconds_per_frame=0.04, frame_count=int(DURATION / 0.04), substep=SUBSTEP),
    )
