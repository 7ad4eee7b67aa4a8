"""Every law of force against an integration by SciPy of its formula, written down here once more.

What is allowed, 1e-5 of the path at a substep of 2 ms, is a tenth of what an observation of 0.01% resolves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from polyworld.effects import CATALOGUE
from polyworld.solver.rollout import simulator
from polyworld.world import Effect, World
from polyworld.world.parameters import read_parameter
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.verification import planar_scenes, rope_world
from tests.verification.spatial_world import FLOOR, make_world

Array = NDArray[np.float64]


class State(NamedTuple):
    """Time, position, velocity, angular velocity."""

    t: float
    x: Array
    v: Array
    w: Array


Force = Callable[[State], tuple[Array, Array]]

MASS, RADIUS, G = 0.3, 0.1, np.array([0.0, 0.0, -9.81])
INERTIA = 0.4 * MASS * RADIUS**2
NONE = np.zeros(3)
X, V, OMEGA = np.array([0.2, 0.0, 3.0]), np.array([4.0, 0.0, 5.0]), np.array([0.0, 30.0, 0.0])


def _unit(d: Array) -> Array:
    return d / np.linalg.norm(d)


def _spring(d: Array, v: Array, k: float, rest: float, damping: float) -> float:
    return float(k * (np.linalg.norm(d) - rest) + damping * (_unit(d) @ v))


def _taut(d: Array, length: float) -> float:
    return float(np.linalg.norm(d) > length)


def _pulse(t: float) -> float:
    return (1.0 - np.cos(2.0 * np.pi * (t - 0.3) / 0.5)) / 0.5 if 0.3 < t < 0.8 else 0.0


C = np.array([1.0, 0.0, 3.5])  # centre of the spring and its like
WIND, TURN, PUSH = np.array([-3.0, 0.0, 1.0]), np.array([0.3, 1.0, -0.4]), np.array([1.0, 0.0, 2.0])

# kind -> parameters, and state -> force, torque.
LAWS: dict[str, tuple[dict[str, float], Force]] = {
    "air_drag": (
        {"drag_coefficient": 0.9, "air_density": 2.5},
        lambda m: (-0.5 * 2.5 * 0.9 * np.pi * RADIUS**2 * np.linalg.norm(m.v) * m.v, NONE),
    ),
    "buoyancy": (
        {"density_ratio": 0.3},
        lambda _: (MASS * G * ((1 - 0.3) / (1 + 0.5 * 0.3) - 1), NONE),
    ),
    "central_force": (
        {"centre_x": C[0], "centre_z": C[2], "strength": 0.8, "exponent": -1.5, "softening": 0.05},
        lambda m: (-0.8 * np.hypot(np.linalg.norm(m.x - C), 0.05) ** -2.5 * (m.x - C), NONE),
    ),
    "collision_slack": (
        {"impulse_x": 0.4, "impulse_z": -0.6, "turn_y": 0.002, "time": 0.3, "duration": 0.5},
        lambda m: (_pulse(m.t) * np.array([0.4, 0.0, -0.6]), _pulse(m.t) * np.array([0.0, 0.002, 0.0])),
    ),
    "coriolis": (
        dict(zip(("rotation_x", "rotation_y", "rotation_z"), TURN, strict=True)),
        lambda m: (-2 * MASS * np.cross(TURN, m.v), NONE),
    ),
    "fan": (
        {"force_x": 1.0, "force_z": 2.0, "centre_x": C[0], "centre_z": C[2], "width": 0.6},
        lambda m: (PUSH * np.exp(-np.sum((m.x - C) ** 2) / (2 * 0.6**2)), NONE),
    ),
    "linear_damping": ({"rate": 0.7}, lambda m: (-MASS * 0.7 * m.v, NONE)),
    "linear_drag": ({"coefficient": 0.2}, lambda m: (-0.2 * m.v, NONE)),
    "magnus_lift": ({"coefficient": 0.02}, lambda m: (0.02 * np.cross(m.w, m.v), NONE)),
    "periodic_forcing": (
        {"amplitude_x": 3.0, "amplitude_z": -2.0, "frequency": 2.0, "phase": 0.4},
        lambda m: (MASS * np.array([3.0, 0.0, -2.0]) * np.sin(2 * np.pi * 2.0 * m.t + 0.4), NONE),
    ),
    "quadratic_damping": ({"rate": 0.1}, lambda m: (-MASS * 0.1 * np.linalg.norm(m.v) * m.v, NONE)),
    "quadratic_drag": ({"coefficient": 0.03}, lambda m: (-0.03 * np.linalg.norm(m.v) * m.v, NONE)),
    "spin_damping": ({"coefficient": 2e-3}, lambda m: (NONE, -2e-3 * m.w)),
    "spin_drag": ({"coefficient": 1e-4}, lambda m: (NONE, -1e-4 * np.linalg.norm(m.w) * m.w)),
    "spring": (
        {"anchor_x": C[0], "anchor_z": C[2], "stiffness": 5.0, "rest_length": 0.4, "damping": 0.1},
        lambda m: (-_spring(m.x - C, m.v, 5.0, 0.4, 0.1) * _unit(m.x - C), NONE),
    ),
    "tether": (
        {"anchor_x": C[0], "anchor_z": C[2], "stiffness": 5.0, "rest_length": 1.5, "damping": 0.05},
        lambda m: (-max(0.0, _spring(m.x - C, m.v, 5.0, 1.5, 0.05)) * _taut(m.x - C, 1.5) * _unit(m.x - C), NONE),
    ),
    "uniform_acceleration": ({"x": 1.5, "z": -1.0}, lambda _: (MASS * np.array([1.5, 0.0, -1.0]), NONE)),
    "uniform_force": ({"x": 1.5, "z": -1.0}, lambda _: (np.array([1.5, 0.0, -1.0]), NONE)),
    "unseen_spin_lift": (
        {"rate_x": 0.5, "rate_y": -1.0, "rate_z": 0.8},
        lambda m: (MASS * np.cross([0.5, -1.0, 0.8], m.v), NONE),
    ),
    "viscous_friction": ({"coefficient": 0.4}, lambda _: (NONE, NONE)),  # in the air
    "wind": (
        {"coefficient": 0.03, "velocity_x": WIND[0], "velocity_z": WIND[2]},
        lambda m: (-0.03 * np.linalg.norm(m.v - WIND) * (m.v - WIND), NONE),
    ),
}
FORCES = sorted(kind for kind, law in CATALOGUE.items() if law.force is not None)


def effect(kind: str, parameters: dict[str, float] | None = None) -> Effect:
    return Effect(name="e", kind=kind, parameters=LAWS[kind][0] if parameters is None else parameters)


def ball(representation: str = "rigid_spatial", **fields: Any) -> RigidObject:
    start: dict[str, Any] = {"position": tuple(X), "velocity": tuple(V), "angular_velocity": tuple(OMEGA)}
    given = {"name": "ball", "representation": representation, "shape": Sphere(radius=RADIUS), "mass": MASS}
    return RigidObject(**{**given, "friction": 0.0, **start, **fields})


def spatial(*effects: Effect, substep: float = 0.002, **fields: Any) -> World:
    return make_world(ball(**fields), statics=(), effects=effects, substep=substep)


def planar(*effects: Effect, **fields: Any) -> World:
    """Seen from the side, without a floor."""
    world = planar_scenes.side_view(ball("rigid_planar", **fields))
    return world.model_copy(update={"effects": effects, "statics": ()})


def positions(world: World, times: Array) -> Array:
    result: Array = simulator(world, times, threads=1).run().positions[0, :, 0]
    return result


def exact(force: Force, times: Array, within: Array | None = None) -> Array:
    """Positions by SciPy; `within` projects forces on the plane of motion."""
    onto = np.eye(3) if within is None else np.eye(3) - np.outer(within, within)
    about = np.eye(3) if within is None else np.outer(within, within)

    def rate(t: float, y: Array) -> Array:
        f, torque = force(State(t, y[:3], y[3:6], y[6:]))
        return np.concatenate([y[3:6], onto @ (G + f / MASS), about @ torque / INERTIA])

    start = np.concatenate([X, V, OMEGA])
    out = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=1e-11, atol=1e-12, max_step=0.01)
    result: Array = out.y[:3].T
    return result


def path(x: Array) -> float:
    return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())


TIMES = np.linspace(0.0, 1.6, 81)


def test_every_law_of_force_is_verified_here() -> None:
    assert sorted(LAWS) == FORCES


@pytest.mark.parametrize("kind", FORCES)
def test_flight_in_space_follows_scipy(kind: str) -> None:
    truth = exact(LAWS[kind][1], TIMES)
    error = np.abs(positions(spatial(effect(kind)), TIMES) - truth).max()
    assert error < 1e-5 * path(truth)
    inert = {"viscous_friction", "spin_damping", "spin_drag"}  # in contact only, or on the spin
    without = exact(lambda _: (NONE, NONE), TIMES)
    assert (np.abs(truth - without).max() > 0.1) == (kind not in inert)  # it is the law that is tested


@pytest.mark.parametrize("kind", FORCES)
def test_flight_in_a_plane_follows_scipy(kind: str) -> None:
    truth = exact(LAWS[kind][1], TIMES, within=np.array([0.0, 1.0, 0.0]))
    assert np.abs(positions(planar(effect(kind)), TIMES) - truth).max() < 1e-5 * path(truth)


@pytest.mark.parametrize("make", [spatial, planar])
def test_spin_decays_under_damping_and_takes_the_lift_along(make: Callable[..., World]) -> None:
    """omega0 exp(-c t / I); the lift of a spin that decays against SciPy."""
    both = (effect("spin_damping"), effect("magnus_lift").model_copy(update={"name": "lift"}))
    out = simulator(make(*both), TIMES, threads=1).run()
    decayed = OMEGA[1] * np.exp(-2e-3 * TIMES / INERTIA)
    np.testing.assert_allclose(out.angular_velocities[0, :, 0, 1], decayed, rtol=1e-4, atol=1e-6)

    def force(m: State) -> tuple[Array, Array]:
        return LAWS["magnus_lift"][1](m)[0], -2e-3 * m.w

    truth = exact(force, TIMES)
    assert np.abs(out.positions[0, :, 0] - truth).max() < 1e-5 * path(truth)


@pytest.mark.parametrize("make", [spatial, planar])
def test_spin_under_drag_decays_as_a_hyperbola(make: Callable[..., World]) -> None:
    """omega = omega0 / (1 + k |omega0| t / I)."""
    out = simulator(make(effect("spin_drag")), TIMES, threads=1).run()
    slower = 1.0 + 1e-4 * abs(OMEGA[1]) * TIMES / INERTIA
    np.testing.assert_allclose(out.angular_velocities[0, :, 0, 1], OMEGA[1] / slower, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("kind", ["magnus_lift", "coriolis", "quadratic_drag", "spring", "periodic_forcing"])
def test_forces_are_of_second_order_in_the_substep(kind: str) -> None:
    """Half the substep, a quarter of the error."""
    truth = exact(LAWS[kind][1], TIMES)
    coarse, fine = (np.abs(positions(spatial(effect(kind), substep=h), TIMES) - truth).max() for h in (0.02, 0.01))
    assert 3.0 < coarse / fine < 5.5


def test_lift_of_a_tumbling_box_follows_eulers_equations() -> None:
    """A body whose spin wanders without any torque: its lift is that of the spin at mid-step."""
    half = np.array([0.05, 0.1, 0.2])
    moments = (
        MASS / 3 * np.array([half[1] ** 2 + half[2] ** 2, half[0] ** 2 + half[2] ** 2, half[0] ** 2 + half[1] ** 2])
    )
    spin = np.array([0.5, 6.0, 1.0])
    lift = effect("magnus_lift", {"coefficient": 0.1})
    world = spatial(lift, shape=Box(half_extents=tuple(half)), angular_velocity=tuple(spin))

    def rate(_t: float, y: Array) -> Array:
        turn, w = Rotation.from_quat(y[6:10]), y[10:]  # w in body axes
        q_rate = 0.5 * np.array([*(y[9] * w + np.cross(y[6:9], w)), -y[6:9] @ w])
        lifted = 0.1 / MASS * np.cross(turn.apply(w), y[3:6])
        return np.concatenate([y[3:6], G + lifted, q_rate, np.cross(moments * w, w) / moments])

    start = np.concatenate([X, V, [0, 0, 0, 1], spin])
    truth = solve_ivp(rate, (0, 1.6), start, "DOP853", TIMES, rtol=1e-11, atol=1e-12).y[:3].T
    assert np.abs(positions(world, TIMES) - truth).max() < 1e-5 * path(truth)


@pytest.mark.parametrize("kind", FORCES)
def test_a_law_at_its_defaults_does_nothing_at_all(kind: str) -> None:
    for make in (spatial, planar):
        np.testing.assert_array_equal(positions(make(effect(kind, {})), TIMES), positions(make(), TIMES))


@pytest.mark.parametrize("kind", FORCES)
def test_paths_depend_smoothly_on_every_parameter(kind: str) -> None:
    """A fit follows derivatives: over 2e-4 of the range searched, paths change linearly to 1%."""
    world = spatial(effect(kind))
    for name, spec in CATALOGUE[kind].parameters.items():
        here = f"effects.e.{name}"
        value = read_parameter(world, here)
        assert value is not None
        values = value + np.array([-1.0, 0.0, 1.0]) * 1e-4 * (spec.search[1] - spec.search[0])
        low, middle, high = simulator(world, TIMES, n_worlds=3, threads=1).run({here: values}).positions[:, :, 0]
        assert np.abs(high + low - 2 * middle).max() <= 0.01 * np.abs(high - low).max() + 2e-6


def bouncing(force: Force, restitution: float, times: Array) -> Array:
    """A frictionless ball on the floor z = 0 by SciPy, from impact to impact."""

    def rate(t: float, y: Array) -> Array:
        f, torque = force(State(t, y[:3], y[3:6], y[6:]))
        return np.concatenate([y[3:6], G + f / MASS, torque / INERTIA])

    def height(_t: float, y: Array) -> float:
        return float(y[2] - RADIUS)

    height.terminal, height.direction = True, -1  # type: ignore[attr-defined]
    now, y, found = 0.0, np.concatenate([[0.2, 0.0, 0.6], [2.0, 0.0, 0.0], OMEGA]), []
    while now < times[-1]:
        out = solve_ivp(rate, (now, times[-1]), y, "DOP853", events=height, rtol=1e-11, atol=1e-12, dense_output=True)
        found.append(out.sol(times[(times >= now) & (times < out.t[-1])])[:3].T)
        now, y = out.t[-1], out.y[:, -1].copy()
        y[5] *= -restitution
    return np.concatenate([*found, y[None, :3]])[: len(times)]


@pytest.mark.parametrize("kind", ["quadratic_drag", "magnus_lift", "viscous_friction", "wind"])
@pytest.mark.parametrize("representation", ["rigid_spatial", "rigid_planar"])
def test_forces_go_on_right_after_a_bounce(kind: str, representation: str) -> None:
    """Three bounces: the part of a step after an impact must see the velocity after it; viscous friction, none."""
    start: dict[str, Any] = {"position": (0.2, 0.0, 0.6), "velocity": (2.0, 0.0, 0.0), "restitution": 0.9}
    thrown = ball(representation, **start)
    floor = FLOOR.model_copy(update={"restitution": 0.9})
    world = planar_scenes.side_view(thrown) if representation == "rigid_planar" else make_world(thrown)
    world = world.model_copy(update={"statics": (floor,), "effects": (effect(kind),)})
    truth = bouncing(LAWS[kind][1], 0.9, TIMES)
    # The engine counts a gap of 1e-5 radii as touching, and an impact begins there.
    assert np.abs(positions(world, TIMES) - truth).max() < 5e-5 * path(truth)


SLIDE = np.linspace(0.0, 1.0, 51)


def slider(representation: str, **fields: Any) -> World:
    """A box pushed over the floor at 3 m/s with a Coulomb coefficient of 0.1."""
    box = Box(half_extents=(0.1, 0.1, 0.05))
    start: dict[str, Any] = {"position": (0.0, 0.0, 0.05), "velocity": (3.0, 0.0, 0.0), "mass": MASS, **fields}
    item = RigidObject(name="box", representation=representation, shape=box, friction=0.1, **start)
    return make_world(item) if representation == "rigid_spatial" else planar_scenes.top_view(item)


def on_edge() -> World:
    """The same, seen from the side: it slides on the edge of the floor and presses on no plane of motion."""
    return planar_scenes.side_view(slider("rigid_planar").objects[0])


@pytest.mark.parametrize(
    "world", [slider("rigid_spatial"), slider("rigid_planar"), on_edge()], ids=["space", "table", "side view"]
)
def test_viscous_friction_acts_on_what_slides_from_the_first_step_on(world: World) -> None:
    """dv/dt = -mu g - c v / m: x = (v0 + mu g / k) (1 - exp(-k t)) / k - mu g t / k with k = c / m."""
    world = world.model_copy(update={"effects": (effect("viscous_friction", {"coefficient": 0.15}),)})
    k, a = 0.15 / MASS, 0.1 * 9.81
    truth = (3.0 + a / k) * (1 - np.exp(-k * SLIDE)) / k - a * SLIDE / k
    assert np.abs(positions(world, SLIDE)[:, 0] - truth).max() < 2e-5 * truth[-1]


@pytest.mark.parametrize(
    "world", [slider("rigid_spatial"), slider("rigid_planar"), on_edge()], ids=["space", "table", "side view"]
)
def test_drag_on_what_slides_sees_friction_slow_it(world: World) -> None:
    """dv/dt = -mu g - k v^2: v = s tan(arctan(v0 / s) - s k t), s^2 = mu g / k."""
    world = world.model_copy(update={"effects": (effect("quadratic_damping", {"rate": 0.3}),)})
    a, k = 0.1 * 9.81, 0.3
    s = np.sqrt(a / k)
    angle = np.arctan(3.0 / s)
    truth = np.log(np.cos(angle - s * k * SLIDE) / np.cos(angle)) / k
    assert np.abs(positions(world, SLIDE)[:, 0] - truth).max() < 2e-5 * truth[-1]


def test_balls_of_several_sizes_share_one_drag_coefficient() -> None:
    """Terminal speed sqrt(2 m g / (rho C_d pi R^2)) of three balls under one law."""
    sizes = {"a": (0.1, 0.02), "b": (0.2, 0.3), "c": (0.05, 0.001)}
    balls = [
        ball(name=n, shape=Sphere(radius=r), mass=m, position=(i, 0.0, 900.0), velocity=(0.0, 0.0, 0.0))
        for i, (n, (r, m)) in enumerate(sizes.items())
    ]
    world = make_world(*balls, statics=(), effects=(effect("air_drag", {"drag_coefficient": 0.47}),))
    out = simulator(world, np.array([0.0, 12.0]), threads=1).run()
    for i, (r, m) in enumerate(sizes.values()):
        fall = np.sqrt(2 * m * 9.81 / (1.2 * 0.47 * np.pi * r**2))
        assert -out.velocities[0, -1, i, 2] == pytest.approx(fall, rel=1e-5)


PER_MASS = sorted(kind for kind, law in CATALOGUE.items() if law.per_mass)


@pytest.mark.parametrize("kind", PER_MASS)
def test_what_acts_per_mass_moves_a_rope_as_it_does_a_ball(kind: str) -> None:
    """A rope all of whose nodes start alike keeps its shape. Nodes move by a scheme of first order: to 0.25%."""
    ends = np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]]) + X
    line = rope_world.rope(ends.tolist(), 4, linear_damping=0.0, velocity=V.tolist())
    scene = rope_world.world(line, effects=[effect(kind).model_dump()])
    _, motion = rope_world.run(scene, 1.0, 0.02)
    truth = exact(LAWS[kind][1], np.linspace(0.0, 1.0, 51))
    assert np.abs(motion.points.mean(axis=1) - truth).max() < 2.5e-3 * path(truth)


def test_a_law_that_is_not_per_mass_refuses_ropes_and_names_those_that_are() -> None:
    line = rope_world.rope([[0, 0, 1], [1, 0, 1]], 4)
    with pytest.raises(ValueError, match=r"wind acts on rigid objects only.*'coriolis'.*'periodic_forcing'"):
        rope_world.world(line, effects=[{"name": "e", "kind": "wind"}])
