"""Motion without contact: free fall, damping, effects, the torque-free top."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from polyworld.world import Effect, geometry
from polyworld.world.shapes import Box, ConvexMesh, Sphere
from tests.verification.spatial_world import GRAVITY, body, make_world, run


def test_free_fall_is_the_parabola() -> None:
    """x0 + v t - g t^2 / 2 at every sample, to rounding."""
    world = make_world(body("ball", Sphere(radius=0.1), (0, 0, 50), velocity=(1, 2, 3)), statics=())
    out = run(world, 2.0)
    t = out.times[0]
    exact = np.stack([t, 2 * t, 50 + 3 * t - 0.5 * GRAVITY * t**2], axis=1)
    assert np.abs(out.positions[0, :, 0] - exact).max() < 1e-11


def test_damping_is_exponential_and_reaches_terminal_velocity() -> None:
    """dv/dt = g - c v: v = g/c (1 - exp(-c t)), z its integral; spin decays with its own rate."""
    c, d = 1.5, 0.7
    ball = body(
        "ball", Sphere(radius=0.1), (0, 0, 100), linear_damping=c, angular_damping=d, angular_velocity=(0, 0, 5)
    )
    out = run(make_world(ball, statics=(), substep=0.01), 3.0)
    t = out.times[0]
    fall = GRAVITY / c * (t - (1 - np.exp(-c * t)) / c)
    assert np.abs(out.positions[0, :, 0, 2] - (100 - fall)).max() < 1e-9
    assert np.abs(out.angular_velocities[0, :, 0, 2] - 5 * np.exp(-d * t)).max() < 1e-9
    turned = Rotation.from_quat(np.roll(out.orientations[0, :, 0], -1, axis=-1)).as_rotvec()[:, 2]
    angle = np.unwrap(turned)
    assert np.abs(angle - 5 / d * (1 - np.exp(-d * t))).max() < 1e-9


def test_quadratic_drag_brings_a_fall_to_terminal_velocity() -> None:
    """v = v_t tanh(g t / v_t) with v_t = sqrt(m g / k), the law's own convention read from its force."""
    effect = Effect(name="air", kind="quadratic_drag", parameters={"coefficient": 0.1})
    out = run(make_world(body("ball", Sphere(radius=0.1), (0, 0, 100)), statics=(), effects=(effect,)), 3.0)
    speed = -out.velocities[0, :, 0, 2]
    terminal = np.sqrt(GRAVITY / 0.1)
    expected = terminal * np.tanh(GRAVITY * out.times[0] / terminal)
    assert np.abs(speed - expected).max() < 1e-4 * terminal


def _euler_top(inertia: np.ndarray, omega: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Body rates and world attitude of a torque-free top by SciPy's DOP853 on Euler's equations."""

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        w, q = y[:3], y[3:]
        spin = np.linalg.solve(inertia, np.cross(inertia @ w, w))
        return np.concatenate([spin, 0.5 * geometry.quaternion_product(q, np.concatenate([[0.0], w]))])

    start = np.concatenate([omega, [1.0, 0.0, 0.0, 0.0]])
    y = solve_ivp(rate, (0, duration), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return y[:3], y[3:] / np.linalg.norm(y[3:])


@pytest.mark.parametrize("omega", [(4.0, 1.0, 0.5), (0.01, 6.0, 0.02)])  # the second tumbles about the middle axis
def test_torque_free_top_follows_eulers_equations(omega: tuple[float, float, float]) -> None:
    """A box of three different moments of inertia, 5 s, against SciPy; energy and angular momentum kept."""
    shape = Box(half_extents=(0.3, 0.2, 0.1))
    out = run(make_world(body("top", shape, (0, 0, 0), angular_velocity=omega), statics=(), gravity=(0, 0, 0)), 5.0)
    solid = geometry.mass_properties(shape)
    inertia = solid.inertia / solid.volume
    rates, attitude = _euler_top(inertia, np.array(omega), 5.0)
    got = out.orientations[0, -1, 0]
    assert 2 * np.arccos(min(1.0, abs(got @ attitude))) < 1e-4
    turn = geometry.quaternion_matrix(got)
    assert np.abs(turn.T @ out.angular_velocities[0, -1, 0] - rates).max() < 1e-4
    turns = geometry.quaternion_matrix(out.orientations[0, :, 0])
    world_inertia = turns @ inertia @ np.swapaxes(turns, 1, 2)
    momentum = np.einsum("tij,tj->ti", world_inertia, out.angular_velocities[0, :, 0])
    energy = 0.5 * np.einsum("ti,ti->t", momentum, out.angular_velocities[0, :, 0])
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * np.linalg.norm(momentum[0])
    assert np.abs(energy / energy[0] - 1).max() < 1e-7


def test_spin_about_the_middle_axis_flips_and_about_the_others_does_not() -> None:
    """Dzhanibekov: the middle axis of inertia is unstable, the two others are stable."""
    shape = Box(half_extents=(0.3, 0.2, 0.1))
    least = []
    for axis in range(3):
        omega = np.full(3, 0.02)
        omega[axis] = 8.0
        out = run(make_world(body("top", shape, (0, 0, 0), angular_velocity=omega), statics=(), gravity=(0, 0, 0)), 8.0)
        along = geometry.quaternion_matrix(out.orientations[0, :, 0])[:, :, axis][:, axis]
        least.append(along.min())
    assert least[1] < -0.99
    assert least[0] > 0.99
    assert least[2] > 0.99


def test_lopsided_mesh_turns_about_its_centre_of_mass() -> None:
    """A convex mesh with products of inertia moves like its own Euler equations say."""
    shape = ConvexMesh(vertices=((0, 0, 0), (0.6, 0, 0), (0, 0.4, 0), (0.1, 0.1, 0.3), (0.5, 0.3, 0.1)))
    omega = (1.0, -2.0, 3.0)
    out = run(make_world(body("rock", shape, (0, 0, 0), angular_velocity=omega), statics=(), gravity=(0, 0, 0)), 3.0)
    solid = geometry.mass_properties(shape)
    _, attitude = _euler_top(solid.inertia / solid.volume, np.array(omega), 3.0)
    assert 2 * np.arccos(min(1.0, abs(out.orientations[0, -1, 0] @ attitude))) < 1e-5
    assert np.abs(out.positions[0]).max() < 1e-12
