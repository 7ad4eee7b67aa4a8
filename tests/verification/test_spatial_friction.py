"""Friction, rolling and spinning: sliding distances, the friction cone, rolling without slipping, tipping."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from polyworld.trajectory import BatchTrajectory
from polyworld.world import geometry
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere
from tests.verification.spatial_world import FLOOR, GRAVITY, body, make_world, run, slope

CUBE = Box(half_extents=(0.1, 0.1, 0.1))


def on_slope(angle: float, height: float) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Position and orientation of a body whose centre is `height` above the slope and which lies flat on it."""
    position = (height * np.sin(angle), 0.0, height * np.cos(angle))
    return position, (float(np.cos(angle / 2)), 0.0, float(np.sin(angle / 2)), 0.0)


def down(out: BatchTrajectory, angle: float, index: int = 0) -> np.ndarray:
    """Distance travelled down the slope [m]."""
    moved = out.positions[0, :, index] - out.positions[0, 0, index]
    distance: np.ndarray = moved @ np.array([np.cos(angle), 0.0, -np.sin(angle)])
    return distance


@pytest.mark.parametrize(
    "shape", [CUBE, Cylinder(radius=0.1, half_height=0.1), Box(half_extents=(0.2, 0.1, 0.05))], ids=lambda s: s.kind
)
@pytest.mark.parametrize("substep", [0.002, 0.01])
@pytest.mark.parametrize("angle", [0.0, 0.1])
def test_slide_length_is_v2_over_2_a(shape: Box | Cylinder, substep: float, angle: float) -> None:
    """With a = g (mu cos - sin) down a slope, in a straight line; wherever in a step the body comes to rest."""
    height = shape.half_height if isinstance(shape, Cylinder) else shape.half_extents[2]
    position, orientation = on_slope(angle, height)
    velocity = (2 * np.cos(angle), 0.0, -2 * np.sin(angle))
    sliding = body("b", shape, position, orientation=orientation, velocity=velocity, friction=0.2)
    out = run(make_world(sliding, statics=(slope(angle),), substep=substep), 2.5)
    length = 4 / (2 * GRAVITY * (0.2 * np.cos(angle) - np.sin(angle)))
    assert down(out, angle)[-1] == pytest.approx(length, abs=1e-7)
    assert abs(out.positions[0, -1, 0, 1]) < 1e-6
    assert np.abs(out.velocities[0, -1]).max() < 1e-9


@pytest.mark.parametrize("shape", [CUBE, Cylinder(radius=0.1, half_height=0.05)], ids=lambda s: s.kind)
def test_no_creep_at_nine_tenths_of_the_critical_slope(shape: Box | Cylinder) -> None:
    """Below tan(theta) = mu nothing moves: less than 1e-6 m in 2 s."""
    angle = np.arctan(0.9 * 0.5)
    height = shape.half_height if isinstance(shape, Cylinder) else shape.half_extents[2]
    position, orientation = on_slope(angle, height)
    out = run(
        make_world(body("b", shape, position, orientation=orientation, friction=0.5), statics=(slope(angle),)), 2.0
    )
    assert np.abs(out.positions[0] - out.positions[0, 0]).max() < 1e-6


@pytest.mark.parametrize("ratio", [0.99, 1.01])
def test_sliding_begins_at_the_friction_cone(ratio: float) -> None:
    """At 1.01 tan(theta) = mu it slides with g (sin - mu cos), at 0.99 it stays."""
    angle = np.arctan(ratio * 0.4)
    position, orientation = on_slope(angle, 0.1)
    out = run(
        make_world(body("b", CUBE, position, orientation=orientation, friction=0.4), statics=(slope(angle),)), 2.0
    )
    acceleration = max(0.0, GRAVITY * (np.sin(angle) - 0.4 * np.cos(angle)))
    assert down(out, angle)[-1] == pytest.approx(0.5 * acceleration * 4.0, abs=2e-6, rel=1e-3)


def test_friction_opposes_the_velocity_in_every_direction() -> None:
    """A true cone: the slide length and direction do not depend on the direction of motion."""
    for angle in np.linspace(0.0, np.pi / 2, 7):
        velocity = (2 * np.cos(angle), 2 * np.sin(angle), 0.0)
        out = run(make_world(body("b", CUBE, (0, 0, 0.1), velocity=velocity, friction=0.3)), 1.5)
        end = out.positions[0, -1, 0, :2]
        assert np.linalg.norm(end) == pytest.approx(4 / (2 * 0.3 * GRAVITY), rel=2e-3)
        assert abs(np.arctan2(end[1], end[0]) - angle) < 2e-3


@pytest.mark.parametrize(
    ("shape", "factor"),
    [(Sphere(radius=0.1), 2 / 5), (Cylinder(radius=0.1, half_height=0.2), 1 / 2)],
    ids=["sphere", "cylinder"],
)
def test_rolling_down_a_slope_without_slipping(shape: Sphere | Cylinder, factor: float) -> None:
    """a = g sin(theta) / (1 + I/mr^2): 5/7 of sliding for a ball, 2/3 for a cylinder; omega r = v."""
    angle = 0.3
    position, _ = on_slope(angle, 0.1)
    lying = (float(np.sqrt(0.5)), float(np.sqrt(0.5)), 0.0, 0.0)  # cylinder axis along y
    out = run(make_world(body("b", shape, position, orientation=lying, friction=0.6), statics=(slope(angle),)), 2.0)
    acceleration = GRAVITY * np.sin(angle) / (1 + factor)
    assert down(out, angle)[-1] == pytest.approx(0.5 * acceleration * 4, rel=1e-4)
    assert out.angular_velocities[0, -1, 0, 1] * 0.1 == pytest.approx(acceleration * 2, rel=1e-4)
    heights = out.positions[0, :, 0] @ np.array([np.sin(angle), 0.0, np.cos(angle)])
    assert np.abs(heights - 0.1).max() < 2e-5  # no facets: the axis stays at one height


@pytest.mark.parametrize("substep", [0.002, 0.01])
def test_sliding_ball_goes_over_to_rolling(substep: float) -> None:
    """Thrown with any spin, the point of contact slips in one direction, 7/2 mu g slower each second, until it rolls.

    Its turn is that of the angular velocity, integrated by SciPy: turns about an axis that moves do not commute.
    """
    r, friction = 0.1, 0.2
    up, velocity, spin = np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.5, 0.0]), np.array([3.0, -12.0, 8.0])
    thrown = body("b", Sphere(radius=r), r * up, velocity=velocity, angular_velocity=spin, friction=friction)
    out = run(make_world(thrown, substep=substep), 1.0)
    slip = velocity + np.cross(spin, -r * up)
    towards = -slip / np.linalg.norm(slip)
    moment = float(np.linalg.norm(slip)) / (3.5 * friction * GRAVITY)
    turning = np.cross(-r * up, towards) * friction * GRAVITY / (0.4 * r**2)
    t = out.times[0]
    slipping, rolling = np.minimum(t, moment)[:, None], np.maximum(t - moment, 0.0)[:, None]
    path = r * up + velocity * t[:, None]
    path = path + friction * GRAVITY * towards * (0.5 * slipping**2 + slipping * rolling)
    assert np.abs(out.positions[0, :, 0] - path).max() < 1e-9
    assert np.abs(out.angular_velocities[0, :, 0] - spin - turning * slipping).max() < 1e-6

    def rate(time: float, turned: np.ndarray) -> np.ndarray:
        own = spin + turning * min(time, moment)
        return 0.5 * np.append(turned[3] * own + np.cross(own, turned[:3]), -own @ turned[:3])

    whole = solve_ivp(rate, (0.0, 1.0), [0.0, 0.0, 0.0, 1.0], t_eval=t, max_step=0.005, rtol=1e-9, atol=1e-9).y.T
    apart = Rotation.from_quat(np.roll(out.orientations[0, :, 0], -1, axis=-1)) * Rotation.from_quat(whole).inv()
    assert apart.magnitude().max() < 5e-6


@pytest.mark.parametrize("shape", [Sphere(radius=0.1), Capsule(radius=0.1, half_height=0.1)], ids=lambda s: s.kind)
def test_rolling_resistance_slows_a_rolling_body(shape: Sphere | Capsule) -> None:
    """M = b N takes (b g / r) / (1 + I/mr^2) off the speed every second, and holds it on a slope below b/r."""
    b, r = 0.004, 0.1
    solid = geometry.mass_properties(shape)
    lying = (float(np.sqrt(0.5)), float(np.sqrt(0.5)), 0.0, 0.0)
    inertia = solid.inertia[2, 2] / solid.volume
    fields = {"orientation": lying, "friction": 0.8, "rolling_resistance": b}
    out = run(make_world(body("b", shape, (0, 0, r), velocity=(1, 0, 0), angular_velocity=(0, 10, 0), **fields)), 1.0)
    lost = b * GRAVITY / r / (1 + inertia / r**2)
    assert 1 - out.velocities[0, -1, 0, 0] == pytest.approx(lost, rel=1e-3)
    angle = np.arctan(0.9 * b / r)
    position, _ = on_slope(angle, r)
    held = run(make_world(body("b", shape, position, **fields), statics=(slope(angle),)), 2.0)
    assert np.abs(held.positions[0] - held.positions[0, 0]).max() < 1e-6


@pytest.mark.parametrize("spin", [21.0, 21.02, 21.04, 21.06])
def test_rolling_resistance_of_a_spin_that_friction_reverses(spin: float) -> None:
    """A ball thrown with backspin: both moments brake the spin, then the resistance alone opposes it.

    The spin passes zero at different parts of a step; a step that left it there would lose 0.03 rad/s.
    """
    b, r, mu = 0.006, 0.1, 0.12
    fields = {"friction": mu, "rolling_resistance": b}
    out = run(
        make_world(
            body("b", Sphere(radius=r), (0, 0, r), velocity=(-2.5, 0, 0), angular_velocity=(0, spin, 0), **fields)
        ),
        0.7,
    )
    driven, braked = mu * GRAVITY / (0.4 * r), b * GRAVITY / (0.4 * r**2)
    turn = spin / (driven + braked)
    t = out.times[0]
    expected = np.where(t < turn, spin - (driven + braked) * t, -(driven - braked) * (t - turn))
    away = np.abs(t - turn) > 0.003
    assert np.abs(out.angular_velocities[0, :, 0, 1] - expected)[away].max() < 1e-3


def test_torsional_friction_stops_a_spinning_ball() -> None:
    """M = mu N r: the spin falls by mu g r m / I every second and stays at zero."""
    mu, patch, radius = 0.5, 0.01, 0.1
    ball = body(
        "b",
        Sphere(radius=radius),
        (0, 0, radius),
        angular_velocity=(0, 0, 10),
        friction=mu,
        torsional_radius=patch,
    )
    out = run(make_world(ball), 2.0)
    rate = mu * GRAVITY * patch / (0.4 * radius**2)
    expected = np.maximum(0.0, 10 - rate * out.times[0])
    assert np.abs(out.angular_velocities[0, :, 0, 2] - expected).max() < 1e-6
    assert 10 / rate < 2.0


def test_spinning_disc_feels_two_thirds_of_its_radius() -> None:
    """A flat disc under uniform pressure: M = 2/3 mu N R, so omega falls by 4 mu g / (3 R) every second."""
    disc = body("d", Cylinder(radius=0.2, half_height=0.02), (0, 0, 0.02), angular_velocity=(0, 0, 12), friction=0.3)
    out = run(make_world(disc), 0.5)
    rate = 4 * 0.3 * GRAVITY / (3 * 0.2)
    assert 12 - out.angular_velocities[0, -1, 0, 2] == pytest.approx(rate * 0.5, rel=2e-3)
    assert np.abs(out.positions[0, :, 0, :2]).max() < 1e-9


@pytest.mark.parametrize("ratio", [0.97, 1.03])
@pytest.mark.parametrize("shape", ["box", "mesh", "cylinder"])
def test_tall_body_tips_when_the_slope_exceeds_width_over_height(shape: str, ratio: float) -> None:
    """It stands while the weight falls inside the base, tan(theta) < width / height, and tips beyond."""
    half_width, half_height = 0.1, 0.25
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3) * (0.1, 0.1, 0.25)
    shapes = {
        "box": Box(half_extents=(half_width, half_width, half_height)),
        "mesh": ConvexMesh(vertices=tuple(map(tuple, corners.tolist()))),
        "cylinder": Cylinder(radius=half_width, half_height=half_height),
    }
    angle = np.arctan(ratio * half_width / half_height)
    position, orientation = on_slope(angle, half_height)
    tall = body("b", shapes[shape], position, orientation=orientation, friction=5.0, restitution=0.0)
    out = run(make_world(tall, statics=(slope(angle),)), 3.0)
    turned = 2 * np.arccos(np.minimum(1.0, np.abs(out.orientations[0, :, 0] @ np.array(orientation))))
    if ratio < 1:
        assert turned.max() < 1e-3
    else:
        assert turned.max() > 1.0


def test_upright_cylinder_keeps_sliding_straight_and_upright() -> None:
    """Friction below the tipping limit leaves a sliding cylinder upright, to 1e-4 rad."""
    can = body("c", Cylinder(radius=0.1, half_height=0.1), (0, 0, 0.1), velocity=(2, 1, 0), friction=0.4)
    out = run(make_world(can, statics=(FLOOR,)), 1.0)
    assert (1 - geometry.quaternion_matrix(out.orientations[0, :, 0])[:, 2, 2]).max() < 1e-8
    assert np.linalg.norm(out.positions[0, -1, 0, :2]) == pytest.approx(5 / (2 * 0.4 * GRAVITY), rel=1e-3)


def test_spinning_cube_feels_the_mean_distance_of_its_face() -> None:
    """A square face under uniform pressure: M = mu N a (sqrt 2 + asinh 1) / 3, a half the edge."""
    cube = body("b", CUBE, (0, 0, 0.1), angular_velocity=(0, 0, 12), friction=0.3)
    out = run(make_world(cube), 0.4)
    arm = 0.1 * (np.sqrt(2) + np.arcsinh(1)) / 3
    rate = 0.3 * GRAVITY * arm / (2 / 3 * 0.1**2)
    assert 12 - out.angular_velocities[0, -1, 0, 2] == pytest.approx(min(12, rate * 0.4), rel=2e-3)


def test_spin_lengthens_the_slide_of_a_disc() -> None:
    """Sliding and spinning share the friction: a spinning disc slides farther, and both end together.

    Farkas, Bartels, Unger & Wolf (2003), Phys. Rev. Lett. 90, 248302: v and R omega reach zero at one moment.
    """
    radius = 0.2
    ends = []
    for spin in (0.0, 15.0):
        disc = body(
            "d",
            Cylinder(radius=radius, half_height=0.01),
            (0, 0, 0.01),
            velocity=(1, 0, 0),
            angular_velocity=(0, 0, spin),
            friction=0.3,
        )
        out = run(make_world(disc), 2.0, samples=2001)
        ends.append(float(np.linalg.norm(out.positions[0, -1, 0, :2])))
    assert ends[1] > 1.1 * ends[0]
    moving = np.linalg.norm(out.velocities[0, :, 0], axis=1) > 1e-6
    turning = np.abs(out.angular_velocities[0, :, 0, 2]) > 1e-5
    last = out.times[0][np.flatnonzero(moving)[-1]], out.times[0][np.flatnonzero(turning)[-1]]
    assert last[0] == pytest.approx(last[1], abs=0.01)


def test_tower_stands_under_a_hundred_times_its_mass() -> None:
    """Four cubes carry one of 100 times their mass for 5 s; none moves by more than 0.2% of its edge.

    The lowest contacts hold a hundred times what their bodies weigh, on which sweeps over contacts converge slowly.
    """
    masses = (1.0, 1.0, 1.0, 1.0, 100.0)
    cubes = [body(f"b{k}", CUBE, (0, 0, 0.1 + 0.2 * k), mass=m, friction=0.5) for k, m in enumerate(masses)]
    out = run(make_world(*cubes), 5.0)
    assert np.abs(out.positions[0] - out.positions[0, 0]).max() < 4e-4
