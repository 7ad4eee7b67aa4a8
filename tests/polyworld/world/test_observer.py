"""The observer's faults against analytic motion, OpenCV's lens model and SciPy's rotations."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from polyworld.solver.rollout import rollout, simulator
from polyworld.world import TimeBase, World
from polyworld.world.observer import Observer, clock_ratio, observe, physical_times
from polyworld.world.parameters import check_differs_per_world, parameter_paths, read_parameter, with_parameters
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.resampling import resample
from polyworld.world.shapes import Sphere

G = np.array([0.0, 0.0, -9.81])


def ball_world(**more: object) -> World:
    ball = RigidObject(name="ball", shape=Sphere(radius=0.1), position=(0.0, 0.0, 5.0), velocity=(3.0, 0.0, 2.0))
    return World(objects=(ball,), time=TimeBase(seconds_per_frame=0.01, substep=0.002), **more)


def flight(times: np.ndarray) -> tuple[np.ndarray, ...]:
    """A thrown, spinning body (1, T, 1, ...): positions, orientations, velocities, angular velocities."""
    t = times[:, None]
    spin = np.array([0.0, 0.0, 7.0])
    x = np.array([0.0, 0.0, 5.0]) + np.array([3.0, 0.5, 2.0]) * t + 0.5 * G * t**2
    v = np.array([3.0, 0.5, 2.0]) + G * t
    q = Rotation.from_rotvec(spin * t).as_quat(scalar_first=True)
    w = np.broadcast_to(spin, x.shape)
    return tuple(a[None, :, None] for a in (x, q, v, w))


def test_parameters_of_the_observer_are_there_only_with_an_observer() -> None:
    assert not any(p.startswith("observer.") for p in parameter_paths(ball_world()))
    with pytest.raises(KeyError, match=r"observer\.scale"):
        read_parameter(ball_world(), "observer.scale")
    world = ball_world(observer=Observer())
    paths = [p for p in parameter_paths(world) if p.startswith("observer.")]
    assert sorted(paths) == sorted(Observer().values)
    for k, path in enumerate(paths):
        changed = with_parameters(world, {path: 0.5 + 0.01 * k})
        assert read_parameter(changed, path) == pytest.approx(0.5 + 0.01 * k)
        assert {p: read_parameter(changed, p) for p in paths if p != path} == {
            p: read_parameter(world, p) for p in paths if p != path
        }
    with pytest.raises(ValueError, match="moves nothing"):
        check_differs_per_world(world, "observer.scale")


def test_an_observer_never_changes_a_rollout() -> None:
    plain = rollout(ball_world(), 0.3).trajectory
    faulty = rollout(
        ball_world(observer=Observer(scale=2.0, clock=1.3, tilt=(1.0, 0.0, 0.0), shift=0.1)), 0.3
    ).trajectory
    assert plain.positions.tobytes() == faulty.positions.tobytes()
    assert plain.times.tobytes() == faulty.times.tobytes()


def test_a_faultless_observer_reports_the_samples_themselves() -> None:
    times = np.arange(20) * 0.01
    x, q, v, w = flight(times)
    seen, turned = observe(x, q, v, w, times[None], times, {})
    assert seen.tobytes() == x.tobytes()
    assert turned.tobytes() == q.tobytes()


def test_a_fast_clock_shows_the_motion_slowed_down() -> None:
    stamps = np.arange(60) * 0.01
    world = ball_world(observer=Observer())
    clocks = np.array([1.0, 1.1, 0.9])
    parameters = {"observer.clock": clocks}
    ratio = clock_ratio(world.observer, parameters)
    batch = simulator(world, stamps, n_worlds=3).run({"time.seconds_per_frame": 0.01 * ratio})
    seen, _ = observe(
        batch.positions,
        batch.orientations,
        batch.velocities,
        batch.angular_velocities,
        batch.times,
        stamps,
        parameters,
        world.observer,
    )
    assert seen.shape == (3, 60, 1, 3)
    for k, clock in enumerate(clocks):
        # A clock that counts 1.1 s per second shows gravity as g / 1.1^2.
        apparent = np.polyfit(stamps, seen[k, :, 0, 2], 2)[0] * 2.0
        assert apparent == pytest.approx(-9.81 / clock**2, rel=1e-3)
        t = stamps / clock
        assert np.allclose(seen[k, :, 0], np.stack([3 * t, 0 * t, 5 + 2 * t - 4.905 * t**2], -1), atol=2e-3)


def test_tilted_axes_see_gravity_and_orientation_turned_the_other_way() -> None:
    times = np.arange(50) * 0.02
    x, q, v, w = flight(times)
    tilt = np.array([[0.05, -0.1, 0.2]])
    parameters = {f"observer.tilt.{a}": tilt[:, k] for k, a in enumerate("xyz")}
    seen, turned = observe(x, q, v, w, times[None], times, parameters)
    apparent = 2.0 * np.polyfit(times, seen[0, :, 0], 2)[0]
    axes = Rotation.from_rotvec(tilt[0]).as_matrix()  # columns: the observed axes
    assert np.allclose(apparent, axes.T @ G)
    expected = Rotation.from_rotvec(tilt[0]).inv() * Rotation.from_quat(q[0, :, 0], scalar_first=True)
    error = (Rotation.from_quat(turned[0, :, 0], scalar_first=True) * expected.inv()).magnitude()
    assert error.max() < 1e-7


def test_distortion_is_that_of_a_lens_that_looks_along_the_view() -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(-1.0, 1.0, (1, 30, 1, 3))
    places[..., 1] = 4.0  # all in one plane across the sight, 4 m away
    times = np.arange(30) * 0.1
    still = np.zeros_like(places)
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, 30, 1, 4))
    seen, _ = observe(
        places,
        q,
        still,
        still,
        times[None],
        times,
        {"observer.distortion": np.array([-0.07])},
        Observer(view=(0.0, 2.0, 0.0)),
    )
    # OpenCV's camera: x right, z towards the scene; k1 acts on angles, that is on metres per 4 m.
    towards = places[0, :, 0][:, [0, 2, 1]]
    pixels, _ = cv2.projectPoints(towards, np.zeros(3), np.zeros(3), np.eye(3), np.array([-0.07 * 16.0, 0, 0, 0]))
    assert np.allclose(seen[0, :, 0][:, [0, 2]], 4.0 * pixels[:, 0], atol=1e-12)
    assert np.allclose(seen[..., 1], 4.0)


def test_keystone_is_what_a_camera_sees_of_a_plane_that_it_looks_at_from_the_side() -> None:
    rng = np.random.default_rng(4)
    flat = rng.uniform(-1.0, 1.0, (30, 2))
    centre = np.array([0.3, 1.0, -0.2])
    places = centre + np.stack([flat[:, 0], np.zeros(30), flat[:, 1]], axis=1)
    distance, angle = 4.0, 0.4  # the plane is turned about x: with z it goes away from the camera
    pixels, _ = cv2.projectPoints(
        np.stack([flat[:, 0], flat[:, 1], np.zeros(30)], axis=1),
        np.array([angle, 0.0, 0.0]),
        np.array([0.0, 0.0, distance]),
        np.eye(3),
        np.zeros(4),
    )
    times = np.arange(30) * 0.1
    still = np.zeros((1, 30, 1, 3))
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, 30, 1, 4))
    slant = {"observer.keystone.z": np.array([np.sin(angle) / distance])}
    observer = Observer(centre=tuple(centre))
    seen, turned = observe(places[None, :, None], q, still, still, times[None], times, slant, observer)
    # Lengths along z are foreshortened by cos(angle) as well: that is a scale, and no part of the keystone.
    expected = distance * pixels[:, 0] / [1.0, np.cos(angle)]
    assert np.allclose((seen[0, :, 0] - centre)[:, [0, 2]], expected, atol=1e-12)
    assert np.allclose(seen[..., 1], centre[1])
    assert np.array_equal(turned, q)


def test_dropped_frames_make_later_stamps_too_early() -> None:
    true = np.arange(40) * 0.02
    kept = np.delete(true, [17, 18, 19])  # three frames are lost between frames 16 and 20
    stamps = np.arange(len(kept)) * 0.02  # and the recorder numbers on
    parameters = {"observer.shift": np.array([0.06]), "observer.shift_time": np.array([16.5 * 0.02])}
    assert np.allclose(physical_times(stamps, parameters)[0], kept)


def test_a_whole_number_of_dropped_frames_needs_no_interpolation() -> None:
    stamps = np.arange(30) * 0.02
    parameters = {"observer.shift": np.array([0.04, -0.02, 0.0]), "observer.shift_time": np.full(3, 10.5 * 0.02)}
    instants = np.arange(40) * 0.02
    rng = np.random.default_rng(0)
    x, v = rng.normal(size=(2, 3, len(instants), 1, 3))  # no smooth curve at all: only samples can be right
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (3, len(instants), 1, 4))
    seen, _ = observe(x, q, v, 0 * v, np.broadcast_to(instants, (3, len(instants))), stamps, parameters)
    for k, frames in enumerate((2, -1, 0)):
        assert np.array_equal(seen[k, :11], x[k, :11])
        assert np.array_equal(seen[k, 11:30], x[k, 11 + frames : 30 + frames])


def test_a_time_offset_shows_later_motion_and_before_the_start_goes_on_straight() -> None:
    stamps = np.arange(30) * 0.02
    parameters = {"observer.time_offset": np.array([0.013, -0.02])}
    instants = np.arange(40) * 0.02
    x, q, v, w = (np.repeat(a, 2, axis=0) for a in flight(instants))
    seen, turned = observe(x, q, v, w, np.repeat(instants[None], 2, axis=0), stamps, parameters)
    later = flight(stamps + 0.013)
    assert np.allclose(seen[0], later[0][0], atol=1e-12)
    assert np.allclose(turned[0], later[1][0], atol=1e-12)
    assert np.allclose(seen[1, 0], x[1, 0] - 0.02 * v[1, 0])


def test_unknown_parameters_are_refused_with_the_choices() -> None:
    with pytest.raises(ValueError, match=r"observer\.blur.*observer\.clock"):
        physical_times(np.arange(3.0), {"observer.blur": np.ones(1)})


def test_ballistic_flight_is_interpolated_exactly() -> None:
    times, wanted = np.arange(12) * 0.1, np.linspace(0.0, 1.1, 77)
    place, turned = resample(*flight(times), times[None], wanted[None])
    true = flight(wanted)
    assert np.allclose(place, true[0], atol=1e-12)
    assert np.allclose(turned, true[1], atol=1e-9)


def test_smooth_motion_is_interpolated_within_the_bound_of_the_cubic() -> None:
    h, rate = 0.05, 6.0
    times, wanted = np.arange(60) * h, np.linspace(0.0, 2.9, 500)
    x = np.zeros((1, 60, 1, 3))
    v = x.copy()
    x[0, :, 0, 0], v[0, :, 0, 0] = np.sin(rate * times), rate * np.cos(rate * times)
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, 60, 1, 4))
    place, _ = resample(x, q, v, 0 * v, times[None], wanted[None])
    assert np.abs(place[0, :, 0, 0] - np.sin(rate * wanted)).max() < 1.01 * h**4 * rate**4 / 384.0


@pytest.mark.parametrize("h", [1 / 120, 1 / 30])
def test_an_impact_between_samples_is_found_to_the_instant(h: float) -> None:
    def bounce(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A ball let fall from 1 m, restitution 0.8; losing 30% of its sideways speed at every bounce."""
        z, vz, x, vx, since = 1.0, 0.0, 0.0, 2.0, 0.0
        place, speed = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        at = 0.0
        while since <= t[-1]:
            fall = (vz + np.sqrt(vz**2 + 2 * 9.81 * z)) / 9.81
            here = (t >= since) & (t < since + fall)
            d = t[here] - since
            place[here] = np.stack([x + vx * d, 0 * d, z + vz * d - 4.905 * d**2], -1)
            speed[here] = np.stack([vx + 0 * d, 0 * d, vz - 9.81 * d], -1)
            x, z, vz, vx, since = x + vx * fall, 0.0, 0.8 * (9.81 * fall - vz), 0.7 * vx, since + fall
            at += 1
        return place, speed

    times = np.arange(0.0, 1.6, h)
    wanted = np.linspace(0.0, times[-1], 3001)
    x, v = bounce(times)
    true, _ = bounce(wanted)
    q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, len(times), 1, 4))
    place, _ = resample(x[None, :, None], q, v[None, :, None], 0 * x[None, :, None], times[None], wanted[None])
    assert np.abs(place[0, :, 0] - true).max() < 1e-10


def test_a_tumbling_body_keeps_its_orientation_between_samples() -> None:
    inertia = np.array([1.0, 2.0, 3.0])

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        """Free rotation: Euler's equations in body axes, and the quaternion."""
        q, w = y[:4], y[4:]
        spin = np.cross(inertia * w, w) / inertia
        dq = 0.5 * np.array(
            [
                -q[1:] @ w,
                *(q[0] * w + np.cross(q[1:], w)),
            ]
        )
        return np.concatenate([dq, spin])

    times, wanted = np.arange(40) * 0.02, np.linspace(0.0, 0.78, 333)
    start = np.array([1.0, 0.0, 0.0, 0.0, 4.0, 6.0, -3.0])
    motion = solve_ivp(rate, (0.0, 0.8), start, rtol=1e-11, atol=1e-12, dense_output=True).sol
    state, true = motion(times).T, motion(wanted).T
    spin = Rotation.from_quat(state[:, :4], scalar_first=True).apply(state[:, 4:])
    zero = np.zeros((1, 40, 1, 3))
    _, turned = resample(zero, state[None, :, None, :4], zero, spin[None, :, None], times[None], wanted[None])
    q = true[:, :4] / np.linalg.norm(true[:, :4], axis=1, keepdims=True)
    error = (
        Rotation.from_quat(turned[0, :, 0], scalar_first=True) * Rotation.from_quat(q, scalar_first=True).inv()
    ).magnitude()
    assert error.max() < 5e-6  # of a turn of 0.16 rad between samples


@pytest.mark.parametrize("spin", [np.nan, 1e200])
def test_the_orientation_of_a_motion_that_is_no_number_is_none(spin: float) -> None:
    """One of two bodies has diverged; the other is seen as it is."""
    times, wanted = np.arange(6) * 0.1, np.linspace(0.0, 0.5, 11)
    spins = np.zeros((1, 6, 2, 3))
    spins[:, :, 0, 0] = spin * np.arange(1, 7)
    still = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, 6, 2, 4))
    zero = np.zeros((1, 6, 2, 3))
    _, turned = resample(zero, still, zero, spins, times[None], wanted[None])
    assert np.isnan(turned[0, 1::2, 0]).all()
    np.testing.assert_array_equal(turned[0, :, 1], still[0, :1, 1].repeat(11, axis=0))
