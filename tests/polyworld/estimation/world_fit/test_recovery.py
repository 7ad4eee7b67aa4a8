"""Fits of the engine to motion that other code produced, with noise: are the laws' numbers found again?

The other code is SciPy's ODE solver with the impact law written out here, closed-form ballistics, and MuJoCo.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.initial_states import initial_states, with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    FitProblem,
    Objective,
    SearchSettings,
    Unknown,
    accuracy,
    default_unknowns,
    fit,
    refine,
)
from polyworld.estimation.world_fit.default_unknowns import REACH
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.parameters import with_parameters
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere

Array = NDArray[np.float64]
GRAVITY = 9.81
RADIUS = 0.1


@dataclass(frozen=True)
class Pucks:
    """Two flat pucks on a table: friction mu (table and each other), damping c, restitution e, mass of the second."""

    mu: float = 0.12
    c: float = 0.25
    e: float = 0.7
    mass: float = 1.8


def slide_pucks(law: Pucks, times: Array) -> Array:
    """Poses (T, 2, 3) of x, y, angle by SciPy: friction of a pressed disc on its limit surface, one impact.

    Patch radius 2 R / 3; (v, r omega) opposed by a force and a moment with a common size (Howe & Cutkosky
    1996); at the impact Newton's restitution along the normal and Coulomb's limit along the tangent.
    """
    patch = 2.0 / 3.0 * RADIUS
    masses = np.array([1.0, law.mass])
    inertia = 0.5 * masses * RADIUS**2

    def rates(_: float, state: Array) -> Array:
        velocity, spin = state[6:10].reshape(2, 2), state[10:12]
        size = np.sqrt((velocity**2).sum(axis=1) + (patch * spin) ** 2)
        size = np.sqrt(size**2 + 1e-10)  # rest is approached, not crossed
        push = -law.mu * GRAVITY * velocity / size[:, None] - law.c * velocity
        turn = -law.mu * GRAVITY * masses * patch**2 * spin / size / inertia
        return np.concatenate([velocity.ravel(), spin, push.ravel(), turn])

    def touch(_: float, state: Array) -> float:
        return float(np.hypot(*(state[2:4] - state[0:2])) - 2.0 * RADIUS)

    touch.terminal, touch.direction = True, -1.0
    state = np.array([0, 0, 0.8, 0.06, 0, 0, 1.7, 0, -0.4, 0, 0, 0], dtype=float)
    poses: list[Array] = []
    start, rest = 0.0, times
    while len(rest):
        result = solve_ivp(
            rates,
            (start, rest[-1] + 1e-9),
            state,
            method="LSODA",
            rtol=1e-9,
            atol=1e-11,
            dense_output=True,
            events=touch,
        )
        reached = rest[rest <= result.t[-1]]
        poses += [result.sol(t)[:6] for t in reached]
        rest = rest[len(reached) :]
        if result.status != 1:
            break
        start, state = float(result.t[-1]), _impact(law, result.y[:, -1], masses, inertia)
    flat = np.array(poses)
    return np.stack([flat[:, [0, 1, 4]], flat[:, [2, 3, 5]]], axis=1)


def _impact(law: Pucks, state: Array, masses: Array, inertia: Array) -> Array:
    velocity, spin = state[6:10].reshape(2, 2).copy(), state[10:12].copy()
    normal = (state[2:4] - state[0:2]) / np.hypot(*(state[2:4] - state[0:2]))
    tangent = np.array([-normal[1], normal[0]])
    relative = velocity[1] - velocity[0]
    slip = relative @ tangent - RADIUS * spin.sum()
    along = -(1.0 + law.e) * (relative @ normal) / (1.0 / masses).sum()
    across = np.clip(-slip / (1.0 / masses + RADIUS**2 / inertia).sum(), -law.mu * along, law.mu * along)
    impulse = along * normal + across * tangent
    velocity += np.outer([-1.0, 1.0] / masses, impulse)
    spin -= RADIUS * across / inertia
    return np.concatenate([state[:6], velocity.ravel(), spin])


def pucks_world(tracks: ObservedTracks) -> World:
    """Two pucks with the default parameters, placed as the tracks begin."""
    pucks = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=Cylinder(radius=RADIUS, half_height=0.02),
            mass=1.0,
            position=(0, 0, 0.02),
        )
        for name in ("first", "second")
    )
    step = tracks.seconds_per_frame
    return with_initial_states(World(objects=pucks, time=TimeBase(seconds_per_frame=step)), tracks)


def tracks_of(poses: Array, step: float, sigma: float, seed: int) -> ObservedTracks:
    """Positions (T, n, 2) on the table with noise; rotation unknown."""
    t, n = poses.shape[:2]
    noise = np.random.default_rng(seed).normal(0.0, sigma, (t, n, 2))
    positions = np.concatenate([poses[..., :2] + noise, np.full((t, n, 1), 0.02)], axis=-1)
    return ObservedTracks(
        names=("first", "second")[:n],
        frames=np.arange(t),
        seconds_per_frame=step,
        positions=positions,
        position_sigma=np.full((t, n), sigma),
        orientations=np.full((t, n, 4), np.nan),
        confidence=np.ones((t, n)),
        orientation_confidence=np.zeros((t, n)),
        symmetry=(0,) * n,
    )


def puck_unknowns(world: World, tracks: ObservedTracks) -> list[Unknown]:
    return default_unknowns(
        world, tracks, shared=("friction", "linear_damping", "restitution"), each=("mass",), effects=False
    )


@pytest.mark.parametrize("law", [Pucks(), Pucks(mu=0.05, c=0.6, e=0.35, mass=0.6)])
def test_friction_damping_restitution_and_mass_ratio_of_colliding_pucks(law: Pucks) -> None:
    step = 1.0 / 60.0
    times = np.arange(90) * step
    exact = slide_pucks(law, times)
    tracks = tracks_of(exact, step, 0.002, seed=5)
    world = pucks_world(tracks)
    parameters = puck_unknowns(world, tracks)
    problem = FitProblem(world, tracks, parameters)
    searches = sorted((fit(problem, SearchSettings(seed=s)) for s in range(3)), key=lambda result: result.loss)
    found = searches[1]  # one search in a few ends early; the middle one is what to expect
    polished = refine(problem, found.by_name)
    truth = {"friction": law.mu, "linear_damping": law.c, "restitution": law.e, "second.mass": law.mass}
    for name, true in truth.items():
        value = polished.value(name)
        assert abs(value.value - true) < 3.5 * value.standard_error, (name, value)
    # The data determine what a collision shows; friction and damping both slow down and are known less well.
    assert polished.value("restitution").standard_error < 0.05
    assert polished.value("second.mass").standard_error < 0.1 * law.mass
    clean = tracks_of(exact, step, 0.0, seed=0)
    path = simulator(found.world, times).run().world(0)
    assert accuracy(found.world, clean, path).position < 0.004, "CEM alone follows the motion to twice the noise"
    path = simulator(polished.world, times).run().world(0)
    assert accuracy(polished.world, clean, path).position < 0.001
    assert polished.loss == pytest.approx(1.0, abs=0.25)


def test_loss_at_the_truth_is_the_noise_and_no_fit_is_far_below_it() -> None:
    law, step = Pucks(), 1.0 / 60.0
    tracks = tracks_of(slide_pucks(law, np.arange(90) * step), step, 0.002, seed=6)
    world = pucks_world(tracks)
    parameters = puck_unknowns(world, tracks)
    truth = {
        "first.position.x": 0.0,
        "first.position.y": 0.0,
        "second.position.x": 0.8,
        "second.position.y": 0.06,
        "first.velocity.x": 1.7,
        "first.velocity.y": 0.0,
        "second.velocity.x": -0.4,
        "second.velocity.y": 0.0,
        "friction": law.mu,
        "linear_damping": law.c,
        "restitution": law.e,
        "second.mass": law.mass,
    }
    assert set(truth) == {p.name for p in parameters}
    exact = with_parameters(world, {p: truth[q.name] for q in parameters for p in q.paths})
    objective = Objective(exact, tracks)
    loss = float(objective.losses(simulator(exact, objective.sample_times).run())[0])
    # 360 residuals: a mean of squares within 5 sqrt(2 / 360) of 1
    assert loss == pytest.approx(1.0, abs=0.37)
    polished = refine(FitProblem(world, tracks, parameters), truth)
    assert loss - 3.0 * 2.0 * len(truth) / 360.0 < polished.loss <= loss


def bounces(times: Array, height: float, e: float) -> Array:
    """Height (T,) of a ball's lowest point in closed form: fall from rest, then bounces of speed e^n sqrt(2 g h)."""
    fall = np.sqrt(2.0 * height / GRAVITY)
    z = np.where(times < fall, height - 0.5 * GRAVITY * times**2, 0.0)
    start, speed = fall, e * np.sqrt(2.0 * GRAVITY * height)
    while start < times[-1]:
        flight = times - start
        air = (flight >= 0.0) & (flight < 2.0 * speed / GRAVITY)
        z = np.where(air, speed * flight - 0.5 * GRAVITY * flight**2, z)
        start, speed = start + 2.0 * speed / GRAVITY, e * speed
    return z


def test_restitution_of_a_ball_that_bounces_in_space() -> None:
    times, e = np.arange(80) / 60.0, 0.75
    path = np.stack([0.5 * times, 0 * times, bounces(times, 1.0, e) + 0.1], axis=-1)
    noise = np.random.default_rng(0).normal(0.0, 0.003, (80, 1, 3))
    tracks = ObservedTracks(
        names=("ball",),
        frames=np.arange(80),
        seconds_per_frame=1.0 / 60.0,
        positions=path[:, None] + noise,
        position_sigma=np.full((80, 1), 0.003),
        orientations=np.full((80, 1, 4), np.nan),
        confidence=np.ones((80, 1)),
        orientation_confidence=np.zeros((80, 1)),
        symmetry=(0,),
    )
    ball = RigidObject(name="ball", shape=Sphere(radius=0.1), friction=0.0, position=(0, 0, 1.1))
    world = World(
        objects=(ball,),
        statics=(StaticObject(name="floor", shape=Plane()),),
        time=TimeBase(seconds_per_frame=1.0 / 60.0),
    )
    world = with_initial_states(world, tracks)
    parameters = default_unknowns(world, tracks, shared=(), each=("restitution",))
    found = fit(FitProblem(world, tracks, parameters), SearchSettings(generations=20))
    polished = refine(FitProblem(world, tracks, parameters), found.by_name)
    restitution = polished.value("ball.restitution")
    assert abs(restitution.value - e) < 3.5 * restitution.standard_error
    assert restitution.value == pytest.approx(e, abs=0.005)
    # 240 residuals: a mean of squares within 5 sqrt(2 / 240) of 1
    assert polished.loss == pytest.approx(1.0, abs=0.46)


def test_time_between_frames_is_found_from_a_bouncing_ball() -> None:
    step, height, e = 0.02, 1.0, 0.8
    times = np.arange(70) * step
    z = bounces(times, height, e)
    x = 0.4 * times
    noise = np.random.default_rng(2).normal(0.0, 0.003, (70, 1, 3)) * [1.0, 0.0, 1.0]
    tracks = ObservedTracks(
        names=("ball",),
        frames=np.arange(70),
        seconds_per_frame=0.03,  # wrong by half
        positions=np.stack([x, 0 * x, z + 0.05], axis=-1)[:, None] + noise,
        position_sigma=np.full((70, 1), 0.003),
        orientations=np.full((70, 1, 4), np.nan),
        confidence=np.ones((70, 1)),
        orientation_confidence=np.zeros((70, 1)),
        symmetry=(0,),
    )
    world = World(
        objects=(
            RigidObject(
                name="ball",
                representation="rigid_planar",
                shape=Sphere(radius=0.05),
                friction=0.0,
                position=(0, 0, height + 0.05),
            ),
        ),
        statics=(StaticObject(name="floor", shape=Plane()),),
        environment=Environment(motion_plane=MotionPlane(normal=(0, -1, 0), supports=False)),
        time=TimeBase(seconds_per_frame=0.03),
    )
    world = with_initial_states(world, tracks)
    parameters = default_unknowns(world, tracks, shared=(), each=("restitution",), time_base=True)
    # The time scale is unknown by half, and the initial velocity with it.
    parameters = [
        Unknown(p.name, p.paths, "", p.start, -1.5, 1.5, 0.3, enters=p.enters) if "velocity" in p.name else p
        for p in parameters
    ]
    found = fit(FitProblem(world, tracks, parameters), SearchSettings(generations=80))
    polished = refine(FitProblem(world, tracks, parameters), found.by_name)
    time_base, restitution = polished.value("seconds_per_frame"), polished.value("ball.restitution")
    assert abs(time_base.value - step) < 3.5 * time_base.standard_error
    assert time_base.value == pytest.approx(step, rel=0.01)
    assert abs(restitution.value - e) < 3.5 * restitution.standard_error
    assert restitution.value == pytest.approx(e, abs=0.02)


def test_friction_of_a_box_that_mujoco_slides() -> None:
    mu, step = 0.3, 1.0 / 60.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0005" cone="elliptic" impratio="10" gravity="0 0 -{GRAVITY}"/>
        <worldbody><geom type="plane" size="9 9 1" friction="{mu} 0 0"/>
        <body pos="0 0 0.05"><freejoint/><geom type="box" size="0.1 0.1 0.05" mass="1" friction="{mu} 0 0"/></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qvel[0] = 2.0
    positions = []
    for _ in range(50):
        positions.append(data.qpos[:3].copy())
        while data.time < len(positions) * step - 1e-9:
            mujoco.mj_step(model, data)
    poses = np.array(positions)[:, None, :]
    tracks = tracks_of(poses, step, 0.002, seed=3)
    box = RigidObject(
        name="first", representation="rigid_planar", shape=Box(half_extents=(0.1, 0.1, 0.05)), position=(0, 0, 0.05)
    )
    world = with_initial_states(World(objects=(box,), time=TimeBase(seconds_per_frame=step)), tracks)
    parameters = default_unknowns(world, tracks, shared=(), each=("friction",))
    result = refine(FitProblem(world, tracks, parameters))
    found = result.value("first.friction")
    assert abs(found.value - mu) < 4.0 * found.standard_error + 0.002 * mu
    assert found.standard_error < 0.01


def test_objects_that_never_meet_get_no_contact_parameters_and_a_reason() -> None:
    step = 1.0 / 60.0
    poses = np.zeros((40, 2, 2))
    times = np.arange(40) * step
    poses[:, 0, 0] = 0.5 * times
    poses[:, 1] = (0.0, 3.0)
    tracks = tracks_of(poses, step, 0.002, seed=1)
    world = pucks_world(tracks)
    parameters = default_unknowns(world, tracks)
    assert {p.name for p in parameters} >= {"first.position.x", "first.velocity.y", "first.friction"}
    assert not [p for p in parameters if "second" in p.name or "restitution" in p.name or "mass" in p.name]
    result = refine(FitProblem(world, tracks, parameters))
    reasons = {u.parameters[0]: u.reason for u in result.undetermined}
    assert "second never moves" in reasons["objects.second.friction"]
    assert "no contact involving first" in reasons["objects.first.restitution"]
    assert "meets no other body" in reasons["objects.second.mass"]


@pytest.mark.parametrize("sigma", [1e-4, 0.005, 0.02])
def test_the_true_initial_state_lies_within_the_bounds_of_the_search(sigma: float) -> None:
    law, step = Pucks(), 1.0 / 60.0
    exact = slide_pucks(law, np.arange(90) * step)
    errors = []
    for seed in range(12):
        state = initial_states(tracks_of(exact, step, sigma, seed))["first"]
        errors.append(
            [
                np.hypot(*state.position[:2]) / state.position_sd,
                np.hypot(state.velocity[0] - 1.7, state.velocity[1]) / state.velocity_sd,
            ]
        )
        assert state.moves
    # A fit searches REACH standard deviations around; the truth must lie well inside, whatever the noise.
    assert np.max(errors) < 0.9 * REACH, np.max(errors, axis=0)


def test_an_object_at_rest_is_taken_to_be_at_rest() -> None:
    poses = np.zeros((60, 1, 2))
    state = initial_states(tracks_of(poses, 1.0 / 60.0, 0.01, seed=4))["first"]
    assert not state.moves
    assert np.all(state.velocity == 0.0)
    assert np.hypot(*state.position[:2]) < 4.0 * state.position_sd
    assert state.position_sd == pytest.approx(0.01 / np.sqrt(60.0), rel=0.3)


def test_free_motion_ends_where_the_collision_is() -> None:
    law, step = Pucks(), 1.0 / 60.0
    exact = slide_pucks(law, np.arange(90) * step)
    gap = np.hypot(*(exact[:, 1, :2] - exact[:, 0, :2]).T)
    met = int(np.argmax(gap < 2.0 * RADIUS + 0.02))
    state = initial_states(tracks_of(exact, step, 0.001, seed=4))["first"]
    assert met - 8 <= state.free_until <= met + 2


def test_a_late_object_joins_when_it_is_first_seen() -> None:
    poses = np.zeros((40, 1, 2))
    poses[:, 0, 0] = np.arange(40) * 0.01
    tracks = tracks_of(poses, 0.02, 0.001, seed=2)
    confidence = tracks.confidence.copy()
    confidence[:10] = 0.0
    tracks = ObservedTracks(**{**vars(tracks), "confidence": confidence})
    world = World(
        objects=(
            RigidObject(name="first", representation="rigid_planar", shape=Sphere(radius=0.1), position=(9, 9, 0)),
        ),
        time=TimeBase(seconds_per_frame=0.02),
    )
    placed = with_initial_states(world, tracks).object("first")
    assert placed.start_time == pytest.approx(0.2)
    assert placed.position[0] == pytest.approx(0.1, abs=0.002)
    assert placed.velocity[0] == pytest.approx(0.5, abs=0.02)
    # In the plane: the height stays the world's.
    assert placed.position[2] == 0.0
