"""Contacts of deformable objects with statics and rigid bodies: friction, restitution, momentum, no penetration."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.world import StaticObject, World
from polyworld.world.representations.attachment import Attachment
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Compound, ConvexMesh, Cylinder, Part, Sphere, TriangleMesh
from tests.verification.coupled_world import FLOOR, GRAVITY, VACUUM, WEIGHTLESS, Run, pinned_corners, sheet, slope

Array = NDArray[np.float64]


def cube(angle: float = 0.0, **fields: object) -> Soft:
    """A soft cube of 10 cm standing on a slope of that angle, its centre at the origin's foot."""
    half = 0.05
    fields.setdefault("position", (half * np.sin(angle), 0.0, half * np.cos(angle)))
    return Soft.model_validate(
        {
            "name": "cube",
            "shape": Box(half_extents=(half, half, half)),
            "youngs_modulus": 2e5,
            "poisson_ratio": 0.3,
            "damping": 0.003,
            "resolution": 0.1,
            "orientation": (np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0),
            **fields,
        }
    )


@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_soft_cube_below_critical_slope_does_not_creep(friction: float) -> None:
    angle = 0.9 * np.arctan(friction)
    run = Run(World(statics=(slope(angle),), deformables=(cube(angle, friction=friction),)), 2.0, samples=5)
    down = run.along("cube", (np.cos(angle), 0.0, -np.sin(angle)))
    assert abs(down[-1] - down[-2]) < 1e-7  # in half a second, once it has come to rest


def test_a_smooth_soft_cube_holds_on_a_dominant_rough_slope_and_slides_on_one_that_is_not() -> None:
    angle = 0.3
    ways = []
    for dominant in (True, False):
        rough = slope(angle).model_copy(update={"friction": 0.8, "dominant": dominant})
        run = Run(World(statics=(rough,), deformables=(cube(angle, friction=0.02),)), 1.0, samples=5)
        down = run.along("cube", (np.cos(angle), 0.0, -np.sin(angle)))
        ways.append(abs(down[-1] - down[-2]))
    pair = np.sqrt(0.8 * 0.02)
    slide = 9.81 * (np.sin(angle) - pair * np.cos(angle)) * 0.5 * (1.0**2 - 0.75**2)
    assert ways[0] < 1e-6
    assert ways[1] == pytest.approx(slide, rel=0.02)


def test_soft_cube_on_a_plate_on_a_slope_does_not_creep_and_nor_does_the_plate() -> None:
    angle = 0.3
    turn = (np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0)
    plate = RigidObject(
        name="plate",
        shape=Box(half_extents=(0.1, 0.1, 0.01)),
        mass=1.0,
        friction=0.6,
        position=(0.01 * np.sin(angle), 0.0, 0.01 * np.cos(angle)),
        orientation=turn,
    )
    at = 0.0702
    block = cube(angle, friction=0.6, position=(at * np.sin(angle), 0.0, at * np.cos(angle)))
    run = Run(World(statics=(slope(angle),), objects=(plate,), deformables=(block,)), 1.5, samples=4)
    for name in ("plate", "cube"):
        down = run.along(name, (np.cos(angle), 0.0, -np.sin(angle)))
        assert abs(down[-1] - down[-2]) < 2e-6  # in half a second


def test_soft_cube_above_critical_slope_accelerates_as_coulomb_says() -> None:
    friction = 0.5
    angle = 1.2 * np.arctan(friction)
    run = Run(World(statics=(slope(angle),), deformables=(cube(angle, friction=friction),)), 1.5, samples=31)
    down = run.along("cube", (np.cos(angle), 0.0, -np.sin(angle)))
    late = run.times > 0.5
    acceleration = 2.0 * np.polyfit(run.times[late], down[late], 2)[0]
    assert acceleration == pytest.approx(GRAVITY * (np.sin(angle) - friction * np.cos(angle)), rel=0.01)


def test_soft_cube_slides_v2_over_2_mu_g() -> None:
    run = Run(World(statics=(slope(0.0),), deformables=(cube(friction=0.4, velocity=(1.5, 0.0, 0.0)),)), 1.0)
    way = run.along("cube", (1.0, 0.0, 0.0))
    assert way[-1] - way[0] == pytest.approx(1.5**2 / (2.0 * 0.4 * GRAVITY), rel=0.01)
    assert way[-1] == pytest.approx(way[-2], abs=1e-5)  # and stays; what is left is the cube's own wobble


def test_flat_sheet_rebounds_to_e_squared_of_its_height() -> None:
    """All nodes meet the floor at once, so that nothing goes into deformation: apex e^2 h."""
    cloth = sheet("cloth", (0.0, 0.0, 1.001), 0.4, 0.4, (2, 2), restitution=0.8)  # its thickness is 2 mm
    run = Run(World(environment=VACUUM, statics=(FLOOR,), deformables=(cloth,)), 0.9, samples=901)
    height = run.points("cloth")[:, :, 2].mean(axis=1) - 0.001
    assert height[run.times > 0.5].max() == pytest.approx(0.64, rel=1e-3)
    begin = next(e for e in run.trajectory.events[0] if e.kind == "contact_begin")
    assert begin.participants == ("cloth", "floor")
    assert begin.speed == pytest.approx(np.sqrt(2.0 * GRAVITY), rel=2e-3)
    assert begin.time == pytest.approx(np.sqrt(2.0 / GRAVITY), abs=0.002)
    assert begin.impulse == pytest.approx(0.2 * 0.16 * 1.8 * np.sqrt(2.0 * GRAVITY), rel=5e-3)


def test_momentum_of_soft_balls_that_collide_is_conserved() -> None:
    shared = {"shape": Sphere(radius=0.1), "youngs_modulus": 5e4, "poisson_ratio": 0.3, "resolution": 0.1}
    one = Soft.model_validate({"name": "one", "position": (-0.12, 0, 0), "velocity": (1.0, 0, 0), **shared})
    two = Soft.model_validate({"name": "two", "position": (0.12, 0.05, 0.03), "velocity": (-0.5, 0, 0), **shared})
    run = Run(World(environment=WEIGHTLESS, deformables=(one, two)), 0.5)
    momentum = run.momentum()
    scale = sum(run.mass(name).sum() for name in ("one", "two"))
    assert np.abs(momentum - momentum[0]).max() < 1e-12 * scale
    speed = np.diff(run.trajectory.positions[0, -2:, :, 0], axis=0)[0]
    assert speed[0] < speed[1]  # they did collide


def test_momentum_of_ball_and_cloth_is_conserved() -> None:
    ball = RigidObject(
        name="ball",
        shape=Sphere(radius=0.1),
        mass=0.3,
        position=(0.03, 0.02, 0.15),
        velocity=(0.2, 0.0, -2.0),
        angular_velocity=(0.0, 5.0, 0.0),
    )
    cloth = sheet("cloth", (-0.3, -0.3, 0.0), 0.6, 0.6, (8, 8), stretch_stiffness=200.0, self_contact=False)
    run = Run(World(environment=WEIGHTLESS, objects=(ball,), deformables=(cloth,)), 0.3)
    momentum = run.momentum()
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * np.abs(momentum[0]).max()
    assert run.trajectory.velocities[0, -1, 0, 2] > -1.6


def test_ball_on_pinned_cloth_rests_and_the_pins_carry_its_weight() -> None:
    n = (5, 5)
    for mass in (0.02, 2.0):  # a fifth, and twenty times, of what the cloth weighs
        ball = RigidObject(
            name="ball", shape=Sphere(radius=0.08), mass=mass, position=(0.35, 0.35, 0.09), linear_damping=4.0
        )
        cloth = sheet(
            "cloth", (0.0, 0.0, 0.0), 0.7, 0.7, n, stretch_stiffness=300.0, stretch_damping=0.02, linear_damping=4.0
        )
        world = World(environment=VACUUM, objects=(ball,), deformables=(cloth,), attachments=pinned_corners("cloth", n))
        run = Run(world, 2.5, samples=6)
        held = sum(force[0, 2] for force in run.shard.attachments.forces().values())
        assert held == pytest.approx(GRAVITY * (mass + 0.2 * 0.49), rel=0.005)
        rest = run.along("ball", (0.0, 0.0, 1.0))
        assert rest[-1] > -0.5
        assert rest[-1] == pytest.approx(rest[-2], abs=2e-3)


def over_drum(friction: float, ratio: float) -> World:
    """A rope over a fixed drum, half a turn, with 0.5 kg at one end and `ratio` times that at the other."""
    radius, thickness = 0.1, 0.005
    at = radius + thickness
    angle = np.linspace(0.0, np.pi, 33)
    points = [(at, 0.0, -0.3), *[(at * np.cos(t), 0.0, at * np.sin(t)) for t in angle], (-at, 0.0, -0.3)]
    rope = Rope(
        name="rope",
        points=tuple(points),
        segments=100,
        radius=thickness,
        linear_density=0.01,
        stretch_damping=1e-3,
        friction=friction,
    )
    ball = Sphere(radius=0.04)
    drum = StaticObject(
        name="drum",
        shape=Cylinder(radius=radius, half_height=0.1),
        orientation=(np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0),
        friction=friction,
    )
    return World(
        objects=(
            RigidObject(name="light", shape=ball, mass=0.5, position=(at, 0.0, -0.3)),
            RigidObject(name="heavy", shape=ball, mass=0.5 * ratio, position=(-at, 0.0, -0.3)),
        ),
        statics=(drum,),
        deformables=(rope,),
        attachments=(
            Attachment(name="a", object="rope", end="start", to="light"),
            Attachment(name="b", object="rope", end="end", to="heavy"),
        ),
    )


def test_rope_slides_over_a_drum_as_tensions_in_the_ratio_exp_mu_phi_say() -> None:
    """Euler-Eytelwein: with T2 = T1 exp(mu pi), the heavy load falls with g (m2 - k m1)/(m2 + k m1)."""
    run = Run(over_drum(0.2, 3.0), 0.3, samples=31)
    late = run.times >= 0.1
    fall = -np.polyfit(run.times[late], run.trajectory.velocities[0, late, 1, 2], 1)[0]
    k = np.exp(0.2 * np.pi)
    assert fall == pytest.approx(GRAVITY * (3.0 - k) / (3.0 + k), rel=0.04)


def test_rope_on_a_drum_sticks_below_the_ratio_exp_mu_phi() -> None:
    run = Run(over_drum(0.2, 1.5), 0.8, samples=9)
    height = run.along("heavy", (0.0, 0.0, 1.0))
    assert abs(height[-1] - height[-3]) < 2e-5  # in 0.2 s; the bounce of the loads on the rope is over


def depth(shape: Sphere | Box, p: Array) -> Array:
    """Signed distance of points (..., 3) from a shape at the origin."""
    if isinstance(shape, Sphere):
        return np.asarray(np.linalg.norm(p, axis=-1) - shape.radius)
    q = np.abs(p) - shape.half_extents
    return np.asarray(np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0))


@pytest.mark.parametrize("shape", [Sphere(radius=0.15), Box(half_extents=(0.12, 0.1, 0.08))], ids=["ball", "box"])
def test_cloth_draped_over_a_shape_nowhere_enters_it(shape: Sphere | Box) -> None:
    top = shape.radius if isinstance(shape, Sphere) else shape.half_extents[2]
    cloth = sheet(
        "cloth",
        (-0.3, -0.3, top + 0.01),
        0.6,
        0.6,
        (12, 12),
        stretch_stiffness=50.0,
        stretch_damping=0.01,
        linear_damping=1.0,
    )
    world = World(statics=(StaticObject(name="thing", shape=shape),), deformables=(cloth,))
    run = Run(world, 0.8, samples=5)
    weights = np.random.default_rng(0).dirichlet((1.0, 1.0, 1.0), 100)
    triangles = mesh_of(world, cloth).triangles
    for points in run.points("cloth")[1:]:
        inside = np.einsum("bk,tkj->tbj", weights, points[triangles])
        assert depth(shape, inside).min() > 0.9e-3  # half its thickness is 1 mm
    assert run.points("cloth")[-1, :, 2].min() < top - 0.12  # it hangs down


def test_cloth_lies_on_a_mesh_a_hull_and_a_compound() -> None:
    roof = TriangleMesh(
        vertices=((-1, -1, 0), (1, -1, 0), (1, 0, 0.3), (-1, 0, 0.3), (1, 1, 0), (-1, 1, 0)),
        faces=((0, 1, 2), (0, 2, 3), (3, 2, 4), (3, 4, 5)),
    )
    corners = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.1, 0.0)] + [(0, 0, 0.1)]
    table = Compound(
        parts=(
            Part(shape=Box(half_extents=(0.3, 0.3, 0.02)), position=(0, 0, 0.1)),
            Part(shape=Box(half_extents=(0.02, 0.02, 0.1))),
        )
    )
    fields = {"stretch_stiffness": 50.0, "stretch_damping": 0.02, "linear_damping": 3.0}
    cloths = (
        sheet("on-roof", (-0.2, -0.2, 0.32), 0.4, 0.4, (6, 6), **fields),
        sheet("on-hull", (2.8, -0.2, 0.12), 0.4, 0.4, (6, 6), **fields),
        sheet("on-table", (5.9, -0.1, 0.3), 0.2, 0.2, (4, 4), **fields),
    )
    world = World(
        objects=(RigidObject(name="table", shape=table, mass=5.0, position=(6.0, 0.0, 0.2)),),
        statics=(
            FLOOR,
            StaticObject(name="roof", shape=roof),
            StaticObject(name="hull", shape=ConvexMesh(vertices=tuple(corners)), position=(3.0, 0.0, 0.0)),
        ),
        deformables=cloths,
    )
    run = Run(world, 0.6, samples=4)
    on_roof = run.points("on-roof")[-1]
    normal = np.array([0.0, 0.3, 1.0]) / np.hypot(0.3, 1.0)
    above = np.maximum((on_roof - (0, 0, 0.3)) @ (normal * (1, 1, 1)), (on_roof - (0, 0, 0.3)) @ (normal * (1, -1, 1)))
    assert above.min() > 0.9e-3
    assert run.points("on-hull")[-1, :, 2].min() > 0.0
    assert run.points("on-hull")[-1, 24, 2] == pytest.approx(corners[-1][2], abs=0.05)
    table_top = run.along("table", (0.0, 0.0, 1.0))
    lying = run.points("on-table")[-1, :, 2]
    assert np.ptp(lying) < 1e-4
    pair = {e.participants for e in run.trajectory.events[0]}
    assert ("on-table", "table") in pair
    assert table_top[-1] == pytest.approx(table_top[-2], abs=1e-4)


def test_light_and_heavy_loads_rest_on_a_soft_cube() -> None:
    """The load is carried whatever its mass is beside that of the nodes; the cube is pressed by F h / (E A)."""
    for mass in (0.01, 1.0):
        plate = RigidObject(name="plate", shape=Box(half_extents=(0.06, 0.06, 0.01)), mass=mass, position=(0, 0, 0.112))
        run = Run(
            World(
                objects=(plate,),
                statics=(FLOOR,),
                deformables=(cube(friction=0.0, poisson_ratio=0.0, resolution=0.05),),
            ),
            1.5,
        )
        height = run.points("cube")[-1, :, 2].max()
        thick = height - run.points("cube")[-1, :, 2].min()
        own = 1000.0 * GRAVITY * 0.1**2 / 2.0 / 2e5  # its own weight presses it by rho g h^2 / 2E
        assert 0.1 - thick == pytest.approx(own + mass * GRAVITY * 0.1 / (2e5 * 0.01), rel=0.05)
        z = run.along("plate", (0.0, 0.0, 1.0))
        assert z[-1] == pytest.approx(height + 0.0105, abs=2e-5)  # nodes are touched half a millimetre off
        assert z[-1] == pytest.approx(z[-2], abs=1e-5)
