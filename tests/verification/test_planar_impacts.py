"""Impacts in the planar solver: restitution, billiards, chains, walls, conservation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.trajectory import BatchTrajectory
from polyworld.world import StaticObject, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, ConvexMesh, Sphere, Wall
from tests.verification.planar_scenes import G, body, disc, run, side_view, top_view

Array = NDArray[np.float64]


@pytest.mark.parametrize("substep", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.5])
def test_bounce_apexes_do_not_depend_on_the_step(restitution: float, substep: float) -> None:
    """Apex n is e^(2n) h, here read from the impact speeds v_n = e^n sqrt(2 g h); relative 1e-6."""
    height = 1.0
    ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 0.1 + height), restitution=restitution)
    fall = run(side_view(ball, substep=substep), 2.0)
    speeds = [e.speed for e in fall.events[0] if e.kind == "contact_begin"]
    apexes = np.square(speeds[1:]) / (2 * G)
    np.testing.assert_allclose(apexes[:3], height * restitution ** (2.0 * np.arange(1, len(apexes[:3]) + 1)), rtol=1e-6)
    times = [e.time for e in fall.events[0] if e.kind == "contact_begin"]
    first = np.sqrt(2 * height / G)
    assert times[0] == pytest.approx(first, abs=1e-6)
    assert times[1] == pytest.approx(first * (1 + 2 * restitution), abs=1e-5)


@pytest.mark.parametrize("substep", [0.001, 0.005])
def test_a_ball_stops_bouncing_when_the_series_ends(substep: float) -> None:
    """Stop time sqrt(2h/g) (1 + e)/(1 - e) = 4.064 s for e = 0.8, less what is cut off (v = g dt / 2)."""
    ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 1.1), restitution=0.8)
    fall = run(side_view(ball, substep=substep), 5.0, 0.001)
    speed = np.abs(fall.velocities[0, :, 0, 2])
    stop = fall.times[0][np.flatnonzero(speed > 1e-9)[-1]]
    exact = np.sqrt(2.0 / G) * 9.0
    assert exact - 0.8 * substep / 0.2 - 0.002 < stop < exact + 0.002
    np.testing.assert_allclose(fall.positions[0, fall.times[0] > exact + 0.01, 0, 2], 0.1, atol=1e-6)


def test_equal_elastic_billiard_balls_part_at_a_right_angle() -> None:
    """Off-centre by half a radius: 90 degrees to 1e-9 rad, and the struck ball leaves along the line of centres."""
    balls = (
        body("cue", disc(), (-1.0, 0.1, 0.2), velocity=(2.0, 0.0, 0.0), restitution=1.0),
        body("object", disc(), (0.0, 0.0, 0.2), restitution=1.0),
    )
    motion = run(top_view(*balls, gravity=0.0), 1.5)
    cue, struck = motion.velocities[0, -1, :, :2]
    assert np.dot(cue, struck) / (np.linalg.norm(cue) * np.linalg.norm(struck)) == pytest.approx(0.0, abs=1e-7)
    # At touch the centres are 0.4 apart, 0.1 of it across the path.
    np.testing.assert_allclose(struck / np.linalg.norm(struck), [np.sqrt(0.15) / 0.4, -0.25], atol=1e-6)


@pytest.mark.parametrize("depth", [1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("begin", np.linspace(-1.0, -0.9, 7))
def test_a_graze_is_not_stepped_over(depth: float, begin: float) -> None:
    """A disc that would overlap another by so much at the nearest is turned aside, although a step is many times as
    long as the overlap lasts: the struck one leaves along the line of centres, with the speed along it."""
    reach = 0.4
    offset = reach - depth
    balls = (
        body("cue", disc(), (begin, offset, 0.2), velocity=(4.0, 0.0, 0.0), restitution=1.0),
        body("object", disc(), (0.0, 0.0, 0.2), restitution=1.0),
    )
    motion = run(top_view(*balls, gravity=0.0, substep=0.05), 1.0)
    normal = np.array([np.sqrt(reach**2 - offset**2), -offset]) / reach
    np.testing.assert_allclose(motion.velocities[0, -1, 1, :2], 4.0 * normal[0] * normal, atol=2e-3)


@pytest.mark.parametrize("gap", [0.0, 0.01])
@pytest.mark.parametrize("balls", [3, 5])
def test_newtons_cradle_passes_the_blow_to_the_last_ball(balls: int, gap: float) -> None:
    """Only the last of equal elastic balls moves, with the first one's speed: 1e-9."""
    row = [
        body(f"b{i}", disc(), (i * (0.4 + gap), 0.0, 0.2), velocity=(1.5 * (i == 0), 0.0, 0.0), restitution=1.0)
        for i in range(1, balls)
    ]
    first = body("b0", disc(), (-0.5, 0.0, 0.2), velocity=(1.5, 0.0, 0.0), restitution=1.0)
    motion = run(top_view(first, *row, gravity=0.0), 1.0)
    expected = np.zeros(balls)
    expected[-1] = 1.5
    np.testing.assert_allclose(motion.velocities[0, -1, :, 0], expected, atol=1e-9)


def test_a_struck_pair_of_balls_parts_symmetrically() -> None:
    """A ball hitting two touching ones at once: mirror symmetry to 1e-9, energy and momentum kept."""
    r = 0.2
    balls = (
        body("cue", disc(r), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0), restitution=1.0),
        body("left", disc(r), (0.0, r, 0.2), restitution=1.0),
        body("right", disc(r), (0.0, -r, 0.2), restitution=1.0),
    )
    motion = run(top_view(*balls, gravity=0.0), 1.0)
    cue, left, right = motion.velocities[0, -1, :, :2]
    np.testing.assert_allclose(left, right * [1.0, -1.0], atol=1e-9)
    assert cue[1] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(cue[0] + 2 * left[0], 2.0, atol=1e-9)
    assert cue @ cue + left @ left + right @ right == pytest.approx(4.0, abs=1e-9)


def _isolated(count: int, seed: int) -> tuple[RigidObject, ...]:
    """Discs, boxes and hexagonal prisms thrown at each other."""
    draw = np.random.default_rng(seed)
    ring = [(0.2 * np.cos(a), 0.2 * np.sin(a), z) for a in np.arange(6) * np.pi / 3 for z in (-0.2, 0.2)]
    shapes = (disc(), Box(half_extents=(0.25, 0.15, 0.2)), ConvexMesh(vertices=tuple(ring)))
    items = []
    for i in range(count):
        angle = 2 * np.pi * i / count
        place = 1.2 * np.array([np.cos(angle), np.sin(angle)])
        velocity = -place + draw.normal(0.0, 0.3, 2)
        items.append(
            body(
                f"o{i}",
                shapes[i % 3],
                (*place, 0.2),
                mass=1.0 + 0.5 * i,
                velocity=(*velocity, 0.0),
                angular_velocity=(0.0, 0.0, draw.normal(0.0, 3.0)),
                restitution=1.0,
            )
        )
    return tuple(items)


def _totals(world: World, motion: BatchTrajectory, plane: tuple[int, int], turning: int) -> tuple[Array, Array, Array]:
    """Momentum (T, 2), angular momentum about the origin (T,) and kinetic energy (T,)."""
    inertia = []
    for item in world.objects:
        if isinstance(item.shape, Box):
            a, b, _ = item.shape.half_extents
            inertia.append((a**2 + b**2) / 3)
        elif isinstance(item.shape, ConvexMesh):
            inertia.append(5 / 12 * 0.2**2)  # regular hexagon of side s: 5 s^2 / 12
        else:
            inertia.append(0.5 * item.shape.radius**2)
    m = np.array([item.mass for item in world.objects])
    x, v = motion.positions[0][..., plane], motion.velocities[0][..., plane]
    w = motion.angular_velocities[0][..., turning]
    spin = (m * (x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]) + m * np.array(inertia) * w).sum(axis=1)
    energy = 0.5 * (m * (v**2).sum(axis=-1) + m * np.array(inertia) * w**2).sum(axis=1)
    return np.einsum("i,tic->tc", m, v), spin, energy


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_an_isolated_system_keeps_its_momenta_and_gains_no_energy(friction: float) -> None:
    """Elastic impacts of discs, boxes and hexagons: momenta to 1e-11; energy to 1e-11 without friction."""
    items = tuple(o.model_copy(update={"friction": friction}) for o in _isolated(6, seed=1))
    world = top_view(*items, gravity=0.0)
    motion = run(world, 3.0)
    assert len(motion.events[0]) > 10
    momentum, spin, energy = _totals(world, motion, (0, 1), 2)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-11)
    np.testing.assert_allclose(spin, spin[0], atol=1e-6)  # contact points lie midway in a gap of up to 2e-7 m
    if friction == 0.0:
        np.testing.assert_allclose(energy, energy[0], rtol=1e-11)
    else:
        assert np.all(np.diff(energy) <= 1e-12 * energy[0])


@pytest.mark.parametrize("mu", [0.05, 0.3, 2.0])
def test_an_oblique_corner_hits_a_wall_as_routh_says(mu: float) -> None:
    """One impulse at one corner, solved on paper for sliding and for sticking (Routh 1905, art. 187 ff.); 1e-6."""
    a, e, angle = 0.2, 0.6, 0.5
    v, omega = np.array([1.5, 0.8]), 1.0
    box = body(
        "box",
        Box(half_extents=(a, a, a)),
        (-1.0, 0.0, 0.2),
        orientation=(float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))),
        velocity=(*v, 0.0),
        angular_velocity=(0.0, 0.0, omega),
        restitution=e,
        friction=mu,
        mass=2.0,
    )
    wall = StaticObject(name="wall", shape=Wall(start=(0.01, -5.0, 0.0), end=(0.01, 5.0, 0.0)))
    motion = run(top_view(box, gravity=0.0, statics=(wall,)), 1.0)
    begin = next(k for k in motion.events[0] if k.kind == "contact_begin")
    # The touching corner, at the time of the impact.
    turned = angle + omega * begin.time
    corners = a * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    c, s = np.cos(turned), np.sin(turned)
    arm = max((corners @ np.array([[c, s], [-s, c]])), key=lambda p: p[0])
    touch = (0.0 - (-1.0) - arm[0]) / v[0]
    assert begin.time == pytest.approx(touch, abs=1e-5)
    # Relative speed of the corner; normal -x (from the wall), tangent y.
    inverse_mass, inverse_inertia = 1 / 2.0, 1 / (2.0 * 2 / 3 * a**2)
    un, ut = -(v[0] - omega * arm[1]), v[1] + omega * arm[0]
    knn = inverse_mass + inverse_inertia * arm[1] ** 2
    ktt = inverse_mass + inverse_inertia * arm[0] ** 2
    knt = inverse_inertia * arm[0] * arm[1]  # speed along n per impulse along t: n = -x
    matrix = np.array([[knn, knt], [knt, ktt]])
    jn, jt = np.linalg.solve(matrix, [-(1 + e) * un, -ut])
    if abs(jt) > mu * jn:
        direction = -np.sign(ut)
        jn = -(1 + e) * un / (knn + direction * mu * knt)
        jt = direction * mu * jn
    after = v + inverse_mass * np.array([-jn, jt])
    np.testing.assert_allclose(motion.velocities[0, -1, 0, :2], after, atol=2e-6)
    spin = omega + inverse_inertia * (arm[0] * jt + arm[1] * jn)
    assert motion.angular_velocities[0, -1, 0, 2] == pytest.approx(spin, abs=2e-5)
    assert begin.impulse == pytest.approx(jn, rel=1e-5)
    assert begin.speed == pytest.approx(-un, rel=1e-5)


def test_a_box_that_lands_flat_bounces_flat() -> None:
    """Two corners touch at once: v -> -e v and no spin, to 1e-9."""
    box = body("box", Box(half_extents=(0.4, 0.2, 0.1)), (0.0, 0.0, 1.1), restitution=0.5, friction=0.4)
    fall = run(side_view(box), 0.6)
    impact = np.sqrt(2 * G)
    t = fall.times[0]
    after = t > impact / G + 0.01
    expected = 0.5 * impact - G * (t[after] - impact / G)
    np.testing.assert_allclose(fall.velocities[0, after, 0, 2], expected, atol=1e-5)
    assert np.abs(fall.angular_velocities[0]).max() < 1e-9


@pytest.mark.parametrize("shape", ["ball", "box"])
def test_a_bullet_does_not_pass_through_a_thin_wall(shape: str) -> None:
    """300 m/s against a 2 mm wall, 0.6 m a step: it comes back with -e v."""
    solid = Sphere(radius=0.02) if shape == "ball" else Box(half_extents=(0.02, 0.02, 0.02))
    bullet = body("bullet", solid, (-5.0, 0.0, 0.2), velocity=(300.0, 0.0, 0.0), restitution=0.5)
    wall = StaticObject(name="wall", shape=Wall(start=(0.0, -5.0, 0.0), end=(0.0, 5.0, 0.0), thickness=0.002))
    motion = run(top_view(bullet, gravity=0.0, statics=(wall,)), 0.05)
    np.testing.assert_allclose(motion.velocities[0, -1, 0], [-150.0, 0.0, 0.0], atol=1e-6)
    assert motion.positions[0, :, 0, 0].max() < 0.0


def test_a_stack_of_five_boxes_stands_still() -> None:
    """5 s: within the contact band of 2e-7 m from the start, and after 0.1 s still to 1e-12 m."""
    boxes = [
        body(f"b{i}", Box(half_extents=(0.2, 0.2, 0.1)), (0.0, 0.0, 0.1 + 0.2 * i), friction=0.5, mass=1.0)
        for i in range(5)
    ]
    still = run(side_view(*boxes), 5.0)
    assert np.abs(still.positions[0] - still.positions[0, 0]).max() < 5e-7
    assert np.abs(still.positions[0, 10:] - still.positions[0, 10]).max() < 1e-12
    assert not any(e.kind == "contact_end" for e in still.events[0])


def test_an_overlap_at_the_start_parts_without_a_kick() -> None:
    """Two discs 2 cm into each other: apart within half a second, and never faster than 1e-9 m/s."""
    pair = (body("a", disc(), (0.0, 0.0, 0.2), friction=0.3), body("b", disc(), (0.38, 0.0, 0.2), friction=0.3))
    motion = run(top_view(*pair), 0.5)
    assert np.abs(motion.velocities).max() < 1e-9
    assert motion.positions[0, -1, 1, 0] - motion.positions[0, -1, 0, 0] > 0.4 - 1e-5


def test_many_collisions_of_boxes_and_discs_do_not_depend_on_the_step() -> None:
    """Six bodies meeting in the middle, sliding with friction: 1 ms and 8 ms steps agree to 1e-5 m after 2 s."""
    angles, radii = 2.4 * np.arange(6), 0.25 * np.arange(1, 7) ** 0.7
    items = [
        body(
            f"o{i}",
            Box(half_extents=(0.2, 0.2, 0.2)) if i % 2 else disc(),
            (r * np.cos(a), r * np.sin(a), 0.2),
            velocity=(-np.cos(a), -np.sin(a), 0.0),
            friction=0.05,
            restitution=0.4,
        )
        for i, (a, r) in enumerate(zip(angles, radii, strict=True))
    ]
    fine, coarse = (run(top_view(*items, substep=h), 2.0, 0.04) for h in (0.001, 0.008))
    assert len(fine.events[0]) == len(coarse.events[0]) > 10
    np.testing.assert_allclose(coarse.positions, fine.positions, atol=1e-5)
