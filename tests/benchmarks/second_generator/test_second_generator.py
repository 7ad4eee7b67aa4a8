"""Checks of the integrators, contact rules, observer effects and records against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.second_generator.base import base_discs, base_sphere, disc_hit
from tests.benchmarks.second_generator.discs import simulate_discs
from tests.benchmarks.second_generator.law import Law, bounce
from tests.benchmarks.second_generator.observe import Noise, Track, add_noise, seen, spoil
from tests.benchmarks.second_generator.scene import UP, Body, Effect, Launch, Plane, Scene, Start, cross, qmul, rotvec_q
from tests.benchmarks.second_generator.sphere import simulate
from tests.benchmarks.second_generator.strength import residuals, rms

R, M = 0.05, 0.3


def ball(
    rig: str = "flight", e: float = 0.8, mu: float = 0.2, orient: bool = False, walls: list[Plane] | None = None
) -> Scene:
    planes = [Plane("floor", np.zeros(3), UP, e, mu)] if rig != "flight" else []
    body = Body("ball", "sphere", R, M, e, mu)
    return Scene([body], planes + (walls or []), rig != "flight", rig, orient, False, "without spin")


def throw(x: list[float], v: list[float], w: list[float] | None = None, t: float = 1.0, t0: float = 0.0) -> Launch:
    return Launch(t0, t, [Start(np.array(x), np.array(v), np.array(w or [0.0, 0.0, 0.0]))])


def run(scene: Scene, effects: list[Effect], launch: Launch, n: int = 50) -> tuple[np.ndarray, np.ndarray]:
    path = simulate(Law(scene, effects), launch)
    ts = np.linspace(launch.t0, path.t_end - 1e-9, n)
    return ts, path.sample(ts)[0][0]


def test_free_flight() -> None:
    ts, x = run(ball(), [], throw([0, 0, 50], [3, -1, 4]))
    want = np.array([0, 0, 50]) + np.outer(ts, [3, -1, 4]) - 0.5 * 9.81 * np.outer(ts**2, UP)
    assert np.abs(x - want).max() < 1e-9


def test_linear_drag() -> None:
    c = 0.4
    ts, x = run(ball(), [Effect("linear_drag", {"c": c})], throw([0, 0, 50], [3, 0, 4]))
    tau = M / c
    f = tau * (1 - np.exp(-ts / tau))
    assert np.abs(x[:, 0] - 3 * f).max() < 1e-9
    assert np.abs(x[:, 2] - (50 + (4 + 9.81 * tau) * f - 9.81 * tau * ts)).max() < 1e-9


def test_quadratic_drag_terminal() -> None:
    k = 0.05
    vt = np.sqrt(M * 9.81 / k)
    ts, x = run(ball(), [Effect("quadratic_drag", {"k": k})], throw([0, 0, 500], [0, 0, 0], t=5))
    assert np.abs(x[:, 2] - (500 - vt**2 / 9.81 * np.log(np.cosh(9.81 * ts / vt)))).max() < 1e-8


@pytest.mark.parametrize(("name", "p"), [("wind", {"k": 0.03, "u": [2.0, 1.0, 0.0]})])
def test_wind_is_drag_in_the_moving_frame(name: str, p: dict) -> None:
    u = np.array(p["u"])
    ts, x = run(ball(), [Effect(name, p)], throw([0, 0, 50], [3, 0, 4]))
    _, y = run(ball(), [Effect("quadratic_drag", {"k": p["k"]})], throw([0, 0, 50], [3 - u[0], -u[1], 4]))
    assert np.abs(x - (y + np.outer(ts, u))).max() < 1e-8


def test_uniform_fields() -> None:
    ts, x = run(ball(), [Effect("buoyancy", {"r": 0.1, "C": 0.5})], throw([0, 0, 50], [0, 0, 0]))
    assert np.abs(x[:, 2] - (50 - 0.5 * 9.81 * 0.9 / 1.05 * ts**2)).max() < 1e-9
    both = [Effect("tilt", {"a": [0.3, -0.2]}), Effect("gravity_error", {"g": 9.0})]
    ts, x = run(ball(), both, throw([0, 0, 50], [0, 0, 0]))
    assert np.abs(x - ([0, 0, 50] + 0.5 * np.outer(ts**2, [0.3, -0.2, -9.0]))).max() < 1e-9


def test_periodic_and_spring() -> None:
    a, f, phi, t0 = 2.0, 1.5, 0.4, 0.7
    w = 2 * np.pi * f
    e = Effect("periodic_forcing", {"A": a, "f": f, "phi": phi, "direction": [1.0, 0, 0]})
    ts, x = run(ball(), [e], throw([0, 0, 50], [0, 0, 0], t0=t0))
    want = -a / w**2 * (np.sin(w * ts + phi) - np.sin(w * t0 + phi)) + a / w * np.cos(w * t0 + phi) * (ts - t0)
    assert np.abs(x[:, 0] - want).max() < 1e-9
    k, om = 3.0, np.sqrt(10.0)
    ts, x = run(ball(), [Effect("spring", {"k": k, "anchor": [1.0, 0, 50]})], throw([0, 0, 50], [0, 0.5, 0]))
    assert np.abs(x[:, 0] - (1 - np.cos(om * ts))).max() < 1e-9
    assert np.abs(x[:, 1] - 0.5 / om * np.sin(om * ts)).max() < 1e-9


def test_places_conserve_energy() -> None:
    k, ln, a = 5.0, 0.5, np.array([0.0, 0, 50])
    law = Law(ball(), [Effect("tether", {"k": k, "L": ln, "anchor": a.tolist()})])
    path = simulate(law, throw([0.2, 0, 50], [2, 0, 1]))
    ts = np.linspace(0, 1, 2001)[1:-1]
    x = path.sample(ts)[0][0]
    v = np.gradient(x, ts, axis=0)
    r = np.linalg.norm(x - a, axis=1)
    total = 0.5 * M * np.sum(v * v, 1) + M * 9.81 * x[:, 2] + 0.5 * k * np.maximum(r - ln, 0) ** 2
    assert np.ptp(total[2:-2]) < 2e-4
    assert (r > ln).any()
    assert (r < ln).any()


def test_coriolis_and_magnus_turn_the_velocity() -> None:
    scene = ball()
    law = Law(scene, [Effect("coriolis", {"Omega": [0.0, 0.0, 0.5]})])
    f = law.force(0, np.zeros(3), np.array([1.0, 0, 0]), np.zeros(3), 2.0)
    assert np.allclose(f, [0, -2.0, 0])
    law = Law(scene, [Effect("magnus_lift", {"s": 0.1})])
    assert np.allclose(law.force(0, np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 3.0]), 1.0), [0, 0.3, 0])


def test_fan_and_central_force() -> None:
    law = Law(ball(), [Effect("central_force", {"s": 2.0, "n": -2.0, "point": [0, 0, 0]})])
    assert np.allclose(law.force(0, np.array([2.0, 0, 0]), np.zeros(3), np.zeros(3), 1.0), [-0.5, 0, 0])
    law = Law(ball(), [Effect("fan", {"f": [1.0, 0, 0], "c": [0, 0, 0], "w": 0.5})])
    assert np.allclose(law.force(0, np.array([0, 0.5, 0]), np.zeros(3), np.zeros(3), 1.0), [np.exp(-0.5), 0, 0])


def test_bounce_heights() -> None:
    scene = ball("bounce", e=0.8, mu=0.0)
    path = simulate(Law(scene, []), throw([0, 0, 1 + R], [0.3, 0, 0], t=1.6))
    t1 = np.sqrt(2 / 9.81)
    assert abs(path.impacts[0][0] - t1) < 1e-9
    assert abs(path.impacts[0][2] - np.sqrt(2 * 9.81)) < 1e-8
    top = path.sample(np.array([t1 + 0.8 * t1]))[0][0, 0, 2]
    assert abs(top - (R + 0.64)) < 1e-8
    assert abs(path.impacts[1][0] - t1 * (1 + 2 * 0.8)) < 1e-8


def test_slip_bounce_changes_spin() -> None:
    e, mu = 0.7, 0.1
    scene = ball("bounce", e=e, mu=mu)
    before = np.array([5.0, 0, -2])
    v, w, back = bounce(Law(scene, []), scene.planes[0], scene.bodies[0], np.zeros(3), before, np.zeros(3))
    dv = mu * (1 + e) * 2
    assert np.allclose(v, [5 - dv, 0, e * 2])
    assert back == pytest.approx(e * 2)
    assert np.allclose(w, [0, 2.5 * dv / R, 0])
    lost = 0.5 * M * (29 - v @ v) - 0.5 * scene.bodies[0].inertia * (w @ w)
    slip_mean = 5 - 0.5 * 3.5 * dv  # work of friction: impulse times mean slip; normal: (1-e^2) v_n^2 m/2
    assert lost == pytest.approx(M * dv * slip_mean + 0.5 * M * (1 - e**2) * 4)


def test_grip_spin_coupling_and_bounce_friction() -> None:
    scene = ball("bounce", e=0.7, mu=5.0)
    args = (scene.planes[0], scene.bodies[0], np.zeros(3), np.array([1.0, 0.5, -2]), np.array([3.0, -4, 7]))

    def slip(v: np.ndarray, w: np.ndarray) -> np.ndarray:
        return (v + cross(w, -R * UP))[:2]

    before = slip(args[3], args[4])
    v, w, _ = bounce(Law(scene, []), *args)
    assert np.allclose(slip(v, w), 0)
    assert w[2] == 7
    v, w, _ = bounce(Law(scene, [Effect("spin_coupling", {"e_t": 0.6})]), *args)
    assert np.allclose(slip(v, w), -0.6 * before)
    v, w, _ = bounce(Law(scene, [Effect("bounce_friction", {"f": 0.3})]), *args)
    assert np.allclose(v, [0.7, 0.35, 1.4])
    assert np.allclose(w, args[4])


def test_restitution_forms() -> None:
    scene = ball("bounce", e=0.8)
    floor = scene.planes[0]
    law = Law(scene, [Effect("restitution_speed", {"e0": 0.8, "k": 0.1})])
    assert law.restitution(floor, 0.8, 2.0) == pytest.approx(0.8 / 1.2)
    p = {"form": "fifth_root", "e0": 0.9, "a": 0.1}
    assert Law(scene, [Effect("restitution_speed", p)]).restitution(floor, 0.8, 32.0) == pytest.approx(0.7)
    assert Law(scene, [Effect("restitution_error", {"e": 0.6})]).restitution(floor, 0.8, 2.0) == 0.6


@pytest.mark.parametrize("spin", [[0.0, 0, 0], [20.0, -30, 5]])
def test_base_model_equals_integrator(spin: list[float]) -> None:
    wall = Plane("wall", np.array([1.5, 0, 0]), np.array([-1.0, 0, 0]), 0.8, 0.2)
    scene = ball("bounce", walls=[wall])
    launch = throw([0, 0, 0.8], [2.5, 0.4, 1.0], spin, t=1.8)
    ts, x = run(scene, [], launch)
    s = launch.starts[0]
    assert np.abs(x - base_sphere(Law(scene, []), s.x, s.v, s.w, ts)).max() < 1e-7
    assert rms(residuals(Law(scene, []), [launch], [0], 1e-10, 40)) < 1e-7


def test_hidden_wall_is_met() -> None:
    wall = Effect("hidden_wall", {"point": [1.0, 0, 0], "normal": [-1.0, 0, 0], "restitution": 0.5, "friction": 0.0})
    ts, x = run(ball(), [wall], throw([0, 0, 50], [2.0, 0.3, 4]))
    hit = (1.0 - R) / 2.0
    want = np.where(ts < hit, 2 * ts, 1.0 - R - 1.0 * (ts - hit))
    assert np.abs(x[:, 0] - want).max() < 1e-8
    assert np.abs(x[:, 1] - 0.3 * ts).max() < 1e-8


def test_sliding_becomes_rolling() -> None:
    scene = ball("roll", mu=0.2)
    launch = throw([0, 0, R], [2.0, 0.0, 0.0], t=1.5)
    ts, x = run(scene, [], launch)
    t_grip = 2.0 / (3.5 * 0.2 * 9.81)
    late = ts > t_grip
    x_grip = 2 * t_grip - 0.5 * 0.2 * 9.81 * t_grip**2
    assert np.abs(x[late, 0] - (x_grip + 10 / 7 * (ts[late] - t_grip))).max() < 1e-6
    s = launch.starts[0]
    assert np.abs(x - base_sphere(Law(scene, []), s.x, s.v, s.w, ts)).max() < 1e-6


def test_rolling_resistance_and_viscous() -> None:
    scene = ball("roll", mu=0.3)
    b = 0.001
    ts, x = run(scene, [Effect("rolling_resistance", {"b": b})], throw([0, 0, R], [1.0, 0, 0], [0, 1.0 / R, 0]))
    assert np.abs(x[:, 0] - (ts - 0.5 * (5 / 7) * b * 9.81 / R * ts**2)).max() < 1e-8
    c = 0.2
    ts, x = run(scene, [Effect("viscous_friction", {"c": c})], throw([0, 0, R], [1.0, 0, 0], [0, 1.0 / R, 0]))
    tau = 1.4 * M / c
    assert np.abs(x[:, 0] - tau * (1 - np.exp(-ts / tau))).max() < 1e-8


def test_orientation_and_spin_damping() -> None:
    scene = ball(orient=True)
    w, rate = np.array([3.0, -5.0, 8.0]), 1.5
    ts = np.linspace(0, 0.999, 30)
    path = simulate(Law(scene, []), throw([0, 0, 50], [0, 0, 0], w.tolist()))
    dot = np.abs(np.sum(path.sample(ts)[1][0] * rotvec_q(np.outer(ts, w)), axis=1))
    assert np.abs(dot - 1).max() < 1e-9
    law = Law(scene, [Effect("spin_damping", {"c": rate * scene.bodies[0].inertia})])
    q = simulate(law, throw([0, 0, 50], [0, 0, 0], w.tolist())).sample(ts)[1][0]
    dot = np.abs(np.sum(q * rotvec_q(np.outer((1 - np.exp(-rate * ts)) / rate, w)), axis=1))
    assert np.abs(dot - 1).max() < 1e-9
    assert np.allclose(qmul(q, q * [1, -1, -1, -1])[:, 0], 1)


def discs(count: int, mu: float = 0.1, rim: float = 0.0) -> Scene:
    bodies = [Body(f"d{i}", "disc", 0.05, 0.2 + 0.1 * i, 0.9, mu, 0.02, rim) for i in range(count)]
    return Scene(bodies, [Plane("table", np.zeros(3), UP, 0.0, mu)], True, "discs", rim > 0, False, "without spin")


def test_puck_stops() -> None:
    launch = Launch(0.0, 5.0, [Start(np.zeros(3), np.array([1.0, 0, 0]))])
    path = simulate_discs(Law(discs(1), []), launch)
    assert path.why == "stopped"
    assert abs(path.t_end - 1 / 0.981) < 2e-3
    assert abs(path.sample(np.array([path.t_end]))[0][0, 0, 0] - 1 / (2 * 0.981)) < 2e-6


def test_friction_patch_costs_the_right_energy() -> None:
    e = Effect("friction_patch", {"mu": 0.3, "center": [0.5, 0.0], "radius": 0.1})
    path = simulate_discs(Law(discs(1, mu=0.05), [e]), Launch(0.0, 0.6, [Start(np.zeros(3), np.array([2.0, 0, 0]))]))
    ts = np.array([path.t_end - 1e-4, path.t_end])
    x = path.sample(ts)[0][0, :, 0]
    v2 = 4 - 2 * 9.81 * (0.3 * 0.2 + 0.05 * (x.mean() - 0.2))
    assert abs(np.diff(x)[0] / 1e-4 - np.sqrt(v2)) < 1e-5


def test_disc_collision_conserves() -> None:
    p1, p2, v1, v2 = np.array([0.0, 0]), np.array([0.1, 0.02]), np.array([2.0, 0.3]), np.array([-0.5, 0.1])
    m1, m2, r = 0.2, 0.3, 0.05
    i1, i2 = 0.5 * m1 * r * r, 0.5 * m2 * r * r
    n = (p1 - p2) / np.linalg.norm(p1 - p2)
    a, b, w1, w2 = disc_hit(n, (v1, 3.0, m1, r), (v2, -1.0, m2, r), 1.0, 0.2)
    assert np.allclose(m1 * a + m2 * b, m1 * v1 + m2 * v2)
    assert (a - b) @ n == pytest.approx(-(v1 - v2) @ n)
    arm = -r * n  # the spins change by r x J / I
    jump = m1 * (a - v1)
    assert i1 * (w1 - 3.0) == pytest.approx(arm[0] * jump[1] - arm[1] * jump[0])
    assert i2 * (w2 + 1.0) == pytest.approx((r * n)[0] * -jump[1] - (r * n)[1] * -jump[0])


def test_base_discs_equal_integrator() -> None:
    scene = discs(3, mu=0.08, rim=0.15)
    starts = [
        Start(np.array([0, 0, 0.01]), np.array([1.6, 0.1, 0]), np.array([0, 0, 6.0])),
        Start(np.array([0.4, 0.03, 0.01]), np.zeros(3)),
        Start(np.array([0.7, 0.0, 0.01]), np.zeros(3)),
    ]
    launch = Launch(0.0, 1.5, starts)
    path = simulate_discs(Law(scene, []), launch)
    ts = np.linspace(0, path.t_end - 1e-9, 60)
    xs, vs = np.array([s.x[:2] for s in starts]), np.array([s.v[:2] for s in starts])
    base = base_discs(scene, xs, vs, np.array([6.0, 0, 0]), ts)
    assert len(path.impacts) >= 2
    assert np.abs(path.sample(ts)[0][:, :, :2] - base).max() < 5e-6


def test_observer_effects() -> None:
    ts, x = np.linspace(0, 1, 11), np.random.default_rng(0).normal(size=(1, 11, 3))
    q = np.tile([1.0, 0, 0, 0], (1, 11, 1))
    tilt = Law(ball(), [Effect("observer_tilt", {"angle": 0.1, "axis": [0, 1.0, 0], "c": [0, 0, 0]})])
    rot = np.array([[np.cos(0.1), 0, np.sin(0.1)], [0, 1, 0], [-np.sin(0.1), 0, np.cos(0.1)]])
    assert np.allclose(seen(tilt, ts, x, q, 0).x, x @ rot.T)
    lens = Law(ball(), [Effect("observer_distortion", {"k": 0.1, "c": [1.0, 0, 0]})])
    d = x - [1.0, 0, 0]
    assert np.allclose(seen(lens, ts, x, q, 0).x, [1.0, 0, 0] + d * (1 + 0.1 * (d**2).sum(-1, keepdims=True)))
    lost = Law(ball(), [Effect("dropped_frames", {"run": 2, "onset": 0.5, "shift": 0.2, "sign": "lost"})])
    track = seen(lost, ts, x, q, 2)
    assert np.allclose(np.diff(track.t), 0.1)
    assert len(track.t) == 9
    assert len(seen(lost, ts, x, q, 1).t) == 11


def test_faults_of_the_record() -> None:
    ts = np.linspace(0, 1, 11)
    track = Track(ts, ts, np.ones((1, 11, 3)), np.ones((1, 11, 4)))
    stuck = spoil(track, {"kind": "stuck", "onset": 0.45, "point": [5.0, 5, 5]}, None)
    assert (stuck.x[0, :5] == 1).all()
    assert (stuck.x[0, 5:] == 5).all()
    zoom = spoil(track, {"kind": "zoom", "onset": 0, "s": 1.1, "c": [0.0, 0, 0]}, None)
    assert np.allclose(zoom.x, 1.1)


@pytest.mark.parametrize("kind", ["white", "ar1", "pixel", "t3"])
def test_noise_sigma(kind: str) -> None:
    ts = np.arange(40000) / 100
    x = np.cumsum(np.full((1, 40000, 3), 0.37), axis=1)
    track = Track(ts, ts, x, np.tile([1.0, 0, 0, 0], (1, 40000, 1)))
    noisy, present = add_noise(np.random.default_rng(1), track, Noise(kind, 0.01, 0.01, 3.0, 0.05))
    assert np.std(noisy.x - x) == pytest.approx(0.01, rel=0.08)
    assert present.mean() == pytest.approx(0.95, abs=0.01)


def test_kick_reflects() -> None:
    law = Law(ball(), [])
    path = simulate(law, throw([0, 0, 50], [2.0, 0, 0]), kicks=[(0.4, np.array([-1.0, 0, 0]), 0.5)])
    x = path.sample(np.array([0.4, 0.9]))[0][0, :, 0]
    assert np.allclose(x, [0.8, 0.8 - 0.5])
