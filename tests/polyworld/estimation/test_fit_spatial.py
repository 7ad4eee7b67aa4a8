"""Fits in space against closed formulas, SciPy and MuJoCo: floors, ramps, rolling, bounces, air, joints."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.stats import norm

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fitted import FittedConstant, StudyFit
from polyworld.world import StaticObject, World, geometry
from polyworld.world.representations.joint import Hinge, Slider
from polyworld.world.shapes import Box
from tests.polyworld.estimation.floor_scenes import (
    FRAME,
    GRAVITY,
    RADIUS,
    ball,
    box,
    frames,
    rolling_deceleration,
    scene,
    slowed,
    thrown,
    tracks_of,
    upright,
)
from tests.polyworld.synthetic import of_one

Array = NDArray[np.float64]
WHOLE = FitOptions(share=0.0)
TILT = 0.3  # [rad]


def fitted(world: World, tracks: ObservedTracks) -> StudyFit:
    return fit(of_one(world, tracks), WHOLE)


def deviations(found: FittedConstant, truth: float) -> float:
    low, high = found.interval
    return float(abs(found.value - truth) / ((high - low) / (2.0 * norm.ppf(0.9))))


def test_friction_of_a_box_that_mujoco_slides() -> None:
    mu = 0.3
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0005" cone="elliptic" impratio="10" gravity="0 0 -{GRAVITY}"/>
        <worldbody><geom type="plane" size="9 9 1" friction="{mu} 0 0"/><body pos="0 0 {RADIUS}"><freejoint/>
        <geom type="box" size="{RADIUS} {RADIUS} {RADIUS}" mass="1" friction="{mu} 0 0"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    places = []
    for k in range(20):
        while data.time < k * FRAME - 1e-9:
            mujoco.mj_step(model, data)
        places.append(data.qpos[:3].copy())
    tracks = tracks_of({"box": np.array(places)}, orientations={"box": upright(20)})
    found = fitted(scene([box()], tracks), tracks).constant("friction of box")
    assert deviations(found, mu) < 3.5
    assert found.value == pytest.approx(mu, rel=0.05)


@pytest.mark.parametrize("lever", [0.002, 0.01])
def test_a_ball_that_rolls_has_rolling_resistance_and_says_nothing_of_friction(lever: float) -> None:
    tracks = tracks_of({"ball": slowed(frames(30), 0.8, rolling_deceleration(lever))}, sigma=0.001)
    found = fitted(scene([ball(friction=0.5)], tracks), tracks)
    assert found.rolling == "rolls"
    assert found.constant("rolling resistance of ball").value == pytest.approx(lever, abs=0.1 * lever + 6e-4)
    assert found.constant("friction of ball").informed < 0.5
    low, high = found.constant("restitution of ball").interval  # nothing bounces: the prior of balls, not of all
    assert (low, high) == pytest.approx((0.7 - 1.28 * 0.2, 0.7 + 1.28 * 0.2), abs=0.08)


def test_a_ball_launched_without_spin_slides_until_it_rolls() -> None:
    """It is braked by mu g until its speed is 5/7 of the first, and then rolls on evenly."""
    mu, speed = 0.12, 2.0
    t = frames(26)
    stop = 2.0 / 7.0 * speed / (mu * GRAVITY)
    braked = np.minimum(t, stop)
    way = speed * braked - 0.5 * mu * GRAVITY * braked**2 + 5.0 / 7.0 * speed * np.maximum(t - stop, 0.0)
    tracks = tracks_of({"ball": np.stack([way, 0.0 * t, np.full_like(t, RADIUS)], axis=1)})
    found = fitted(scene([ball()], tracks), tracks)
    assert found.rolling == "slides"
    low, high = found.constant("friction of ball").interval
    assert 0.98 * low <= mu <= 1.02 * high  # a quadratic damping takes part of it at the minimum
    assert high - low < 0.25 * mu


def ramp() -> StaticObject:
    normal = np.array([np.sin(TILT), 0.0, np.cos(TILT)])
    turn = geometry.rotation_quaternion(np.array([0.0, TILT, 0.0]))
    shape = Box(half_extents=(4.0, 1.0, 0.1))
    return StaticObject(name="ramp", shape=shape, position=tuple(-0.1 * normal), orientation=tuple(turn.tolist()),
                        friction=None, restitution=None)  # fmt: skip


def down_the_ramp(way: Array) -> Array:
    down, normal = np.array([np.cos(TILT), 0.0, -np.sin(TILT)]), np.array([np.sin(TILT), 0.0, np.cos(TILT)])
    return RADIUS * normal + way[:, None] * down


def test_a_box_slides_down_a_ramp_at_g_sin_less_mu_g_cos() -> None:
    mu, t = 0.2, frames(18)
    way = 0.3 * t + 0.5 * GRAVITY * (np.sin(TILT) - mu * np.cos(TILT)) * t**2
    turn = geometry.rotation_quaternion(np.array([0.0, TILT, 0.0]))
    tracks = tracks_of({"box": down_the_ramp(way)}, orientations={"box": np.tile(turn, (len(t), 1))})
    found = fitted(scene([box()], tracks, statics=(ramp(),)), tracks)
    assert found.constant("friction of box").value == pytest.approx(mu, abs=0.02)


def test_a_ball_rolls_down_a_ramp_at_five_sevenths_of_g_sin() -> None:
    t = frames(18)
    way = 0.2 * t + 5.0 / 14.0 * GRAVITY * np.sin(TILT) * t**2
    tracks = tracks_of({"ball": down_the_ramp(way)})
    found = fit(of_one(scene([ball()], tracks, statics=(ramp(),)), tracks), FitOptions(holdout=12))
    prediction = found.runs[0].prediction
    assert found.rolling == "rolls"
    assert prediction is not None
    assert prediction.bodies[0].error < 0.02 < prediction.bodies[0].stays


def bounces(times: Array, height: float, restitution: float) -> Array:
    """Height (T,) of a ball's lowest point: a fall from rest, then bounces of speed e^n sqrt(2 g h)."""
    fall = np.sqrt(2.0 * height / GRAVITY)
    z = np.where(times < fall, height - 0.5 * GRAVITY * times**2, 0.0)
    start, speed = fall, restitution * np.sqrt(2.0 * GRAVITY * height)
    while start < times[-1]:
        flight = times - start
        air = (flight >= 0.0) & (flight < 2.0 * speed / GRAVITY)
        z = np.where(air, speed * flight - 0.5 * GRAVITY * flight**2, z)
        start, speed = start + 2.0 * speed / GRAVITY, restitution * speed
    return z


def test_restitution_of_a_ball_that_bounces() -> None:
    times, restitution = frames(40), 0.75
    path = np.stack([0.5 * times, 0.0 * times, bounces(times, 1.0, restitution) + RADIUS], axis=1)
    tracks = tracks_of({"ball": path}, sigma=0.003)
    start = ball(friction=0.0, position=(0.0, 0.0, 1.0 + RADIUS))
    edit = FitOptions(share=0.0, edit=lambda found: [u for u in found if u.name == "restitution of ball"])
    found = fit(of_one(scene([start], tracks), tracks), edit).constant("restitution of ball")
    assert found.value == pytest.approx(restitution, abs=0.01)
    assert found.informed > 0.95


def test_the_time_between_frames_is_found_where_gravity_gives_the_scale() -> None:
    tracks = tracks_of({"ball": thrown(frames(25), (2.0, 0.0, 4.0), 0.0, 0.0)})
    slow = replace(tracks, seconds_per_frame=0.06)
    world = scene([ball()], slow, statics=())
    found = fit(of_one(world, slow), FitOptions(share=0.0, time_base=True))
    assert found.constant("seconds_per_frame").value == pytest.approx(FRAME, rel=0.02)
    assert found.runs[0].world.time.seconds_per_frame == found.constant("seconds_per_frame").value


@pytest.mark.parametrize(("viscous", "quadratic"), [(0.8, 0.0), (0.0, 0.3), (0.0, 0.0)])
def test_air_resists_a_throw_as_its_speed_or_the_square(viscous: float, quadratic: float) -> None:
    tracks = tracks_of({"ball": thrown(frames(30), (6.0, 1.0, 5.0), viscous, quadratic)})
    found = fitted(scene([ball()], tracks, statics=()), tracks)
    at_speed = found.constant("linear_damping").value + 8.0 * found.constant("quadratic_damping").value
    assert at_speed == pytest.approx(viscous + 8.0 * quadratic, abs=0.12)
    last = found.runs[0].accuracy
    assert last is not None
    assert last.position == pytest.approx(0.002 * np.sqrt(3.0), rel=0.25)


def test_a_body_that_turns_more_than_once_is_followed() -> None:
    """At 9 rad/s it turns by 1.4 turns within the clip, with a reading every 0.36 rad."""
    t = frames(25)
    turns = geometry.rotation_quaternion(t[:, None] * [0.0, 0.0, 9.0])
    tracks = tracks_of({"box": thrown(t, (2.0, 0.0, 4.0), 0.0, 0.0)}, orientations={"box": turns})
    found = fitted(scene([box()], tracks, statics=()), tracks).runs[0].world.object("box")
    assert found.angular_velocity == pytest.approx((0.0, 0.0, 9.0), abs=0.3)


def test_a_pendulum_has_the_damping_of_its_hinge() -> None:
    """I phi'' = -m g l sin(phi) - d phi' with I = m l^2 + 2/5 m R^2."""
    arm, damping, times = 0.6, 0.15, frames(50)
    inertia = arm**2 + 0.4 * RADIUS**2

    def rates(_: float, state: Array) -> list[float]:
        return [state[1], (-GRAVITY * arm * np.sin(state[0]) - damping * state[1]) / inertia]

    angle = solve_ivp(rates, (0.0, times[-1]), [0.6, 0.0], t_eval=times, rtol=1e-9).y[0]
    tracks = tracks_of({"ball": np.stack([arm * np.sin(angle), 0.0 * angle, 1.0 - arm * np.cos(angle)], axis=1)})
    pivot = Hinge(name="pivot", object="ball", anchor=(0.0, 0.0, 1.0), axis=(0.0, 1.0, 0.0))
    world = scene([ball(mass=1.0)], tracks, statics=(), joints=(pivot,))
    dry = fit(of_one(world, tracks), FitOptions(share=0.0, edit=lambda us: [u for u in us if "damping" in u.name]))
    assert dry.constant("joints.pivot.damping").value == pytest.approx(damping, rel=0.07)
    accuracy = dry.runs[0].accuracy
    assert accuracy is not None
    assert accuracy.position == pytest.approx(0.002 * np.sqrt(3.0), rel=0.25)


def test_a_pendulum_seen_for_a_quarter_of_its_period_is_predicted() -> None:
    """What resists at the pivot does not show in so short a time, and must not bend the state that is carried on."""
    arm, times = 0.75, frames(40)

    def rates(_: float, state: Array) -> list[float]:
        return [state[1], -GRAVITY * arm * np.sin(state[0]) / (arm**2 + 0.4 * RADIUS**2)]

    angle = solve_ivp(rates, (0.0, times[-1]), [-0.6, 0.3], t_eval=times, rtol=1e-9).y[0]
    path = {"ball": np.stack([arm * np.sin(angle), 0.0 * angle, 1.0 - arm * np.cos(angle)], axis=1)}
    tracks = tracks_of(path, sigma=0.001)
    pivot = Hinge(name="pivot", object="ball", anchor=(0.0, 0.0, 1.0), axis=(0.0, 1.0, 0.0))
    world = scene([ball(mass=4.0)], tracks, statics=(), joints=(pivot,))
    found = fit(of_one(world, tracks), FitOptions(holdout=12))
    later = found.runs[0].held_out
    assert later is not None
    assert later.position < 0.01  # of 0.45 m that it travels there
    for name in ("friction", "damping"):
        assert found.constant(f"joints.pivot.{name}").interval[0] == 0.0


@pytest.mark.parametrize(("viscous", "dry"), [(0.7, 0.0), (0.0, 0.6)])
def test_a_cart_is_slowed_by_a_viscous_or_a_dry_track(viscous: float, dry: float) -> None:
    times = frames(30)

    def rates(_: float, state: Array) -> list[float]:
        return [state[1], -viscous * state[1] - dry if state[1] > 0.0 else 0.0]

    x = solve_ivp(rates, (0.0, times[-1]), [0.0, 1.5], t_eval=times, rtol=1e-8, max_step=0.01).y[0]
    places = np.stack([x, 0.0 * x, np.full_like(x, RADIUS)], axis=1)
    tracks = tracks_of({"box": places}, orientations={"box": upright(30)}, sigma=0.001)
    track = Slider(name="track", object="box", anchor=(0.0, 0.0, RADIUS), axis=(1.0, 0.0, 0.0))
    found = fitted(scene([box(mass=1.0)], tracks, statics=(), joints=(track,)), tracks)
    assert found.constant("joints.track.damping").value == pytest.approx(viscous, abs=0.15)
    assert found.constant("joints.track.friction").value == pytest.approx(dry, abs=0.1)
