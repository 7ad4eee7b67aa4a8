import numpy as np

from tests.benchmarks.third_generator.generator import Effects, World, build, case, simulate

T = np.linspace(0.0, 2.0, 201)


def run(stated: dict[str, object], start: list[float], effects: Effects | None = None) -> np.ndarray:
    return simulate(World(3 if "floor" in stated else 1, stated, [np.array(start, float)], [T]), effects or {})[0]


def test_ball_flies_falls_and_bounces_as_closed_forms_say() -> None:
    ball = {"kind": "ball", "rate_hz": 100.0, "gravity": 9.81, "radius": 0.05, "floor": False}
    still = [0.0] * 6
    flight = run(ball, [0, 0, 1, 3, 1, 4, *still[:3]])
    np.testing.assert_allclose(flight[:, :3], np.c_[3 * T, T, 1 + 4 * T - 4.905 * T**2], atol=1e-9)
    top = np.sqrt(9.81 / 0.5)  # terminal speed
    fall = run(ball, [0, 0, 9, *still], {"quadratic_drag": {"strength": 0.5}})
    np.testing.assert_allclose(fall[:, 2], 9 - top**2 / 9.81 * np.log(np.cosh(9.81 * T / top)), atol=1e-9)
    low, first = run(ball | {"floor": True, "restitution": 0.8}, [0, 0, 1.05, *still])[:, 2], np.sqrt(2 / 9.81)
    for n, at in enumerate([first * (1 + 0.8), first * (1 + 1.6 + 0.64)], start=1):  # tops of the arcs
        assert abs(low[np.abs(T - at) < 0.05].max() - 0.05 - 0.64**n) < 5e-4


def test_block_stops_and_pendulum_swings_as_closed_forms_say() -> None:
    block = run({"kind": "block", "rate_hz": 100.0, "gravity": 9.81, "friction": 0.2}, [0.1, -2])
    np.testing.assert_allclose(block[-1], [0.1 - 4 / (2 * 0.2 * 9.81), 0], atol=1e-9)
    swing = run({"kind": "pendulum", "rate_hz": 100.0, "gravity": 9.81, "length": 0.5}, [1e-4, 0])
    np.testing.assert_allclose(swing[:, 0], 1e-4 * np.cos(np.sqrt(9.81 / 0.5) * T), atol=1e-11)


def test_the_same_seed_gives_the_same_data() -> None:
    first = case(3, 4).data.tobytes()
    build.cache_clear()
    assert case(3, 4).data.tobytes() == first != case(4, 4).data.tobytes()
