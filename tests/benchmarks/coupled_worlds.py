"""Eight scenes in which materials act on each other, as world descriptions."""

from __future__ import annotations

from typing import Any

from polyworld.world import StaticObject, TimeBase, World
from polyworld.world.description import Appearance
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Container, Emitter, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Compound, Part, Plane, Sphere

FLOOR = StaticObject(name="floor", shape=Plane())
TIME = TimeBase(seconds_per_frame=0.04)
STONE, WOOD = 2500.0, 500.0  # [kg/m^3]
GLASS = Appearance(color="silver", material="glass")
WIRE = Appearance(color="gold")


def block(x: float, y: float, z: float, position: tuple[float, float, float]) -> FluidVolume:
    """Return a box of fluid of half edges x, y, z [m]."""
    return FluidVolume(shape=Box(half_extents=(x, y, z)), position=position)


def rigid(name: str, shape: Any, position: tuple[float, float, float], color: str, **fields: Any) -> RigidObject:
    """Return a rigid body that does not bounce much."""
    given = {"restitution": 0.2, **fields}
    return RigidObject(name=name, shape=shape, position=position, appearance=Appearance(color=color), **given)


def ball_on_cloth() -> World:
    """A ball falls on a sheet that is held by its four corners."""
    cloth = Cloth(
        name="sheet",
        geometry=Sheet(corner=(-0.5, -0.5, 0.8), edge_u=(1.0, 0.0, 0.0), edge_v=(0.0, 1.0, 0.0), divisions=(16, 16)),
        stretch_stiffness=800.0,
        stretch_damping=0.01,
        linear_damping=0.1,
        appearance=Appearance(color="red"),
    )
    corners = {f"corner_{i}": (x, y) for i, (x, y) in enumerate(((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)))}
    return World(
        objects=(rigid("ball", Sphere(radius=0.12), (0.04, 0.02, 1.3), "blue", density=250.0),),
        deformables=(cloth,),
        attachments=tuple(
            Attachment(
                name=name,
                object="sheet",
                region=Region(lower=(x - 0.01, y - 0.01, 0.7), upper=(x + 0.01, y + 0.01, 0.9)),
            )
            for name, (x, y) in corners.items()
        ),
        statics=(FLOOR,),
        time=TIME,
    )


def rope_over_pulley() -> World:
    """Two loads on one rope over a wheel with friction in its bearing: the heavier one sinks to the floor."""
    loads = (
        rigid("light", Box(half_extents=(0.08, 0.08, 0.08)), (-0.15, 0.0, 0.62), "red", mass=1.0),
        rigid("heavy", Sphere(radius=0.1), (0.15, 0.0, 0.6), "blue", mass=1.4),
    )
    rope = Rope(
        name="cord",
        points=((-0.15, 0.0, 0.7), (0.15, 0.0, 0.7)),
        radius=0.01,
        linear_density=0.05,
        bending_stiffness=1e-4,
        stretch_damping=0.005,
        linear_damping=0.2,
        appearance=WIRE,
    )
    return World(
        objects=loads,
        deformables=(rope,),
        attachments=(
            Attachment(name="tie_light", object="cord", end="start", to="light"),
            Attachment(name="tie_heavy", object="cord", end="end", to="heavy"),
        ),
        pulleys=(
            Pulley(
                name="wheel",
                rope="cord",
                centre=(0.0, 0.0, 1.6),
                radius=0.15,
                after=0,
                bearing_friction=0.1,
                bearing_damping=0.02,
                inertia=0.005,
            ),
        ),
        statics=(FLOOR,),
        time=TIME,
    )


def soft_on_soft() -> World:
    """A soft ball falls on a soft block."""
    block_of_jelly = Soft(
        name="cushion",
        shape=Box(half_extents=(0.2, 0.2, 0.1)),
        position=(0.0, 0.0, 0.1),
        youngs_modulus=3e4,
        damping=0.01,
        appearance=Appearance(color="green"),
    )
    ball = Soft(
        name="ball",
        shape=Sphere(radius=0.12),
        position=(0.02, 0.0, 0.7),
        youngs_modulus=2e4,
        damping=0.01,
        density=600.0,
        appearance=Appearance(color="orange"),
    )
    return World(deformables=(block_of_jelly, ball), statics=(FLOOR,), time=TIME)


def floating_and_sinking() -> World:
    """A wooden and a stone cube dropped into a tank."""
    cube = Box(half_extents=(0.06, 0.06, 0.06))
    return World(
        objects=(
            rigid("wood", cube, (-0.14, 0.0, 0.36), "brown", density=WOOD),
            rigid("stone", cube, (0.14, 0.02, 0.36), "gray", density=STONE),
        ),
        deformables=(Fluid(name="water", volumes=(block(0.32, 0.2, 0.12, (0.0, 0.0, 0.12)),)),),
        fluid_grid=FluidGrid(lower=(-0.32, -0.2, 0.0), upper=(0.32, 0.2, 0.52), cell=0.04),
        statics=(FLOOR, *glass_walls(0.32, 0.2, 0.5)),
        time=TIME,
    )


def pouring_into_a_bucket() -> World:
    """A tap fills a bucket that hangs on a hinge; the jet is off its middle."""
    half, wall = (0.12, 0.12, 0.1), 0.012
    sides = (
        Part(shape=Box(half_extents=(half[0], half[1], wall / 2)), position=(0.0, 0.0, -half[2] + wall / 2)),
        *(
            Part(
                shape=Box(half_extents=(wall / 2, half[1], half[2] - wall / 2)),
                position=(s * (half[0] - wall / 2), 0.0, wall / 2),
            )
            for s in (-1, 1)
        ),
        *(
            Part(
                shape=Box(half_extents=(half[0] - wall, wall / 2, half[2] - wall / 2)),
                position=(0.0, s * (half[1] - wall / 2), wall / 2),
            )
            for s in (-1, 1)
        ),
    )
    bucket = rigid("bucket", Compound(parts=sides), (0.0, 0.0, 0.3), "orange", density=700.0)
    return World(
        objects=(bucket,),
        joints=(Hinge(name="pivot", object="bucket", anchor=(0.0, 0.0, 0.42), axis=(0.0, 1.0, 0.0), damping=0.05),),
        deformables=(Fluid(name="water"),),
        emitters=(Emitter(name="tap", fluid="water", position=(0.04, 0.0, 0.66), radius=0.03, rate=1e-3, end=5.0),),
        containers=(Container(name="inside", lower=(-0.12, -0.12, 0.2), upper=(0.12, 0.12, 0.4), object="bucket"),),
        fluid_grid=FluidGrid(lower=(-0.325, -0.2, 0.0), upper=(0.325, 0.2, 0.725), cell=0.025),
        statics=(FLOOR,),
        time=TIME,
    )


def cloth_in_fluid() -> World:
    """A sheet hangs from a bar into water that rushes against it."""
    sheet = Cloth(
        name="sheet",
        geometry=Sheet(corner=(0.05, -0.12, 0.4), edge_u=(0.0, 0.24, 0.0), edge_v=(0.0, 0.0, -0.34), divisions=(8, 11)),
        areal_density=0.4,
        stretch_stiffness=800.0,
        bending_stiffness=1e-4,
        stretch_damping=0.01,
        thickness=0.004,
        appearance=Appearance(color="red"),
    )
    return World(
        deformables=(sheet, Fluid(name="water", volumes=(block(0.12, 0.15, 0.15, (-0.24, 0.0, 0.15)),))),
        attachments=(
            Attachment(name="bar", object="sheet", region=Region(lower=(0.0, -0.2, 0.399), upper=(0.1, 0.2, 0.401))),
        ),
        fluid_grid=FluidGrid(lower=(-0.36, -0.15, 0.0), upper=(0.36, 0.15, 0.51), cell=0.03),
        statics=(FLOOR,),
        time=TIME,
    )


def rope_tied_to_a_soft_body() -> World:
    """A soft block swings on a rope that is tied to its top."""
    rope = Rope(
        name="cord",
        points=((0.0, 0.0, 1.5), (0.45, 0.0, 0.95)),
        segments=24,
        radius=0.008,
        linear_density=0.05,
        stretch_damping=0.01,
        appearance=WIRE,
    )
    weight = Soft(
        name="jelly",
        shape=Box(half_extents=(0.1, 0.1, 0.1)),
        position=(0.45, 0.0, 0.85),
        youngs_modulus=4e4,
        damping=0.005,
        density=500.0,
        appearance=Appearance(color="green"),
    )
    return World(
        deformables=(rope, weight),
        attachments=(
            Attachment(name="hook", object="cord", end="start"),
            Attachment(name="knot", object="cord", end="end", to="jelly"),
        ),
        statics=(FLOOR,),
        time=TIME,
    )


def all_in_one_box() -> World:
    """Return a rigid ball, a rope, a sheet, a soft ball and water in one closed box."""
    rope = Rope(
        name="cord",
        points=((-0.3, 0.1, 0.55), (-0.05, 0.1, 0.55)),
        segments=20,
        radius=0.008,
        linear_density=0.08,
        stretch_damping=0.01,
        linear_damping=0.2,
        appearance=WIRE,
    )
    sheet = Cloth(
        name="sheet",
        geometry=Sheet(corner=(0.02, -0.2, 0.42), edge_u=(0.3, 0.0, 0.0), edge_v=(0.0, 0.4, 0.0), divisions=(10, 12)),
        areal_density=0.4,
        stretch_damping=0.01,
        thickness=0.004,
        appearance=Appearance(color="red"),
    )
    jelly = Soft(
        name="jelly",
        shape=Sphere(radius=0.08),
        position=(0.2, 0.0, 0.62),
        youngs_modulus=2e4,
        damping=0.01,
        density=700.0,
        appearance=Appearance(color="green"),
    )
    return World(
        objects=(rigid("ball", Sphere(radius=0.06), (-0.2, -0.08, 0.45), "blue", density=600.0),),
        deformables=(rope, sheet, jelly, Fluid(name="water", volumes=(block(0.35, 0.25, 0.08, (0.0, 0.0, 0.08)),))),
        attachments=(Attachment(name="hook", object="cord", end="start"),),
        fluid_grid=FluidGrid(lower=(-0.35, -0.25, 0.0), upper=(0.35, 0.25, 0.75), cell=0.05),
        statics=(FLOOR, *glass_walls(0.35, 0.25, 0.75)),
        time=TIME,
    )


def glass_walls(x: float, y: float, height: float) -> tuple[StaticObject, ...]:
    """Four walls around a tank of half edges x, y [m]: a fluid's grid holds the fluid alone, not what floats in it."""
    thick, up = 0.02, height / 2
    places = {
        "west": ((thick, y + 2 * thick, up), (-x - thick, 0.0, up)),
        "east": ((thick, y + 2 * thick, up), (x + thick, 0.0, up)),
        "south": ((x, thick, up), (0.0, -y - thick, up)),
        "north": ((x, thick, up), (0.0, y + thick, up)),
    }
    return tuple(
        StaticObject(name=name, shape=Box(half_extents=half), position=place, appearance=GLASS)
        for name, (half, place) in places.items()
    )


SCENES = {
    "ball on cloth": ball_on_cloth,
    "rope over pulley": rope_over_pulley,
    "soft ball on soft block": soft_on_soft,
    "floating and sinking": floating_and_sinking,
    "pouring into a hinged bucket": pouring_into_a_bucket,
    "cloth in fluid": cloth_in_fluid,
    "rope tied to a soft body": rope_tied_to_a_soft_body,
    "all in one box": all_in_one_box,
}
