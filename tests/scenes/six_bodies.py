"""Two cylinders, two balls and two cubes sliding and colliding on a plane, for this engine and for MuJoCo."""

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


def six_body_mjcf() -> str:
    """The same scene as MuJoCo XML: equal shapes, masses, friction, gravity and step.

    MuJoCo has no coefficient of restitution: its contacts are left at their default, nearly inelastic damping.
    """
    sizes = {"sphere": f"{RADIUS}", "cylinder": f"{RADIUS} {RADIUS}", "box": f"{RADIUS} {RADIUS} {RADIUS}"}
    bodies = "\n".join(
        f'<body name="{name}" pos="{x} {y} {RADIUS}"><freejoint/>'
        f'<geom type="{kind}" size="{sizes[kind]}" mass="{MASS}" friction="{FRICTION} 0 0"/></body>'
        for name, kind, (x, y), _ in BODIES
    )
    return f"""<mujoco>
<option timestep="{SUBSTEP}" gravity="0 0 -9.81" cone="elliptic"/>
<worldbody>
<geom name="floor" type="plane" size="10 10 0.1" friction="{FRICTION} 0 0"/>
{bodies}
</worldbody>
</mujoco>"""


def initial_velocities() -> list[tuple[float, float]]:
    """Velocities of the bodies in the plane, in the order of `BODIES` [m/s]."""
    return [velocity for *_, velocity in BODIES]
