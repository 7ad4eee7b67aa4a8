"""Impacts: restitution, billiards, shocks through touching bodies, spin, conservation, nothing passes through."""

import numpy as np
import pytest

from polyworld.trajectory import BatchTrajectory
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Cylinder, Plane, Sphere, Wall
from tests.verification.spatial_world import FLOOR, GRAVITY, body, make_world, run

SPACE = (0.0, 0.0, 0.0)
BALL = Sphere(radius=0.1)


@pytest.mark.parametrize("substep", [0.001, 0.002, 0.005, 0.01])
def test_bounce_apex_is_e_squared_h(substep: float) -> None:
    """From 1 m with e = 0.8 the apex is 0.640 m, then 0.4096 m, whatever the step."""
    world = make_world(body("b", BALL, (0, 0, 1.1), restitution=0.8), substep=substep)
    out = run(world, 2.2, samples=2201)
    height, t = out.positions[0, :, 0, 2] - 0.1, out.times[0]
    first = np.sqrt(2 / GRAVITY)
    second = first * (1 + 2 * 0.8)
    assert height[(t > first) & (t < second)].max() == pytest.approx(0.64, rel=1e-3)
    assert height[(t > second) & (t < second + 2 * 0.64 * first)].max() == pytest.approx(0.4096, rel=1e-3)


@pytest.mark.parametrize("substep", [0.002, 0.005])
def test_bouncing_stops_after_the_geometric_series(substep: float) -> None:
    """t = sqrt(2 h / g) (1 + e) / (1 - e): 2.94 s for h = 1 m, e = 0.735; then the ball rests on the floor."""
    e = 0.735
    out = run(make_world(body("b", BALL, (0, 0, 1.1), restitution=e), substep=substep), 4.0, samples=4001)
    moving = np.abs(out.velocities[0, :, 0, 2]) > 0.01
    stopped = out.times[0][np.flatnonzero(moving)[-1]]
    assert stopped == pytest.approx(np.sqrt(2 / GRAVITY) * (1 + e) / (1 - e), rel=0.02)
    assert out.positions[0, -1, 0, 2] == pytest.approx(0.1, abs=2e-5)


def test_contact_event_has_time_speed_and_impulse_of_the_first_touch() -> None:
    """Touch at sqrt(2 h / g) with sqrt(2 g h); the impulse is (1 + e) m v."""
    out = run(make_world(body("b", BALL, (0, 0, 1.1), restitution=0.8, mass=2.0)), 0.6)
    begin, end = out.events[0]
    assert begin.kind == "contact_begin"
    assert begin.participants == ("b", "floor")
    speed = np.sqrt(2 * GRAVITY)
    assert begin.time == pytest.approx(np.sqrt(2 / GRAVITY), abs=1e-5)
    assert begin.speed == pytest.approx(speed, rel=1e-4)
    assert begin.impulse == pytest.approx(1.8 * 2 * speed, rel=1e-4)
    assert begin.position == pytest.approx((0, 0, 0), abs=1e-4)
    assert end.kind == "contact_end"
    assert end.impulse == pytest.approx(begin.impulse)


@pytest.mark.parametrize("offset", [0.03, 0.1, 0.17])
def test_equal_elastic_balls_part_at_ninety_degrees(offset: float) -> None:
    """Without friction the velocities after an oblique hit on a ball at rest are perpendicular."""
    fields = {"restitution": 1.0, "friction": 0.0}
    moving = body("a", BALL, (-1, offset, 0), velocity=(2, 0, 0), **fields)
    out = run(make_world(moving, body("b", BALL, (0, 0, 0), **fields), statics=(), gravity=SPACE), 1.0)
    u, v = out.velocities[0, -1]
    assert abs(u @ v) < 1e-9
    assert u @ u + v @ v == pytest.approx(4.0, rel=1e-9)
    line = np.array([np.sqrt(0.04 - offset**2), -offset, 0.0]) / 0.2
    assert np.abs(v - 2 * line[0] * line).max() < 1e-3


def test_billiards_on_a_frictionless_table_stay_on_it() -> None:
    """The same on a plane: the heights do not change."""
    fields = {"restitution": 1.0, "friction": 0.0}
    moving = body("a", BALL, (-0.5, 0.1, 0.1), velocity=(2, 0, 0), **fields)
    out = run(make_world(moving, body("b", BALL, (0, 0, 0.1), **fields)), 1.0)
    u, v = out.velocities[0, -1]
    assert abs(u @ v) < 1e-6
    assert np.abs(out.positions[0, :, :, 2] - 0.1).max() < 1e-5


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("gap", [0.0, 1e-3])
def test_newtons_cradle_sends_off_the_last_ball(gap: float, reverse: bool) -> None:
    """Five elastic balls in a row: all of the momentum leaves at the far end, in whatever order they are listed."""
    spots = [-0.7] + [k * (0.2 + gap) for k in range(4)]
    balls = [
        body(f"b{k}", BALL, (x, 0, 0), velocity=(1.5 if k == 0 else 0.0, 0, 0), restitution=1.0)
        for k, x in enumerate(spots)
    ]
    out = run(make_world(*(balls[::-1] if reverse else balls), statics=(), gravity=SPACE), 1.0)
    speeds = out.velocities[0, -1, :, 0][:: -1 if reverse else 1]
    assert np.abs(speeds - [0, 0, 0, 0, 1.5]).max() < 1e-9


@pytest.mark.parametrize("mu", [0.1, 0.25, 0.9])
def test_spinning_ball_bounces_off_a_wall_by_coulombs_law(mu: float) -> None:
    """One impulse: tangential change min(mu (1 + e) vn, 2/7 of the slip), spin by the same impulse (Garwin 1969)."""
    e, vn, vt, spin = 0.7, 3.0, 1.0, 8.0
    ball = body(
        "b",
        BALL,
        (0, 0, 0),
        velocity=(vn, vt, 0),
        angular_velocity=(0, 0, spin),
        friction=mu,
        restitution=e,
    )
    wall = StaticObject(name="wall", shape=Plane(normal=(-1, 0, 0), offset=-0.5))
    out = run(make_world(ball, statics=(wall,), gravity=SPACE), 0.3)
    slip = vt + spin * 0.1  # of the contact point at +x
    change = -np.sign(slip) * min(mu * (1 + e) * vn, 2 / 7 * abs(slip))
    assert out.velocities[0, -1, 0] == pytest.approx([-e * vn, vt + change, 0.0], abs=5e-6)
    assert out.angular_velocities[0, -1, 0, 2] == pytest.approx(spin + 2.5 * change / 0.1, abs=1e-4)


def _bodies_in_space() -> World:
    rng = np.random.default_rng(3)
    shapes = [
        Sphere(radius=0.15),
        Box(half_extents=(0.1, 0.15, 0.2)),
        Cylinder(radius=0.12, half_height=0.15),
        Capsule(radius=0.1, half_height=0.1),
    ]
    objects: list[RigidObject] = []
    for k in range(12):
        spot = np.array([k % 2, (k // 2) % 2, k // 4]) * 0.7 + rng.uniform(-0.05, 0.05, 3)
        objects.append(
            body(
                f"b{k}",
                shapes[k % 4],
                spot,
                velocity=rng.uniform(-1, 1, 3) - 2 * (spot - (0.35, 0.35, 0.7)),
                angular_velocity=rng.uniform(-3, 3, 3),
                mass=float(rng.uniform(0.5, 2.0)),
                restitution=1.0,
                friction=0.0,
            )
        )
    return make_world(*objects, statics=(), gravity=SPACE)


def _totals(world: World, out: BatchTrajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Momentum (T, 3), angular momentum about the origin (T, 3) and kinetic energy (T,)."""
    p, spin, energy = 0.0, 0.0, 0.0
    for i, item in enumerate(world.objects):
        solid = geometry.mass_properties(item.shape)
        turn = geometry.quaternion_matrix(out.orientations[0, :, i])
        inertia = item.mass * turn @ (solid.inertia / solid.volume) @ np.swapaxes(turn, 1, 2)
        own = np.einsum("tij,tj->ti", inertia, out.angular_velocities[0, :, i])
        v = out.velocities[0, :, i]
        p = p + item.mass * v
        spin = spin + own + item.mass * np.cross(out.positions[0, :, i], v)
        energy = energy + 0.5 * item.mass * (v**2).sum(axis=1)
        energy = energy + 0.5 * (own * out.angular_velocities[0, :, i]).sum(axis=1)
    return np.asarray(p), np.asarray(spin), np.asarray(energy)


def test_isolated_system_keeps_momentum_angular_momentum_and_energy() -> None:
    """Twelve elastic, frictionless bodies of four shapes that collide many times."""
    world = _bodies_in_space()
    out = run(world, 2.0)
    assert len([e for e in out.events[0] if e.kind == "contact_begin"]) > 12
    p, spin, energy = _totals(world, out)
    assert np.abs(p - p[0]).max() < 1e-11 * np.abs(p).max() + 1e-12
    assert np.abs(spin - spin[0]).max() < 1e-4
    assert np.abs(energy / energy[0] - 1).max() < 1e-6


def test_friction_between_free_bodies_keeps_momentum_and_never_adds_energy() -> None:
    """The same with friction and e = 0.5."""
    world = _bodies_in_space()
    objects = tuple(o.model_copy(update={"friction": 0.6, "restitution": 0.5}) for o in world.objects)
    world = world.model_copy(update={"objects": objects})
    out = run(world, 2.0)
    p, spin, energy = _totals(world, out)
    assert np.abs(p - p[0]).max() < 1e-11
    assert np.abs(spin - spin[0]).max() < 1e-4
    assert np.diff(energy).max() < 1e-9 * energy[0]
    assert energy[-1] < 0.9 * energy[0]


@pytest.mark.parametrize("speed", [5.0, 50.0, 400.0])
def test_fast_small_ball_does_not_pass_through_a_thin_wall(speed: float) -> None:
    """At 400 m/s and 2 ms it moves 80 of its radii in a step, and the wall is a tenth of its size."""
    ball = body("b", Sphere(radius=0.01), (0, 0.03, 0.5), velocity=(speed, 0.1 * speed, 0), restitution=0.5)
    wall = StaticObject(name="wall", shape=Wall(start=(1, -3, 0), end=(1, 3, 0), height=1.0, thickness=0.001))
    out = run(make_world(ball, statics=(wall,), gravity=SPACE), 1.2 / speed * 2, samples=401)
    assert out.positions[0, :, 0, 0].max() < 1.0 - 0.0005 - 0.01 + 1e-5
    assert out.velocities[0, -1, 0, 0] == pytest.approx(-0.5 * speed, rel=1e-6)


def test_fast_balls_meet_in_flight() -> None:
    """Two small balls approaching at 200 m/s exchange their velocities."""
    balls = [
        body(f"b{k}", Sphere(radius=0.01), (s * 0.5, 0, 0), velocity=(-s * 100, 0, 0), restitution=1.0)
        for k, s in enumerate((-1, 1))
    ]
    out = run(make_world(*balls, statics=(), gravity=SPACE), 0.01, samples=11)
    assert out.velocities[0, -1, :, 0] == pytest.approx([-100, 100], rel=1e-9)


def test_box_dropped_flat_rebounds_flat() -> None:
    """All four corners share the impact: e v up, no rotation."""
    box = body("b", Box(half_extents=(0.2, 0.1, 0.1)), (0, 0, 0.6), restitution=0.5)
    out = run(make_world(box, statics=(FLOOR,)), 0.4)
    t = out.times[0, -1] - np.sqrt(2 * 0.5 / GRAVITY)
    assert out.velocities[0, -1, 0, 2] == pytest.approx(0.5 * np.sqrt(GRAVITY) - GRAVITY * t, rel=1e-3)
    assert np.abs(out.angular_velocities[0, -1, 0]).max() < 1e-9


def test_rod_struck_at_its_end_turns_by_the_impulse() -> None:
    """A ball hits a free rod at distance d from its centre: J = (1 + e) v / (1/m + 1/M + d^2/I)."""
    rod = Box(half_extents=(0.05, 0.5, 0.05))
    d, e, v = 0.4, 0.6, 2.0
    hitting = body("ball", BALL, (-0.5, d, 0), velocity=(v, 0, 0), restitution=e, friction=0.0, mass=0.5)
    struck = body("rod", rod, (0, 0, 0), restitution=e, friction=0.0)
    out = run(make_world(hitting, struck, statics=(), gravity=SPACE), 0.4)
    inertia = (0.5**2 + 0.05**2) / 3
    impulse = (1 + e) * v / (1 / 0.5 + 1 + d**2 / inertia)
    assert out.velocities[0, -1, 1, 0] == pytest.approx(impulse, rel=1e-6)
    assert out.angular_velocities[0, -1, 1, 2] == pytest.approx(-impulse * d / inertia, rel=1e-6)


@pytest.mark.parametrize("angle", np.linspace(0.1, 1.5, 8))
def test_no_oblique_impact_with_friction_creates_energy(angle: float) -> None:
    """A slender rod striking a rough floor with one end, where Newton's law alone would create energy (Kane 1984)."""
    rod = Capsule(radius=0.02, half_height=0.5)
    turn = (float(np.cos(angle / 2)), 0.0, float(np.sin(angle / 2)), 0.0)
    height = 0.5 * np.cos(angle) + 0.02 + 0.01
    for sideways in (-3.0, 0.0, 3.0):
        item = body(
            "rod", rod, (0, 0, height), orientation=turn, velocity=(sideways, 0, -2), restitution=0.9, friction=0.8
        )
        world = make_world(item, statics=(FLOOR,), gravity=SPACE)
        out = run(world, 0.05, samples=26)
        _, _, energy = _totals(world, out)
        assert len(out.events[0]) > 0
        assert energy.max() <= energy[0] * (1 + 1e-6)


def test_two_balls_dropped_together_send_the_upper_one_high() -> None:
    """A light ball on a heavy one: with e = 1 the light one leaves at v (3 M - m) / (M + m), here 2.5 v."""
    heavy = body("heavy", Sphere(radius=0.2), (0, 0, 1.2), mass=5.0, restitution=1.0)
    light = body("light", BALL, (0, 0, 1.5), mass=5 / 7, restitution=1.0)
    out = run(make_world(heavy, light), np.sqrt(2 / GRAVITY) + 0.01)
    v = np.sqrt(2 * GRAVITY)
    assert out.velocities[0, -1, 1, 2] == pytest.approx(v * (3 * 5 - 5 / 7) / (5 + 5 / 7) - GRAVITY * 0.01, rel=1e-3)
